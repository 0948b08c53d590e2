"""`robust`: prediction, hidden-line removal, learned edge appearance, hypotheses, M-estimation, relocalization."""

from dataclasses import dataclass, field

import numpy as np

from uavbench.scenes.camera import Camera
from uavbench.scenes.structure import Structure
from uavbench.tracker.protocol import Image, Run, TrackResult, check_image, check_stamp, check_start
from uavbench.tracker.robust.config import RobustConfig
from uavbench.tracker.robust.decision.decider import Decider, Decision
from uavbench.tracker.robust.edges.edge_graph import members_of
from uavbench.tracker.robust.fit.edge_fit import EdgeFitter
from uavbench.tracker.robust.fit.pose_fit import Fit
from uavbench.tracker.robust.fit.unit_weight import UnitWeight
from uavbench.tracker.robust.follow import Follower
from uavbench.tracker.robust.frames import Frame, Frames
from uavbench.tracker.robust.motion_model import Motion, isotropic_covariance
from uavbench.tracker.robust.preprocessing.masking import Masking
from uavbench.tracker.robust.rehearsal import rehearse
from uavbench.tracker.robust.solver.hypothesis_kernels import HYPOTHESES
from uavbench.tracker.robust.track_state import Told, TrackState
from uavbench.tracker.stage_clock import StageClock
from uavbench.trajectories.kernels.warm_up import prepare
from uavbench.trajectories.pose import Array, Pose


@dataclass(frozen=True)
class Robust:
    """Parameters of `robust`: its config; quantities that differ between sequences are learned from their frames."""

    config: RobustConfig = field(default_factory=RobustConfig)

    def start(self, structure: Structure, camera: Camera, cam_from_world: Pose, rng: np.random.Generator) -> Run:
        """Start a run from an initial pose; StartError for inputs of another type, and when that pose is none."""
        first = check_start(structure, camera, cam_from_world, rng)
        prepare(__name__)
        rehearse(begun)
        return RobustRun(structure, camera, first, rng, self.config)


class RobustRun:
    """A run of `robust`."""

    def __init__(
        self,
        structure: Structure,
        camera: Camera,
        cam_from_world: Pose,
        rng: np.random.Generator,
        config: RobustConfig,
    ) -> None:
        self.camera, self.config = camera, config
        middle = structure.bounds.mean(axis=0, keepdims=True)
        range_m = float(np.linalg.norm(cam_from_world.transform(middle)))
        motion = Motion(cam_from_world, isotropic_covariance(config.initialization.sigma, range_m))
        self.state = TrackState(config, motion, range_m)
        self.fitter = EdgeFitter(structure, camera, rng, config)
        self.masking = Masking(camera)
        self.frames = Frames(self.fitter, self.state, config)
        self.decider = Decider(self.fitter, camera, self.state, config)
        self.follower = Follower(self.fitter, self.state, self.decider.relocator.searcher, config)
        rate, width_px = config.edges.appearance.learning_rate, config.solver.estimator.last_width_px
        self.unit_weight = UnitWeight(rate, members=members_of(self.fitter.edges.ends), width_px=width_px)
        self.expected: Motion | None = None

    def predict(self, cam_from_world: Pose, covariance: Array) -> None:
        """Set the vehicle filter's prediction of the next frame, used if it is more certain than the motion model's.

        Its covariance is inflated, because it depends on earlier poses of this run, which must not count twice.
        """
        pose = Pose(np.ascontiguousarray(cam_from_world.rotation), np.ascontiguousarray(cam_from_world.translation))
        known = np.ascontiguousarray(covariance, dtype=np.float64)
        self.expected = Motion(pose, self.config.motion.expected_scale**2 * known)

    def track(self, image: Image, stamp_ns: int) -> TrackResult:
        """Estimate the pose of the next frame; `lost` also where the stamp goes back or the image is frozen.

        ImageError for an image of another size or type, or grey after coloured ones, StampError for a stamp that is not
        in whole nanoseconds.
        """
        image, stamp_ns = self.masking.of(check_image(image, self.camera)), check_stamp(stamp_ns)
        clock = StageClock()
        expected, self.expected = self.expected, None
        if not self.frames.is_new(image, stamp_ns):
            return TrackResult(status="lost")
        frame = self.frames.prepared(image, stamp_ns, expected, clock)
        fit = self.follower.unrolled(frame, self.follower.fit(frame, clock), clock)
        fit, frame = self.frames.compensated(frame, fit, clock)
        fit = self.follower.repeated(frame, fit, clock)
        decision = self.decider.decide(frame, fit, clock)
        if not decision.settled:
            self.state.suppose(decision.contenders, frame.likely, frame.dt_s, stamp_ns)
            self.frames.restore(frame.before)
            self.frames.restore(self.decider.beginnings.give_up_doubted(frame.before))
            return undecided(decision, frame, clock)
        with clock.stage("learn"):
            self.learn(frame, decision.fit, stamp_ns)
            self.decider.remember(frame, decision)
            if not decision.is_open:
                self.state.told = Told(self.state.motion, self.state.range_m, stamp_ns * 1e-9)
        return undecided(decision, frame, clock) if decision.is_open else self.tracked(decision.fit, image, clock)

    def learn(self, frame: Frame, fit: Fit, stamp_ns: int) -> None:
        """Update appearance, patches, biases, motion, usual support and unit weight with the fit of a frame."""
        self.unit_weight.learn(fit, self.fitter.biases.state)
        self.fitter.learn(frame.image, fit, frame.dt_s)
        self.decider.found_edges.learn(fit)
        self.state.learn(frame.predicted, fit, frame.dt_s, stamp_ns, frame.step_s)
        self.frames.ok_rows = self.frames.seen_rows

    def tracked(self, fit: Fit, image: Image, clock: StageClock) -> TrackResult:
        """The result of a frame with an accepted pose."""
        by_codes = self.fitter.moved_by_codes(fit, 1 if image.ndim == 2 else image.shape[2])
        displaced = self.unit_weight.displaced(fit)
        return TrackResult(
            status="ok",
            cam_from_world=fit.cam_from_world,
            covariance=self.unit_weight.covariance(fit.covariance, self.camera, by_codes) + displaced,
            stage_ms=clock.ms,
            control_points=fit.control_points,
            candidates=fit.candidates,
            inliers=fit.inliers,
            log10_nfa=fit.log10_false_alarms(HYPOTHESES),
        )


def begun(structure: Structure, camera: Camera, cam_from_world: Pose, rng: np.random.Generator) -> Run:
    """A run with the config that is used by default."""
    return RobustRun(structure, camera, cam_from_world, rng, RobustConfig())


def undecided(decision: Decision, frame: Frame, clock: StageClock) -> TrackResult:
    """The result of a frame without an accepted pose: `ambiguous` if several poses explain it about equally well."""
    fit = decision.fit
    return TrackResult(
        status="ambiguous" if decision.rivalled or decision.is_open else "lost",
        guess=(fit if fit.finite else frame.predicted).cam_from_world,
        stage_ms=clock.ms,
        control_points=fit.control_points,
        inliers=fit.inliers,
        log10_nfa=fit.log10_false_alarms(HYPOTHESES),
    )
