"""Tuned values of the solver: hypotheses, M-estimation, nuisance biases."""

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import Annotated

from annotated_types import Interval, MinLen, Unit

from uavbench.tracker.robust.config.bounds import Part, Positive

Widths = Annotated[tuple[Positive, ...], MinLen(1)]


@dataclass(frozen=True)
class EstimatorConfig:
    """M-estimation with Tukey's biweight of decreasing cutoffs (Beaton & Tukey 1974)."""

    coarse_widths_px: Widths = (8.0, 5.0, 3.0)
    """Cutoffs after the hypotheses, and of a fit to patches alone; beyond the last one a candidate is an outlier of a
    hypothesis. Chosen on rendered seeds: smaller ones lose edges with large offsets."""
    patches_prior_part: Annotated[float, Interval(gt=0, le=1), Unit("1")] = 0.01
    """Fraction of the total information that regularizes the pose of the patches alone. Chosen on rendered seeds."""

    @property
    def fine_widths_px(self) -> tuple[float, ...]:
        """Cutoffs after the short search: half as large, and the last one three times; in sub-pixel refinement the last
        two.
        """
        half = [0.5 * width_px for width_px in self.coarse_widths_px]
        return (*half, half[-1], half[-1])

    @property
    def fine_half_px(self) -> float:
        """Half length of search lines of the short search, and the least one from a prediction.

        Farther candidates have no weight; one pixel more, because a sub-pixel maximum may be that far from its pixel.
        """
        return float(self.fine_widths_px[0]) + 1.0

    @cached_property
    def last_width_px(self) -> float:
        """The last cutoff of all, within which an edge is found."""
        return float(self.fine_widths_px[-1])

    @property
    def trusted_px(self) -> float:
        """Residual of most influence, beyond which a match is the less believed the larger it is.

        That of the last biweight: its influence r (1 - r^2 / c^2)^2 has its maximum at c / sqrt(5).
        """
        return self.last_width_px / math.sqrt(5.0)

    @property
    def separate_px(self) -> float:
        """Spacing from which edges do not disturb each other: beyond the largest cutoff."""
        return float(self.coarse_widths_px[0])


@dataclass(frozen=True)
class BiasConfig:
    """Nuisance biases: the patches' common error and the offset of each edge."""

    correlation_s: Positive = 1.0
    """Correlation time of the errors of edges, apart from their offsets, and of patches: a patch of this age has twice
    the variance of an old one, since it may lie on a moving occluder. Chosen on rendered seeds."""
    forgotten_part: Part = 0.6
    """Fraction forgotten in that time, in which other patches are found. Measured on 8 to 10 sequences; with ten
    seconds instead of one, depth drifts by 2 to 5 mm at 1 Hz."""


@dataclass(frozen=True)
class SolverConfig:
    """The solver."""

    estimator: EstimatorConfig = field(default_factory=EstimatorConfig)
    """M-estimation."""
    bias: BiasConfig = field(default_factory=BiasConfig)
    """Biases shared across frames."""
