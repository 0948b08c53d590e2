"""Tuned values of texture patches."""

from dataclasses import dataclass, field
from typing import Annotated

from annotated_types import Gt, Unit

from uavbench.tracker.robust.config.bounds import Part, Positive


@dataclass(frozen=True)
class AlignmentConfig:
    """Alignment of a patch by Gauss-Newton (Baker & Matthews 2004)."""

    min_correlation: Part = 0.85
    """Least correlation at which a patch counts as found. Chosen on rendered seeds."""
    variance_px2: Positive = 0.1**2
    """Variance of a patch along either axis in addition to that due to noise. Measured on rendered boxes: relative
    positions of patches are accurate to about 0.1 px."""
    max_area_change: Annotated[float, Gt(1), Unit("1")] = 3.0
    """Largest change of scale since its creation at which a patch is still searched. Chosen on rendered seeds."""


@dataclass(frozen=True)
class PatchesConfig:
    """Selection, use and removal of patches."""

    alignment: AlignmentConfig = field(default_factory=AlignmentConfig)
    """Alignment in later frames."""
