"""Tuned values of the solver: hypotheses, M-estimation, nuisance biases."""

from dataclasses import dataclass, field
from typing import Annotated

from annotated_types import Interval, MinLen

from uavbench.tracker.robust.config.bounds import Count, NotNegative, Part, Positive

Widths = Annotated[tuple[Positive, ...], MinLen(1)]


@dataclass(frozen=True)
class HypothesesConfig:
    """Camera motions on which candidates of several edges agree (RANSAC: Fischler & Bolles 1981)."""

    count: Count = 64
    """Hypotheses drawn for a frame, of three edges each. Chosen on rendered seeds, for time."""
    inlier_px: Positive = 3.0
    """Distance at which a candidate counts as an outlier. Chosen on rendered seeds."""
    candidate_sigma_px: Positive = 0.7
    """One standard deviation of a candidate. Chosen on rendered seeds."""
    scored_points: Count = 96
    """Control points that score a hypothesis are thinned to so many. Chosen on rendered seeds, for time."""
    prior_weight: NotNegative = 0.25
    """Weight of the prediction against candidates not weighed by their own errors yet. Chosen on rendered seeds."""
    colour_cost: NotNegative = 0.1
    """Cost of a candidate for each unit of its colour penalty. Chosen on rendered seeds."""


@dataclass(frozen=True)
class EstimatorConfig:
    """M-estimation with Tukey's weights of widths that shrink (Beaton & Tukey 1974)."""

    coarse_widths_px: Widths = (8.0, 5.0, 3.0)
    """Widths after the hypotheses. Chosen on rendered seeds."""
    patch_widths_px: Widths = (8.0, 4.0, 3.0)
    """Widths of a fit to patches alone. Chosen on rendered seeds."""
    fine_widths_px: Widths = (4.0, 3.0, 2.0, 1.5, 1.5)
    """Widths after the short search. Chosen on rendered seeds."""
    last_widths_px: Widths = (1.5, 1.5)
    """Widths when it is made again, and of the sub-pixel steps. Chosen on rendered seeds: narrower ones lose edges with
    large offsets."""
    colour_cost: NotNegative = 0.1
    """Cost of a candidate for each unit of its colour penalty. Chosen on rendered seeds."""
    repeat_px: Positive = 1.0
    """Control points are searched again when the pose moved them further. Chosen on rendered seeds."""
    patches_prior_part: Annotated[float, Interval(gt=0, le=1)] = 0.01
    """Share of all information that holds the pose of the patches alone. Chosen on rendered seeds."""


@dataclass(frozen=True)
class BiasConfig:
    """Nuisance biases: the patches' common error and the offset of each edge."""

    correlation_s: Positive = 1.0
    """Time over which errors of edges beside their offsets are correlated. Chosen on rendered seeds."""
    forgotten_part: Part = 0.6
    """Part forgotten in that time: other patches are found by then. Measured on 8 to 10 sequences; with ten seconds in
    place of one, depth drifts by 2 to 5 mm at 1 Hz."""
    offset_scale_rate: Part = 0.1
    """Rate at which the factor of the offsets' variances is learned. Chosen on rendered seeds."""
    min_offset_scale: Positive = 0.6
    """Least factor. Chosen on rendered seeds."""
    max_offset_scale: Positive = 16.0
    """Largest factor. Chosen on rendered seeds."""
    min_freedom: Positive = 0.3
    """Least expected sum of squared offsets from which it is learned: more edges than six unknowns take up. Chosen on
    rendered seeds."""
    max_innovation: Positive = 4.0
    """A frame that is fitted wrongly counts for no more than this. Chosen on rendered seeds."""


@dataclass(frozen=True)
class SolverConfig:
    """The solver."""

    hypotheses: HypothesesConfig = field(default_factory=HypothesesConfig)
    """Hypotheses on the camera's motion."""
    estimator: EstimatorConfig = field(default_factory=EstimatorConfig)
    """M-estimation."""
    bias: BiasConfig = field(default_factory=BiasConfig)
    """Biases shared across frames."""
