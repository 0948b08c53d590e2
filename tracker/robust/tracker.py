"""`robust`: prediction, hidden-line removal, learned edge appearance, hypotheses, M-estimation, loss and recovery."""

from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from uavbench.scenes.camera import Camera
from uavbench.scenes.structure import Structure
from uavbench.tracker.geometry_kernels import inverse6
from uavbench.tracker.protocol import Image, Run, TrackResult, check_image
from uavbench.tracker.robust.config import RobustConfig
from uavbench.tracker.robust.edge_fit import EdgeFitter
from uavbench.tracker.robust.motion_model import Motion
from uavbench.tracker.robust.patches.patches import Texture
from uavbench.tracker.robust.pose_fit import Fit
from uavbench.tracker.robust.preprocessing.denoising import smoothed
from uavbench.tracker.robust.preprocessing.gain_offset import Stretch, light_change, relit
from uavbench.tracker.robust.relocalization.relocate import Relocator, sigmas
from uavbench.tracker.stage_clock import StageClock
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.kernels.warm_up import prepare
from uavbench.trajectories.pose import Array, Pose

ROWS_APART = 16
"""Every such row of a frame is compared with those of the frame before."""


@dataclass(frozen=True)
class Robust:
    """Parameters of `robust`: its config; what differs between sequences is learned from their frames."""

    config: RobustConfig = field(default_factory=RobustConfig)

    def start(self, structure: Structure, camera: Camera, cam_from_world: Pose, rng: np.random.Generator) -> Run:
        """Begin a run near a first pose; UserError when that pose is not finite."""
        if not np.isfinite(cam_from_world.matrix).all():
            raise UserError("the first pose is not finite; give numbers")
        prepare(__name__)
        return RobustRun(structure, camera, cam_from_world, rng, self.config)


class Frame(NamedTuple):
    """An image as it came and as it is measured in, and the pose that is expected."""

    raw: Image
    image: Image
    expected: Motion
    dt_s: float


class Light(NamedTuple):
    """What the light decides: the learned appearance of the edges, and the contrast stretch of images."""

    appearance: Array
    stretch: Stretch


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
        self.relocator = Relocator.of(self.fitter, camera, config.relocalization)
        middle = structure.bounds.mean(axis=0, keepdims=True)
        self.range_m = float(np.linalg.norm(cam_from_world.transform(middle)))
        self.motion = Motion(cam_from_world, sigmas(config.initialization.sigma, self.range_m))
        self.ok_ns: int | None = None
        self.seen_ns: int | None = None
        self.seen_rows: Image | None = None
        self.ok_rows: Image | None = None
        self.stretch = Stretch()
        self.usual_support = 0.0
        self.frames_ok = 0
        self.until_search = 0
        self.was_wrong = self.held_first = self.is_lost = False

    def track(self, image: Image, stamp_ns: int) -> TrackResult:
        """Estimate at the next frame; `lost` too for a stamp that goes back and a frozen image.

        ImageError for an image of another size or type.
        """
        image = check_image(image, self.camera)
        clock = StageClock()
        if not self.comes_after(stamp_ns) or self.is_frozen(image):
            return TrackResult(status="lost")
        frame = self.prepared(image, stamp_ns, clock)
        light = Light(self.fitter.appearance, self.stretch)
        fit = self.fitter.fit(frame.image, frame.expected.cam_from_world, frame.expected.covariance, clock)
        fit, frame = self.in_other_light(frame, fit, clock)
        fit = self.kept_or_recovered(frame, fit, clock)
        fit = self.without_patches(frame, fit, clock)
        self.is_lost = not (fit.finite and fit.support >= self.enough(fit, frame.expected))
        if self.is_lost:
            self.fitter.appearance, self.stretch = light  # nobody knows the light of a view that is not this
            return TrackResult(status="lost", stage_ms=clock.ms, control_points=fit.control_points, inliers=fit.inliers)
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

    def prepared(self, raw: Image, stamp_ns: int, clock: StageClock) -> Frame:
        """A frame, stretched and smoothed as it needs, with the pose that is expected."""
        dt_s = 0.0 if self.ok_ns is None else (stamp_ns - self.ok_ns) * 1e-9
        with clock.stage("denoise"):
            if self.ok_ns is None:
                self.stretch = Stretch.needed(raw, self.config.preprocessing)
            stretched = self.stretch.of(raw)
            image = smoothed(stretched, self.config.preprocessing)
            self.fitter.begin(stamp_ns, image is stretched)
        with clock.stage("predict"):
            expected = Motion(*self.motion.predict(dt_s, self.range_m, self.config.motion))
        return Frame(raw, image, expected, dt_s)

    def in_other_light(self, frame: Frame, fit: Fit, clock: StageClock) -> tuple[Fit, Frame]:
        """Fit and frame, the learned colours taken to the light of now where that is better supported."""
        config = self.config.preprocessing
        if self.ok_ns is None or fit.support >= self.usual_or_good():
            return fit, frame
        if self.ok_rows is None or self.seen_rows is None or self.ok_rows.shape != self.seen_rows.shape:
            return fit, frame
        stretch, ratio = Stretch.needed(frame.raw, config), light_change(self.seen_rows, self.ok_rows, config)
        stretch = stretch if stretch.differs(self.stretch, config.min_gain) else self.stretch
        if stretch == self.stretch and (ratio == 1).all():
            return fit, frame
        colours, image = self.fitter.appearance, smoothed(stretch.of(frame.raw), config)
        self.fitter.appearance = relit(colours, *self.stretch.towards(stretch, ratio))
        other = self.fitter.fit(image, frame.expected.cam_from_world, frame.expected.covariance, clock)
        if other.finite and other.support > fit.support:
            self.stretch = stretch
            return other, frame._replace(image=image)
        self.fitter.appearance = colours
        return fit, frame

    def kept_or_recovered(self, frame: Frame, fit: Fit, clock: StageClock) -> Fit:
        """The fit at hand; at the first frame one that stays there, and where it is doubtful the best that is found."""
        self.until_search -= 1
        first = self.ok_ns is None
        kept = self.kept(frame, fit, clock) if first else None
        if kept is not None:
            self.held_first = True
            return kept
        if not (first or self.search_is_due(frame, fit) or not fit.finite):
            return fit
        with clock.stage("recover"):
            better = self.recover(frame, fit)
        self.was_wrong |= first and better is not fit
        self.until_search = 0 if better is not fit else self.config.loss.search_every
        return better

    def search_is_due(self, frame: Frame, fit: Fit) -> bool:
        """Whether a fit has too little support not to search for another pose."""
        loss, slow = self.config.loss, self.is_slow(frame)
        doubted = self.was_wrong and self.frames_ok < self.config.initialization.young_frames
        wanted = self.usual_or_good() if slow else self.config.relocalization.good_support
        if fit.support >= (self.config.initialization.doubted_support if doubted else wanted):
            return False
        return doubted or slow or self.until_search < 0 or not fit.support >= loss.min_support

    def usual_or_good(self) -> float:
        """Support that a fit has mostly, or a good one at least."""
        return max(self.config.relocalization.good_support, self.config.loss.slow_part * self.usual_support)

    def is_slow(self, frame: Frame) -> bool:
        """Whether a frame is so long after the one before that it may be fitted to a neighbouring edge."""
        return frame.dt_s >= self.config.loss.slow_s

    def learn(self, frame: Frame, fit: Fit, stamp_ns: int) -> None:
        """Take up what the fit of a frame says."""
        self.fitter.learn(frame.image, fit, frame.dt_s)
        smoothing, rate = self.config.motion.velocity_smoothing, self.config.loss.usual_rate
        self.motion = self.motion.update(fit.cam_from_world, fit.covariance, frame.dt_s, smoothing)
        self.usual_support += max(rate, 1 / (1 + self.frames_ok)) * (fit.support - self.usual_support)
        self.ok_rows = self.seen_rows
        self.ok_ns, self.range_m, self.frames_ok = stamp_ns, fit.range_m, self.frames_ok + 1

    def enough(self, fit: Fit, expected: Motion) -> float:
        """Support that a fit needs: far from where the camera is expected nearly as much as usual."""
        loss = self.config.loss
        if self.ok_ns is not None:
            far = not fit.support >= self.usual_support and expected.misfit(fit.cam_from_world) > loss.far_chi2
            part = loss.far_part if far else loss.found_part if self.is_lost else 0.0
            return max(loss.min_support, part * self.usual_support)
        initial = self.config.initialization
        return initial.kept_support if self.motion.misfit(fit.cam_from_world) < loss.far_chi2 else initial.min_support

    def kept(self, frame: Frame, fit: Fit, clock: StageClock) -> Fit | None:
        """The fit that stays at the initial pose; None where another one has clearly more support."""
        initial = self.config.initialization
        least = max(initial.kept_support, fit.support - initial.kept_advantage)
        for narrow in (sigmas(sigma, self.range_m) for sigma in (initial.tight_sigma, initial.loose_sigma)):
            kept = self.fitter.fit(frame.image, self.motion.cam_from_world, narrow, clock, initial.half_px)
            if kept.finite and kept.support >= least:
                break
        else:
            return None
        right = inverse6(sigmas(initial.kept_sigma, self.range_m))
        information = inverse6(kept.covariance) - inverse6(narrow) + right
        evidence = kept.evidence and replace(kept.evidence, prior=right)
        sure = max(self.config.patches.take_support, kept.edge_support)  # patches are taken there at once
        return replace(kept, covariance=inverse6(information), edge_support=sure, evidence=evidence)

    def recover(self, frame: Frame, fit: Fit) -> Fit:
        """The best fit around the prediction and the last pose, if it is better than the fit at hand."""
        loss, predicted, covariance = self.config.loss, frame.expected.cam_from_world, frame.expected.covariance
        if self.frames_ok < self.config.initialization.young_frames and not self.held_first:
            covariance = covariance + sigmas(self.config.relocalization.guess_sigma, self.range_m)
        guesses = [predicted] if self.ok_ns is None else [predicted, self.motion.cam_from_world]
        best, advantage = self.relocator.best(frame.image, guesses, covariance, self.range_m, fit)
        fits_given = self.ok_ns is None and self.motion.misfit(fit.cam_from_world) < loss.far_chi2
        holds = fits_given or (self.ok_ns is not None and fit.support >= loss.min_support)
        return best if advantage > (loss.advantage if holds and not self.is_slow(frame) else 0.0) else fit

    def without_patches(self, frame: Frame, fit: Fit, clock: StageClock) -> Fit:
        """The fit; that of the edges alone where they contradict the patches and are clearly better supported then."""
        loss, relocalization = self.config.loss, self.config.relocalization
        contradict = fit.edge_support < min(loss.contradicted_support, fit.support)
        if not (contradict and fit.control_points >= loss.contradicting_points):
            return fit
        with clock.stage("recover"):
            kept, self.fitter.texture = self.fitter.texture, Texture(self.fitter.map, self.camera, self.config.patches)
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
        self.seen_ns = stamp_ns if later else self.seen_ns
        return later

    def is_frozen(self, image: Image) -> bool:
        """Whether a frame is the one before it again, noise and all; remembers some of its rows."""
        last, self.seen_rows = self.seen_rows, image[::ROWS_APART].copy()
        return last is not None and np.array_equal(last, self.seen_rows)
