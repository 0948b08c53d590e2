"""Tuned values of the solver: hypotheses, M-estimation, nuisance biases."""

from dataclasses import dataclass, field
from typing import Annotated

from annotated_types import Interval, MinLen, Unit

from uavbench.tracker.robust.config.bounds import Part, Positive, Weight

Widths = Annotated[tuple[Positive, ...], MinLen(1)]


@dataclass(frozen=True)
class HypothesesConfig:
    """Camera motions on which candidates of several edges agree (RANSAC: Fischler & Bolles 1981)."""

    prior_weight: Weight = 0.25
    """Weight of the prediction against candidates not weighed by their own errors yet. Chosen on rendered seeds."""


@dataclass(frozen=True)
class EstimatorConfig:
    """M-estimation with Tukey's weights of widths that shrink (Beaton & Tukey 1974)."""

    coarse_widths_px: Widths = (8.0, 5.0, 3.0)
    """Widths after the hypotheses, and of a fit to patches alone; at the last one a candidate is an outlier of a
    hypothesis. Chosen on rendered seeds."""
    fine_widths_px: Widths = (4.0, 3.0, 2.0, 1.5, 1.5)
    """Widths after the short search; the last two alone for the sub-pixel steps. Chosen on
    rendered seeds: narrower ones lose edges with large offsets."""
    patches_prior_part: Annotated[float, Interval(gt=0, le=1), Unit("1")] = 0.01
    """Share of all information that holds the pose of the patches alone. Chosen on rendered seeds."""

    @property
    def fine_half_px(self) -> float:
        """Half length of search lines once the pose is nearly right, and the shortest from a prediction.

        Farther candidates have no weight; a pixel more, as one may lie so far beside the steepest pixel.
        """
        return float(self.fine_widths_px[0]) + 1.0

    @property
    def separate_px(self) -> float:
        """Distance from which edges do not disturb each other: the widest weight does not reach that far."""
        return float(self.coarse_widths_px[0])


@dataclass(frozen=True)
class BiasConfig:
    """Nuisance biases: the patches' common error and the offset of each edge."""

    correlation_s: Positive = 1.0
    """Time over which errors of edges beside their offsets are correlated, and those of a patch: at this age its
    variance is twice that of an old one, as it may lie on a moving occluder. Chosen on rendered seeds."""
    forgotten_part: Part = 0.6
    """Part forgotten in that time: other patches are found by then. Measured on 8 to 10 sequences; with ten seconds in
    place of one, depth drifts by 2 to 5 mm at 1 Hz."""


@dataclass(frozen=True)
class SolverConfig:
    """The solver."""

    hypotheses: HypothesesConfig = field(default_factory=HypothesesConfig)
    """Hypotheses on the camera's motion."""
    estimator: EstimatorConfig = field(default_factory=EstimatorConfig)
    """M-estimation."""
    bias: BiasConfig = field(default_factory=BiasConfig)
    """Biases shared across frames."""
