"""Tuned values of the edges: control points, search lines, learned appearance, weights, sub-pixel refinement."""

from dataclasses import dataclass, field
from typing import Annotated

from annotated_types import Ge, Gt, Interval

from uavbench.tracker.robust.config.bounds import Count, NotNegative, Part, Positive


@dataclass(frozen=True)
class SamplingConfig:
    """Control points on the visible edges."""

    spacing_px: Positive = 6.0
    """One control point for so much of projected length. Chosen on rendered seeds, for time."""
    max_points: Count = 220
    """Points are wider apart where that would make many more than this. Chosen on rendered seeds, for time."""
    margin_px: NotNegative = 3.0
    """Points nearer to the image's border are left out. Chosen on rendered seeds."""
    samplings: Count = 3
    """Times that points are sampled, ever closer while hidden lines leave too few. Chosen on rendered seeds."""
    enough_part: Part = 0.7
    """Part of max_points that is enough. Chosen on rendered seeds."""
    min_shrink: Annotated[float, Interval(gt=0, le=1)] = 0.2
    """Least factor from one sampling's spacing to the next. Chosen on rendered seeds."""
    rounded_deg: Annotated[float, Interval(gt=0, le=90)] = 35.0
    """Faces that turn by less are parts of one rounded surface: a column of 12 sides has 30 degrees. Physical."""


@dataclass(frozen=True)
class SearchConfig:
    """Search lines across the control points, and the candidates on them."""

    candidates: Count = 4
    """Most candidates on a search line. Chosen on rendered seeds, for time."""
    max_half_px: Annotated[float, Interval(gt=0, le=48)] = 48.0
    """Longest half length of a search line; kernels have room for 48. Chosen on rendered seeds, for time."""
    min_half_px: Positive = 4.0
    """Shortest half length of a search line from a prediction. Chosen on rendered seeds."""
    fine_half_px: Positive = 5.0
    """Half length once the pose is nearly right. Chosen on rendered seeds."""
    prediction_sigmas: Positive = 3.0
    """Half length in standard deviations of the predicted point. 99.7 % of a normal distribution."""
    min_contrast_grey: Positive = 7.0
    """Weakest step of a candidate where nothing is learned. Chosen on rendered seeds."""
    learned_contrast_part: Part = 0.7
    """Part of it that a candidate needs where a step is learned. Chosen on rendered seeds."""
    learned_step_part: Part = 0.2
    """Part of the learned step that a candidate needs. Chosen on rendered seeds."""
    min_learned_step_grey: NotNegative = 4.0
    """A learned step weaker than this has no direction in colour. Chosen on rendered seeds."""
    colour_sigma_grey: Positive = 14.0
    """Spread of the colour beside an edge from frame to frame. Chosen on rendered seeds."""
    background_weight: Part = 0.25
    """Weight of the colour on the background side of a silhouette, which changes. Chosen on rendered seeds."""
    max_penalty: Positive = 9.0
    """Largest penalty of colours that differ: three standard deviations, squared."""
    rank_penalty: NotNegative = 0.5
    """Rank that a penalty of one costs a candidate. Chosen on rendered seeds."""
    rank_step_grey: Positive = 10.0
    """Added to the learned step by which contrasts are divided for the rank. Chosen on rendered seeds."""


@dataclass(frozen=True)
class AppearanceConfig:
    """Colours and residuals learned of each part of an edge."""

    max_residual_px: Positive = 1.5
    """Residuals are learned up to this size. Chosen on rendered seeds."""
    max_colour_residual_px: Positive = 0.7
    """Colours are learned of points found no farther from the pose's edge. Chosen on rendered seeds."""
    min_residual_rate: Part = 0.05
    """Least share of the newest residual in the mean square. Chosen on rendered seeds."""
    min_colour_rate: Part = 0.1
    """Least share of the newest colour in the mean. Chosen on rendered seeds."""
    initial_error_px_grey: Positive = 15.0
    """Error in px of an edge not seen yet times its step in grey levels. Chosen on rendered seeds."""


@dataclass(frozen=True)
class WeightConfig:
    """Weights and variances of control points, and the weight of a patch in the support."""

    separate_px: Positive = 8.0
    """Edges farther apart do not disturb each other. Chosen on rendered seeds."""
    touching_px: NotNegative = 2.0
    """Edges nearer to each other cannot be distinguished. Chosen on rendered seeds."""
    min_spacing_weight: Annotated[float, Interval(gt=0, le=1)] = 0.02
    """Weight of edges that touch. Chosen on rendered seeds."""
    parallel_cosine: Part = 0.85
    """Cosine of the angle up to which edges disturb each other: 32 degrees. Chosen on rendered seeds."""
    unknown_weight: Part = 0.25
    """Weight of an edge whose appearance is not learned. Chosen on rendered seeds."""
    known_frames: Positive = 3.0
    """Frames after which an appearance counts as learned. Chosen on rendered seeds."""
    weak_step_grey: Positive = 15.0
    """An edge with this contrast weighs half of one with much. Chosen on rendered seeds."""
    patch_weight: Positive = 2.0
    """Weight of a patch in the support, in control points. Chosen on rendered seeds."""
    missed_weight: Part = 0.5
    """Part of it for a patch that is not found: noise alone hides many. Chosen on rendered seeds."""
    point_variance_px2: Positive = 0.08**2
    """Variance of a control point by itself. Chosen on rendered seeds."""
    silhouette_variance_px2: Positive = 0.05**2
    """Variance of the offset of a silhouette. Measured at true poses: 0.01 to 0.1 px from the model's edge."""
    crease_variance_px2: Positive = 0.25**2
    """Variance of the offset of a crease. Measured at true poses: 0.1 to 0.9 px, by worn borders and insets."""
    contact_variance_px2: Positive = 0.2**2
    """Variance of the offset of an edge on the ground. Measured at true poses: 0.05 to 0.4 px, by its shadow."""
    shared_part: Part = 0.05
    """Part of the learned variance that all points of an edge share. Chosen on rendered seeds."""


@dataclass(frozen=True)
class SubpixelConfig:
    """A blurred step of linear light fitted to the pixels about each control point."""

    reach_px: Annotated[int, Interval(ge=1, le=3)] = 3
    """Pixels to either side of the edge on each scan line; the table has room for 3. Chosen on rendered seeds."""
    min_reach_px: Annotated[int, Ge(1)] = 2
    """Fewer are too few for a step and two levels. Physical."""
    along_px: Annotated[int, Ge(0)] = 2
    """Scan lines to either side of a control point: with 6 px spacing they nearly meet those of the next. Physical."""
    clearance_px: NotNegative = 1.5
    """Reach of the blur of a neighbouring edge: three standard deviations of 0.5 px. Physical."""
    max_shift_px: Positive = 0.5
    """The fit is linear in the shift, and right only near where it begins: one standard deviation of the blur.
    Physical."""
    min_step_part: Part = 0.2
    """Part of the learned step of light that must be seen. Chosen on rendered seeds."""
    max_noise_ratio: Annotated[float, Gt(1)] = 6.0
    """Variance of the light over the median along the edge, above which there is a corner or an occluder. Chosen on
    rendered seeds."""
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
