"""Tuned values of the edges: control points, search lines, learned appearance, weights and variances."""

from dataclasses import dataclass, field
from typing import Annotated

from annotated_types import Interval

from uavbench.tracker.robust.config.bounds import Part, Positive


@dataclass(frozen=True)
class SamplingConfig:
    """Control points on the visible edges."""

    spacing_px: Positive = 6.0
    """Spacing of control points along projected edges. Chosen on rendered seeds, for time."""
    rounded_deg: Annotated[float, Interval(gt=0, le=90)] = 35.0
    """Angle between faces below which they belong to one rounded surface: 30 degrees for a column of 12 sides.
    Physical.
    """


@dataclass(frozen=True)
class SearchConfig:
    """Search lines across the control points, and the candidates on them."""

    min_contrast_grey: Positive = 5.0
    """Least intensity step of a candidate, and of a learned edge with a colour direction. Chosen on rendered seeds."""
    learned_step_part: Part = 0.2
    """Least step of a candidate as a fraction of the learned step. Chosen on rendered seeds."""


@dataclass(frozen=True)
class AppearanceConfig:
    """Colours and residuals learned of each part of an edge."""

    learning_rate: Part = 0.1
    """Least weight of the newest frame in running means: of colours, residuals and the usual support. Chosen on
    rendered seeds."""
    weak_step_grey: Positive = 15.0
    """Intensity step at which an edge is assumed to have an error of 1 px, inversely proportional to the step, while
    its residuals are not learned; at this step its weight is one half. Also the standard deviation of the colour beside
    an edge between frames, which is added to the learned step for ranking contrasts. Chosen on rendered seeds."""


@dataclass(frozen=True)
class WeightConfig:
    """Weights and variances of control points, and weight of a patch in the support."""

    unknown_weight: Part = 0.25
    """Weight of an edge whose appearance is not learned yet. Chosen on rendered seeds."""
    point_variance_px2: Positive = 0.08**2
    """Independent variance of a control point. Chosen on rendered seeds."""
    offset_variance_px2: Positive = 0.04**2
    """Most variance of the offset of an edge of full weight before it was seen as often as a running mean takes to
    forget: worn borders, insets and shadows. Measured at the true poses of seven rendered sequences of boxes, walls and
    a bridge: 0.02 to 0.06 px RMS of silhouettes."""
    shared_part: Part = 0.5
    """Part of the mean square distance from the model's edge that all points of an edge share, and part of the variance
    of that offset that edges which look alike share. Measured at the true poses of 22 rendered flights: silhouettes lie
    beside the model's edge by 0.4 to 0.7 standard deviations of their points, at 0.02 px as at 0.4 px; creases by 0.3
    to 0.6 below 0.2 px. Offsets of edges that look alike are correlated by 0.4 to 0.8 on plain buildings, 0.1 to 0.25
    on brick, panels, bridges and trusses; with 0.3 and 0.7 errors change by less than their standard error."""


@dataclass(frozen=True)
class EdgesConfig:
    """Values of the edges."""

    sampling: SamplingConfig = field(default_factory=SamplingConfig)
    """Sampling of control points."""
    search: SearchConfig = field(default_factory=SearchConfig)
    """Search of candidates."""
    appearance: AppearanceConfig = field(default_factory=AppearanceConfig)
    """Learned appearance."""
    weights: WeightConfig = field(default_factory=WeightConfig)
    """Weights and variances."""
