"""Every tuned value of `robust`, nested by stage: each with its unit, its bound, and where it comes from.

"Chosen on rendered seeds" means by hand, on seeds 100 to 107 of rendered flights (docs/robust.md), and no better source
is known. A suite sets any of them: ``[trackers.mine.config.motion]``.
"""

from dataclasses import dataclass, field

from uavbench.tracker.robust.config.bounds import NotNegative, Number, Part, Positive, Ratio, Sigma
from uavbench.tracker.robust.config.budget import BudgetConfig
from uavbench.tracker.robust.config.edges import EdgesConfig
from uavbench.tracker.robust.config.patches import PatchesConfig
from uavbench.tracker.robust.config.preprocessing import PreprocessingConfig
from uavbench.tracker.robust.config.relocalization import RelocalizationConfig
from uavbench.tracker.robust.config.solver import SolverConfig


@dataclass(frozen=True)
class MotionConfig:
    """Prediction: first-order Gauss-Markov motion."""

    memory_s: Positive = 1.0
    """Time over which a velocity is forgotten. Chosen on rendered seeds."""
    acceleration_ranges_s2: NotNegative = 3.0
    """One standard deviation of the acceleration, in ranges: a model may be in any unit. Physical: 4 m/s2, of a small
    multirotor flown by hand, at 1.3 m."""
    angular_acceleration_rad_s2: NotNegative = 10.0
    """One standard deviation of the angular acceleration. Physical: the same."""
    initial_rate_1_s: NotNegative = 0.3
    """One standard deviation of the velocity while none is known, in ranges/s and rad/s. Chosen on rendered seeds."""
    max_sigma: Sigma = 0.2
    """The prediction adds no more than this to the standard deviations of the pose, in parts of the range and in rad.
    Chosen on rendered seeds."""
    expected_scale: Ratio = 3.0
    """What the vehicle's filter expects counts with its standard deviations times this, with a ninth of its
    information: the filter knows it from earlier poses of the same run, which must not count twice. Chosen on rendered
    seeds."""


@dataclass(frozen=True)
class InitializationConfig:
    """The initial pose: kept while the image supports it, else searched."""

    sigma: Sigma = 0.005
    """One standard deviation of a pose that is known, in parts of the range and in rad: of the initial one, and of a
    fitted one that is fitted again. Chosen on rendered seeds."""
    kept_sigma: Sigma = 0.001
    """The same in the fit that is to stay there, and once it was kept. Measured on 22 first frames: the support is 0.36
    to 0.81 at the true pose, 0.29 to 0.78 beside it by 0.3 %, 0.04 to 0.28 by 1 % and more."""
    min_support: Part = 0.3
    """Support that the first frame needs, while appearance is unknown. Measured on 22 first frames."""
    young_frames: Number = 5
    """Frames in which a run does not trust its predictions. Chosen on rendered seeds."""
    doubted_support: Part = 0.68
    """Support that they need where the initial pose was wrong. Chosen on rendered seeds."""


@dataclass(frozen=True)
class LossConfig:
    """Loss, and when a pose search is due."""

    min_support: Part = 0.5
    """With less support the track is lost. Chosen on rendered seeds."""
    log10_false_alarms: float = -10.0
    """A track goes on with less support while chance would find as many edges in fewer than 10 to this poses. Measured
    on six flights: -12 to -36 at the tracked pose, -9 to 2 at poses beside it by 5 to 30 % of the range."""
    slow_s: Positive = 0.3
    """Frames farther apart may be fitted to a neighbouring edge. Chosen on rendered seeds."""
    slow_part: Part = 0.92
    """Part of the usual support below which poses are then searched. Chosen on rendered seeds."""
    far_part: Part = 0.8
    """Part of the usual support that a pose far from the prediction needs, and the first one after a loss. Measured on
    a bridge: 0.55 to 0.64 is seen one panel too far, 0.8 at its true place."""


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
    """The pose from edges and patches."""
    initialization: InitializationConfig = field(default_factory=InitializationConfig)
    """Initialization."""
    loss: LossConfig = field(default_factory=LossConfig)
    """Loss of the track."""
    relocalization: RelocalizationConfig = field(default_factory=RelocalizationConfig)
    """Relocalization."""
    budget: BudgetConfig = field(default_factory=BudgetConfig)
    """Work of a frame."""

    @property
    def good_support(self) -> float:
        """Support below which a pose is searched: one that leads the least support of a track as a pose must lead."""
        return self.loss.min_support + self.relocalization.lead
