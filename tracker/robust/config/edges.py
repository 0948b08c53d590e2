"""Tuned values of the edges: control points, search lines, learned appearance, weights, sub-pixel refinement."""

from dataclasses import dataclass, field
from typing import Annotated

from annotated_types import Interval

from uavbench.tracker.robust.config.bounds import Part, Positive


@dataclass(frozen=True)
class SamplingConfig:
    """Control points on the visible edges."""

    spacing_px: Positive = 6.0
    """One control point for so much of projected length. Chosen on rendered seeds, for time."""
    rounded_deg: Annotated[float, Interval(gt=0, le=90)] = 35.0
    """Faces that turn by less are parts of one rounded surface: a column of 12 sides has 30 degrees. Physical."""


@dataclass(frozen=True)
class SearchConfig:
    """Search lines across the control points, and the candidates on them."""

    min_contrast_grey: Positive = 5.0
    """Weakest step of a candidate, and of a learned one that has a direction in colour. Chosen on rendered seeds."""
    learned_step_part: Part = 0.2
    """Part of the learned step that a candidate needs. Chosen on rendered seeds."""
    colour_sigma_grey: Positive = 14.0
    """Spread of the colour beside an edge from frame to frame; added to the learned step by which contrasts are divided
    for the rank. Chosen on rendered seeds."""


@dataclass(frozen=True)
class AppearanceConfig:
    """Colours and residuals learned of each part of an edge."""

    max_colour_residual_px: Positive = 0.7
    """Colours are learned of points found no farther from the pose's edge. Chosen on rendered seeds."""
    learning_rate: Part = 0.1
    """Least share of the newest frame in what is learned: colours, residuals, the usual support, the scale of the
    offsets. Chosen on rendered seeds."""
    weak_step_grey: Positive = 15.0
    """Step of an edge that errs by 1 px, and in inverse proportion to its step, while its errors are not learned; it
    weighs half of one that does not err. Chosen on rendered seeds."""


@dataclass(frozen=True)
class WeightConfig:
    """Weights and variances of control points, and the weight of a patch in the support."""

    unknown_weight: Part = 0.25
    """Weight of an edge whose appearance is not learned. Chosen on rendered seeds."""
    point_variance_px2: Positive = 0.08**2
    """Variance of a control point by itself. Chosen on rendered seeds."""
    silhouette_variance_px2: Positive = 0.05**2
    """Variance of the offset of an edge with one visible face. Measured at true poses: silhouettes lie 0.01 to 0.1 px
    from the model's edge."""
    crease_variance_px2: Positive = 0.25**2
    """Variance of the offset of an edge with two visible faces. Measured at true poses: creases lie 0.1 to 0.9 px from
    the model's edge, by worn borders, insets and shadows."""


@dataclass(frozen=True)
class SubpixelConfig:
    """A blurred step of linear light fitted to the pixels about each control point."""

    variance_px2: Positive = 0.02**2
    """Variance of a fitted step beside that of its noise. Chosen on rendered seeds."""


@dataclass(frozen=True)
class EdgesConfig:
    """Everything about edges."""

    sampling: SamplingConfig = field(default_factory=SamplingConfig)
    """Sampling of control points."""
    search: SearchConfig = field(default_factory=SearchConfig)
    """Search of candidates."""
    appearance: AppearanceConfig = field(default_factory=AppearanceConfig)
    """Learned appearance."""
    weights: WeightConfig = field(default_factory=WeightConfig)
    """Weights and variances."""
    subpixel: SubpixelConfig = field(default_factory=SubpixelConfig)
    """Sub-pixel refinement."""
