"""`robust`: prediction, hidden-line removal, learned edge appearance, hypotheses, M-estimation, relocalization."""

from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from uavbench.scenes.camera import Camera
from uavbench.scenes.structure import Structure
from uavbench.tracker.protocol import Image, Run, TrackResult, check_image
from uavbench.tracker.robust.config import RobustConfig
from uavbench.tracker.robust.edge_fit import MIN_POINTS, EdgeFitter
from uavbench.tracker.robust.false_alarms import log10_false_alarms
from uavbench.tracker.robust.motion_model import FAR_CHI2, Motion, PredictionErrors, sigmas
from uavbench.tracker.robust.patches.patches import Texture
from uavbench.tracker.robust.pose_fit import Fit
from uavbench.tracker.robust.preprocessing.denoising import smoothed
from uavbench.tracker.robust.preprocessing.gain_offset import ContrastStretch, brightness_ratio, compensated
from uavbench.tracker.robust.relocalization.ranking import Sought
from uavbench.tracker.robust.relocalization.relocate import Relocator
from uavbench.tracker.stage_clock import StageClock
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.kernels.warm_up import prepare
from uavbench.trajectories.pose import Array, Pose

ROWS_APART = 16
"""Step between the rows of a frame that are compared with those of the frame before."""


@dataclass(frozen=True)
class Robust:
    """Parameters of `robust`: its config. What differs between sequences is learned from their frames."""

    config: RobustConfig = field(default_factory=RobustConfig)

    def start(self, structure: Structure, camera: Camera, cam_from_world: Pose, rng: np.random.Generator) -> Run:
        """Start a run from an initial pose; UserError when that pose is not finite."""
        if not np.isfinite(cam_from_world.matrix).all():
            raise UserError("the initial pose is not finite; give numbers")
        prepare(__name__)
        return RobustRun(structure, camera, cam_from_world, rng, self.config)


class Frame(NamedTuple):
    """An image before and after preprocessing, and the predicted motion.

    dt_s is the time since the last frame that was ok, step_s that since the last one, extrapolated_s the part of dt_s
    over which the prediction is the motion model's own guess.
    """

    raw: Image
    image: Image
    predicted: Motion
    dt_s: float
    step_s: float
    extrapolated_s: float


class Photometry(NamedTuple):
    """State that depends on light and exposure: learned appearance of the edges, contrast stretch of images."""

    appearance: Array
    stretch: ContrastStretch


class FittedFrame(NamedTuple):
    """A fit and the frame, as it was preprocessed for that fit."""

    fit: Fit
    frame: Frame


class Decision(NamedTuple):
    """A fit, and whether it may be believed.

    settled: all poses that had to be tried before were. rivalled: they were, and another pose explains the frame about
    as well.
    """

    fit: Fit
    settled: bool
    rivalled: bool = False


class Tentative(NamedTuple):
    """The motion as it would be if an undecided frame's best fit were right, and that frame's stamp."""

    motion: Motion
    stamp_ns: int


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
        # That of an inverse is stored by columns, which the kernels do not take.
        cam_from_world = Pose(np.ascontiguousarray(cam_from_world.rotation), cam_from_world.translation)
        self.fitter = EdgeFitter(structure, camera, rng, config)
        self.relocator = Relocator(self.fitter, camera, config.relocalization)
        middle = structure.bounds.mean(axis=0, keepdims=True)
        self.range_m = float(np.linalg.norm(cam_from_world.transform(middle)))
        self.motion = Motion(cam_from_world, sigmas(config.initialization.sigma, self.range_m))
        self.ok_ns: int | None = None
        self.seen_ns: int | None = None
        self.seen_rows: Image | None = None
        self.ok_rows: Image | None = None
        self.stretch = ContrastStretch()
        self.usual_support = self.step_s = 0.0
        self.frames_ok = 0
        self.until_search = 0
        self.was_wrong = self.kept_initial = self.is_lost = False
        self.expected: Motion | None = None
        self.tentative: Tentative | None = None
        self.prediction_errors = PredictionErrors()

    def predict(self, cam_from_world: Pose, covariance: Array) -> None:
        """Take what the vehicle's filter expects of the next frame; the surer of it and the motion model counts there.

        Its covariance is widened: earlier poses of this run are in it, and must not count twice.
        """
        pose = Pose(np.ascontiguousarray(cam_from_world.rotation), np.ascontiguousarray(cam_from_world.translation))
        self.expected = Motion(pose, self.config.motion.expected_scale**2 * np.asarray(covariance))

    def track(self, image: Image, stamp_ns: int) -> TrackResult:
        """Estimate the pose of the next frame; `lost` also where the stamp goes back or the image is frozen.

        ImageError for an image of another size or type.
        """
        image = check_image(image, self.camera)
        clock = StageClock()
        expected, self.expected = self.expected, None
        if not self.comes_after(stamp_ns) or self.is_frozen(image):
            return TrackResult(status="lost")
        frame = self.prepared(image, stamp_ns, expected, clock)
        before = Photometry(self.fitter.appearance, self.stretch)
        fit = self.fitter.fit(frame.image, frame.predicted.cam_from_world, frame.predicted.covariance, clock)
        fit, frame = self.compensated(frame, fit, clock)
        fit, settled, rivalled = self.initialized_or_recovered(frame, fit, clock)
        fit = self.without_patches(frame, fit, clock)
        holds = fit.finite and (
            fit.support >= self.required_support(fit, frame.predicted) or self.is_there(fit, frame.predicted)
        )
        self.is_lost = not (settled and holds)
        if self.is_lost:
            self.fitter.appearance, self.stretch = before  # a wrong pose tells nothing of the light
            guess = (fit if fit.finite else frame.predicted).cam_from_world
            if self.ok_ns is not None and fit.finite and fit.support >= self.usual_or_good():
                self.tentative = Tentative(self.motion.update(guess, fit.covariance, frame.dt_s), stamp_ns)
            return TrackResult(
                status="ambiguous" if rivalled else "lost",
                guess=guess,
                stage_ms=clock.ms,
                control_points=fit.control_points,
                inliers=fit.inliers,
            )
        with clock.stage("learn"):
            self.learn(frame, fit, stamp_ns)
        return TrackResult(
            status="ok",
            cam_from_world=fit.cam_from_world,
            covariance=fit.covariance,
            stage_ms=clock.ms,
            control_points=fit.control_points,
            candidates=fit.candidates,
            inliers=fit.inliers,
        )

    def prepared(self, raw: Image, stamp_ns: int, expected: Motion | None, clock: StageClock) -> Frame:
        """A frame, stretched and smoothed as it needs, with the prediction."""
        dt_s = 0.0 if self.ok_ns is None else (stamp_ns - self.ok_ns) * 1e-9
        with clock.stage("denoise"):
            if self.ok_ns is None:
                self.stretch = ContrastStretch.needed(raw, self.config.preprocessing)
            stretched = self.stretch.of(raw)
            image = smoothed(stretched, self.config.preprocessing)
            self.fitter.begin(stamp_ns, self.step_s, image is stretched)
        with clock.stage("predict"):
            predicted = self.motion.predict(dt_s, self.range_m, self.config.motion)
            if self.tentative is not None:  # more likely than what was known before, but no surer
                since_s = (stamp_ns - self.tentative.stamp_ns) * 1e-9
                likely = self.tentative.motion.predict(since_s, self.range_m, self.config.motion)
                predicted = replace(predicted, cam_from_world=likely.cam_from_world)
            if expected is not None and expected.spread_m(self.range_m) < predicted.spread_m(self.range_m):
                return Frame(raw, image, expected, dt_s, self.step_s, 0.0)
        return Frame(raw, image, predicted, dt_s, self.step_s, dt_s)

    def compensated(self, frame: Frame, fit: Fit, clock: StageClock) -> FittedFrame:
        """Fit and frame after gain-offset compensation of the learned colours, where that is better supported."""
        config = self.config.preprocessing
        if self.ok_ns is None or fit.support >= self.usual_or_good():
            return FittedFrame(fit, frame)
        if self.ok_rows is None or self.seen_rows is None or self.ok_rows.shape != self.seen_rows.shape:
            return FittedFrame(fit, frame)
        stretch, ratio = (
            ContrastStretch.needed(frame.raw, config),
            brightness_ratio(self.seen_rows, self.ok_rows),
        )
        stretch = stretch if stretch.differs(self.stretch, config.min_gain) else self.stretch
        if stretch == self.stretch and (ratio == 1).all():
            return FittedFrame(fit, frame)
        colours, image = self.fitter.appearance, smoothed(stretch.of(frame.raw), config)
        self.fitter.appearance = compensated(colours, self.stretch.towards(stretch, ratio))
        other = self.fitter.fit(image, frame.predicted.cam_from_world, frame.predicted.covariance, clock)
        if other.finite and other.support > fit.support:
            self.stretch = stretch
            return FittedFrame(other, frame._replace(image=image))
        self.fitter.appearance = colours
        return FittedFrame(fit, frame)

    def initialized_or_recovered(self, frame: Frame, fit: Fit, clock: StageClock) -> Decision:
        """The fit at hand; on the first frame a prior-constrained one, and where support is low the best one found."""
        self.until_search -= 1
        first = self.ok_ns is None
        kept = self.prior_constrained(frame, fit, clock) if first and not self.relocator.under_way else None
        if kept is not None:
            self.kept_initial = True
            return Decision(kept, True)
        if not (first or self.search_is_due(frame, fit) or not fit.finite):
            self.relocator.forget()
            return self.confirmed(frame, fit, clock)
        with clock.stage("relocalize"):
            found = self.recover(frame, fit)
        self.was_wrong |= first and found.settled and found.fit is not fit
        if found.settled and not self.relocator.under_way:
            self.until_search = 0 if found.fit is not fit else self.config.loss.search_every
        return found

    def confirmed(self, frame: Frame, fit: Fit, clock: StageClock) -> Decision:
        """The fit; where motion was extrapolated for long, held against the places that look alike."""
        if not self.is_slow(frame):
            return Decision(fit, True)
        with clock.stage("relocalize"):
            guess, covariance = frame.predicted.cam_from_world, frame.predicted.covariance
            scale = self.prediction_errors.scale
            found = self.relocator.confirm(
                Sought(frame.image, [guess], covariance, self.range_m, fit, prediction_scale=scale)
            )
        return Decision(found.fit, found.leads, not found.leads)

    def search_is_due(self, frame: Frame, fit: Fit) -> bool:
        """Whether a fit's support is too low to do without a pose search."""
        loss, slow = self.config.loss, self.is_slow(frame)
        doubted = self.was_wrong and self.frames_ok < self.config.initialization.young_frames
        wanted = self.usual_or_good() if slow else self.config.relocalization.good_support
        if fit.support >= (self.config.initialization.doubted_support if doubted else wanted):
            return False
        due = self.until_search < 0 or self.relocator.under_way
        return doubted or slow or due or not fit.support >= loss.min_support

    def usual_or_good(self) -> float:
        """The larger of a good support and a part of the usual one."""
        return max(self.config.relocalization.good_support, self.config.loss.slow_part * self.usual_support)

    def is_slow(self, frame: Frame) -> bool:
        """Whether motion was extrapolated for so long that a neighbouring edge may be fitted."""
        return frame.extrapolated_s >= self.config.loss.slow_s

    def learn(self, frame: Frame, fit: Fit, stamp_ns: int) -> None:
        """Update appearance, patches, biases, motion and the usual support with the fit of a frame."""
        self.fitter.learn(frame.image, fit, frame.dt_s)
        rate = self.config.edges.appearance.learning_rate
        if self.ok_ns is not None:
            self.prediction_errors = self.prediction_errors.updated(frame.predicted, fit.cam_from_world, rate)
        self.motion = self.motion.update(fit.cam_from_world, fit.covariance, frame.dt_s)
        self.usual_support += max(rate, 1 / (1 + self.frames_ok)) * (fit.support - self.usual_support)
        self.ok_rows, self.tentative = self.seen_rows, None
        self.ok_ns, self.range_m, self.frames_ok = stamp_ns, fit.range_m, self.frames_ok + 1

    def required_support(self, fit: Fit, predicted: Motion) -> float:
        """Support that a fit needs: far from the prediction nearly as much as usual."""
        loss = self.config.loss
        if self.ok_ns is None:
            return self.config.initialization.min_support
        far = not fit.support >= self.usual_support and predicted.squared_mahalanobis(fit.cam_from_world) > FAR_CHI2
        return max(loss.min_support, loss.far_part * self.usual_support if far or self.is_lost else 0.0)

    def is_there(self, fit: Fit, predicted: Motion) -> bool:
        """Whether a track goes on since chance would not find so many edges where they are predicted."""
        if self.ok_ns is None or self.is_lost or predicted.squared_mahalanobis(fit.cam_from_world) > FAR_CHI2:
            return False
        solver, half_px = self.config.solver, self.config.edges.search.fine_half_px
        width_px, tests = solver.estimator.fine_widths_px[-1], solver.hypotheses.count
        return log10_false_alarms(fit, width_px, half_px, tests) < self.config.loss.log10_false_alarms

    def prior_constrained(self, frame: Frame, fit: Fit, clock: StageClock) -> Fit | None:
        """A fit constrained to the initial pose; None where another one has clearly more support."""
        initial = self.config.initialization
        half_px = self.config.relocalization.refit_half_px
        least = max(initial.min_support, fit.support - self.config.loss.advantage)
        narrow = sigmas(initial.kept_sigma, self.range_m)
        kept = self.fitter.fit(frame.image, self.motion.cam_from_world, narrow, clock, half_px)
        if not (kept.finite and kept.support >= least):
            return None
        sure = max(self.config.relocalization.good_support, kept.edge_support)  # patches are taken there at once
        return replace(kept, edge_support=sure)

    def recover(self, frame: Frame, fit: Fit) -> Decision:
        """The best fit of a slice of the search around the prediction and the last pose, or the fit at hand."""
        loss, predicted, covariance = self.config.loss, frame.predicted.cam_from_world, frame.predicted.covariance
        if self.frames_ok < self.config.initialization.young_frames and not self.kept_initial:
            covariance = covariance + sigmas(self.config.relocalization.guess_sigma, self.range_m)
        first, slow = self.ok_ns is None, self.is_slow(frame)
        guesses = [predicted] if first else [predicted, self.motion.cam_from_world]
        if frame.step_s >= loss.slow_s:
            self.relocator.forget()
        sure = np.inf if first else self.usual_or_good()
        scale = self.prediction_errors.scale
        found = self.relocator.search(Sought(frame.image, guesses, covariance, self.range_m, fit, sure, scale))
        enough = found.fit.support >= self.required_support(found.fit, frame.predicted)
        # Frames far apart: another place that looks the same may have as much support as usual.
        is_sure = found.fit.support >= sure and (found.leads or not slow or found.fit is fit)
        rivalled = enough and found.near_done and not found.leads and not is_sure
        settled = not rivalled and (is_sure or found.all_done or (found.near_done and enough))
        if settled or found.all_done:
            self.relocator.forget()
        given = self.motion.squared_mahalanobis(fit.cam_from_world) < FAR_CHI2
        holds = given if first else fit.support >= loss.min_support
        if settled and found.advantage > (loss.advantage if holds and not slow else 0.0):
            return Decision(found.fit, True)
        tracked = not first and not slow and not self.is_lost
        if settled or (tracked and (holds or self.is_there(fit, frame.predicted))):
            return Decision(fit, True)
        return Decision(found.fit, False, rivalled)

    def without_patches(self, frame: Frame, fit: Fit, clock: StageClock) -> Fit:
        """The fit; that of the edges alone where they contradict the patches and are clearly better supported so."""
        loss, relocalization = self.config.loss, self.config.relocalization
        contradict = fit.edge_support < min(loss.min_support, fit.support)
        room = self.fitter.work.left >= self.fitter.largest_fit
        if not (contradict and room and fit.control_points >= MIN_POINTS):
            return fit
        with clock.stage("relocalize"):
            kept, self.fitter.texture = (
                self.fitter.texture,
                Texture(self.fitter.edges, self.camera, self.fitter.view, self.config),
            )
            self.fitter.texture.now_s = kept.now_s
            narrow = sigmas(relocalization.fitted_sigma, self.range_m)
            alone = self.fitter.fit(frame.image, fit.cam_from_world, narrow, clock, relocalization.refit_half_px)
            if alone.finite and alone.support >= max(loss.min_support, fit.edge_support + loss.advantage):
                return alone
            self.fitter.texture = kept
            return fit

    def comes_after(self, stamp_ns: int) -> bool:
        """Whether a frame is later than those before it; remembers its stamp."""
        later = self.seen_ns is None or stamp_ns > self.seen_ns
        self.step_s = 0.0 if self.seen_ns is None else (stamp_ns - self.seen_ns) * 1e-9
        self.seen_ns = stamp_ns if later else self.seen_ns
        return later

    def is_frozen(self, image: Image) -> bool:
        """Whether a frame equals the one before it to the bit; remembers some of its rows."""
        last, self.seen_rows = self.seen_rows, image[::ROWS_APART].copy()
        return last is not None and np.array_equal(last, self.seen_rows)
