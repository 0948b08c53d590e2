"""Every tuned value of `robust`, nested by stage, each with its unit, bound and source.

"Chosen on rendered seeds" means by hand, on seeds 100 to 107 of rendered flights (docs/robust.md), without any better
source. A suite sets any of them: ``[trackers.mine.config.motion]``.
"""

import math
from dataclasses import dataclass, field
from functools import cached_property

from uavbench.tracker.robust.config.bounds import NotNegative, Part, Positive, Ratio, Sigma
from uavbench.tracker.robust.config.budget import BudgetConfig
from uavbench.tracker.robust.config.edges import EdgesConfig
from uavbench.tracker.robust.config.patches import PatchesConfig
from uavbench.tracker.robust.config.preprocessing import PreprocessingConfig
from uavbench.tracker.robust.config.relocalization import FAR_VIEW_RAD, RelocalizationConfig
from uavbench.tracker.robust.config.solver import SolverConfig


@dataclass(frozen=True)
class MotionConfig:
    """Prediction: first-order Gauss-Markov motion."""

    memory_s: Positive = 1.0
    """Time constant of the velocity's decay. Chosen on rendered seeds."""
    acceleration_ranges_s2: NotNegative = 3.0
    """Standard deviation of the acceleration, relative to the range, since a model may be in any unit. Physical:
    4 m/s2, of a small multirotor flown by hand, at 1.3 m."""
    angular_acceleration_rad_s2: NotNegative = 10.0
    """Standard deviation of the angular acceleration. Physical: the same multirotor."""
    initial_rate_1_s: NotNegative = 0.3
    """Standard deviation of an unknown velocity, in ranges/s and rad/s. Chosen on rendered seeds."""
    expected_scale: Ratio = 3.0
    """Factor on the standard deviations of the vehicle filter's prediction, which thus counts with a ninth of its
    information: it depends on earlier poses of the same run, which must not count twice. Chosen on rendered seeds."""

    @cached_property
    def max_sigma(self) -> float:
        """Limit of the standard deviation that the prediction adds to the pose, as a fraction of the range and in rad.

        The farthest viewing directions that are searched lie two standard deviations away.
        """
        return 0.5 * FAR_VIEW_RAD


@dataclass(frozen=True)
class InitializationConfig:
    """Initialization: the initial pose is kept if chance does not explain what is found there, otherwise searched."""

    sigma: Sigma = 0.005
    """Standard deviation of a known pose, as a fraction of the range and in rad: of the initial pose, and of a fitted
    pose that is fitted again. Chosen on rendered seeds."""
    kept_sigma: Sigma = 0.001
    """The same in the prior-constrained fit, and once the initial pose was kept. Measured on 22 first frames: the
    support is 0.36 to 0.81 at the true pose, 0.29 to 0.78 at errors of 0.3 %, 0.04 to 0.28 at 1 % and above."""
    min_support: Part = 0.3
    """Least support of a first pose that a search found, while appearance is unknown. Measured on 22 first frames."""


@dataclass(frozen=True)
class LossConfig:
    """Criteria of track loss, and of starting a pose search."""

    min_support: Part = 0.5
    """Support below which the track is lost. Chosen on rendered seeds."""
    log10_false_alarms: float = -10.0
    """Logarithm of the number of false alarms below which a track with less support is continued, and a pose that a
    search found is accepted with less. Measured on six flights: -12 to -36 at the tracked pose, -9 to 2 at poses that
    are off by 5 to 30 % of the range."""
    slow_part: Part = 0.92
    """Fraction of the usual support below which a pose search follows an interval of `slow_s`, or one of more budget
    than the least where chance may have found the pose. Chosen on rendered seeds."""
    far_part: Part = 0.8
    """Least support, as a fraction of the usual one, of a pose far from the prediction, and of the first pose after
    track loss. Measured on a bridge: 0.55 to 0.64 one panel off, 0.8 at the true pose."""
    accuracy: Part = 1 / 60
    """Error, as a fraction of the range and in rad, of which two standard deviations of an accepted pose are no more.
    Physical: 25 mm at 1.5 m. Measured on 12 flights of boxes: a standard deviation of more than half of that in 19 of
    2,336 frames, nine of them wrong by more than 3 % of the range."""


@dataclass(frozen=True)
class RobustConfig:
    """Every tuned value of `robust`."""

    preprocessing: PreprocessingConfig = field(default_factory=PreprocessingConfig)
    """Preprocessing of images."""
    motion: MotionConfig = field(default_factory=MotionConfig)
    """Prediction."""
    edges: EdgesConfig = field(default_factory=EdgesConfig)
    """Edges of the model."""
    patches: PatchesConfig = field(default_factory=PatchesConfig)
    """Texture patches on its faces."""
    solver: SolverConfig = field(default_factory=SolverConfig)
    """Estimation of the pose from edges and patches."""
    initialization: InitializationConfig = field(default_factory=InitializationConfig)
    """Initialization."""
    loss: LossConfig = field(default_factory=LossConfig)
    """Track loss."""
    relocalization: RelocalizationConfig = field(default_factory=RelocalizationConfig)
    """Relocalization."""
    budget: BudgetConfig = field(default_factory=BudgetConfig)
    """Work budget of a frame."""

    @cached_property
    def good_support(self) -> float:
        """Support below which a pose is searched: the least support of a track plus the lead required of a pose."""
        return self.loss.min_support + self.relocalization.lead

    @cached_property
    def slow_s(self) -> float:
        """Frame interval from which a fit may be to a neighbouring edge, s.

        Acceleration of one standard deviation displaces the camera by a step of viewing directions meanwhile.
        """
        step, acceleration = self.relocalization.search.view_step_rad, self.motion.acceleration_ranges_s2
        return math.sqrt(2.0 * step / acceleration) if acceleration > 0.0 else math.inf
