"""`robust`: prediction, hidden-line removal, learned edge appearance, hypotheses, M-estimation, loss and recovery."""

from dataclasses import dataclass, replace

import numpy as np

from uavbench.scenes.camera import Camera
from uavbench.scenes.structure import Structure
from uavbench.tracker.geometry_kernels import inverse6
from uavbench.tracker.protocol import Image, Run, TrackResult, check_image
from uavbench.tracker.robust.edge_fit import SURE_SUPPORT, EdgeFitter
from uavbench.tracker.robust.motion_model import Motion
from uavbench.tracker.robust.patches.patches import Texture
from uavbench.tracker.robust.pose_fit import Fit
from uavbench.tracker.robust.preprocessing.denoising import smoothed
from uavbench.tracker.robust.preprocessing.gain_offset import Stretch, light_change, relit
from uavbench.tracker.robust.relocalization.relocate import (
    AWAY_SIGMA,
    FITTED_SIGMA,
    GOOD_SUPPORT,
    REFIT_HALF_PX,
    Relocator,
    sigmas,
)
from uavbench.tracker.stage_clock import StageClock
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.kernels.warm_up import prepare
from uavbench.trajectories.pose import Array, Pose

YOUNG_FRAMES, DOUBTED_SUPPORT = 5, 0.68
"""A run does not trust its first predictions, nor, where the given pose was wrong, fits with less support than this."""
SEARCH_EVERY = 8
"""Frames from a search that found nothing better to the next, while the support is enough."""
ENOUGH_SUPPORT = 0.5
"""With less than this the track is lost."""
SLOW_S, USUAL_PART = 0.3, 0.92
"""Frames farther apart may be fitted to a neighbouring edge: with less than this part of the usual support, poses are
searched each time, and the best supported one is taken."""
USUAL_RATE, FAR_PART, FOUND_PART = 0.1, 0.8, 0.7
"""Rate at which the usual support is learned; part of it that a pose needs which lies far from the prediction, and the
first one after a loss.

Of a bridge that was found again one panel too far 0.55 to 0.64 are seen, of one at its true place 0.8.
"""
FIRST_SUPPORT, GIVEN_SUPPORT = 0.4, 0.3
"""What the first frame needs, whose appearance nobody knows yet, and where it fits the pose that was given."""
ADVANTAGE = 0.1
GIVEN_MISFIT = 12.6
"""Support by which another pose must exceed a fit that holds: one with enough, or that lies where it was given.

Where it was given: within the squared distance in standard deviations that 95 % of right poses keep (chi-square, six
degrees of freedom).
"""
EDGES_CONTRADICT, ENOUGH_EDGES = 0.5, 30
"""With less edge support than this, and so many control points, patches may have been taken on what stands before the
structure and carry the pose away."""
HELD_SIGMAS, HELD_HALF_PX = (0.0003, 0.001), 12.0
"""Fits that stay where the first pose was given, the stillest first, and half the length of their search lines.

Measured on 22 first frames with the latter, colours not known yet: the support is 0.36 to 0.81 at the true pose, 0.29
to 0.78 beside it by 0.3 % of the range and 0.3 degrees, and 0.04 to 0.28 beside it by 1 % and more.
"""
HELD_ADVANTAGE = 0.15
"""Support by which the fit that may move must exceed one that stays."""
RIGHT_SIGMA = 0.001
"""One standard deviation of a given first pose that held, in parts of the range and in rad."""
ROWS_APART = 16
"""Every such row of a frame is compared with those of the frame before."""
FIRST_SIGMA = 0.005
"""One standard deviation of a given first pose, in parts of the range and in rad."""


@dataclass(frozen=True)
class Robust:
    """Parameters of `robust`: none; what differs between sequences is learned from their frames."""

    def start(self, structure: Structure, camera: Camera, cam_from_world: Pose, rng: np.random.Generator) -> Run:
        """Begin a run near a first pose; UserError when that pose is not finite."""
        if not np.isfinite(cam_from_world.matrix).all():
            raise UserError("the first pose is not finite; give numbers")
        prepare(__name__)
        return RobustRun(structure, camera, cam_from_world, rng)


class RobustRun:
    """A run of `robust`."""

    def __init__(self, structure: Structure, camera: Camera, cam_from_world: Pose, rng: np.random.Generator) -> None:
        self.camera = camera
        self.fitter = EdgeFitter(structure, camera, rng)
        self.relocator = Relocator.of(self.fitter, camera)
        middle = structure.bounds.mean(axis=0, keepdims=True)
        self.range_m = float(np.linalg.norm(cam_from_world.transform(middle)))
        self.motion = Motion(cam_from_world, sigmas(FIRST_SIGMA, self.range_m))
        self.ok_ns: int | None = None
        self.seen_ns: int | None = None
        self.seen_rows: Image | None = None
        self.ok_rows: Image | None = None
        self.stretch = Stretch()
        self.support = self.usual_support = 0.0
        self.frames_ok = 0
        self.until_search = 0
        self.was_wrong = self.held_first = self.is_lost = False

    def track(self, image: Image, stamp_ns: int) -> TrackResult:
        """Estimate at the next frame; `lost` too for a stamp that goes back and a frozen image.

        ImageError for an image of another size or type.
        """
        check_image(image, self.camera)
        clock = StageClock()
        if not self.comes_after(stamp_ns) or self.is_frozen(image):
            return TrackResult(status="lost")
        dt_s = 0.0 if self.ok_ns is None else (stamp_ns - self.ok_ns) * 1e-9
        with clock.stage("denoise"):
            self.stretch = Stretch.needed(image) if self.ok_ns is None else self.stretch
            raw, stretched = image, self.stretch.of(image)
            image = smoothed(stretched)
            self.fitter.begin(stamp_ns, image is stretched)
        with clock.stage("predict"):
            predicted, covariance = self.motion.predict(dt_s, self.range_m)
        fit = self.fitter.fit(image, predicted, covariance, clock)
        colours, stretch = self.fitter.appearance, self.stretch
        if self.ok_ns is not None and not fit.support >= max(GOOD_SUPPORT, USUAL_PART * self.usual_support):
            fit, image = self.in_other_light(raw, image, predicted, covariance, fit, clock)
        self.until_search -= 1
        doubted = self.was_wrong and self.frames_ok < YOUNG_FRAMES
        slow = dt_s >= SLOW_S
        wanted = max(GOOD_SUPPORT, USUAL_PART * self.usual_support) if slow else GOOD_SUPPORT
        good = fit.support >= (DOUBTED_SUPPORT if doubted else wanted)
        due = not good and (doubted or slow or self.until_search < 0 or not fit.support >= ENOUGH_SUPPORT)
        held = self.held(image, fit, clock) if self.ok_ns is None else None
        if held is not None:
            fit, self.held_first = held, True
        elif self.ok_ns is None or due or not fit.finite:
            with clock.stage("recover"):
                better = self.recover(image, predicted, covariance, fit, slow)
            self.was_wrong |= self.ok_ns is None and better is not fit
            self.until_search = 0 if better is not fit else SEARCH_EVERY
            fit = better
        if fit.edge_support < min(EDGES_CONTRADICT, fit.support) and fit.control_points >= ENOUGH_EDGES:
            with clock.stage("recover"):
                fit = self.without_patches(image, fit, clock)
        self.support = fit.support
        expected = Motion(predicted, covariance)
        self.is_lost = not (fit.finite and fit.support >= self.enough(fit, expected))
        if self.is_lost:
            self.fitter.appearance, self.stretch = colours, stretch  # nobody knows the light of a view that is not this
            return TrackResult(status="lost", stage_ms=clock.ms, control_points=fit.control_points, inliers=fit.inliers)
        with clock.stage("learn"):
            self.fitter.learn(image, fit, dt_s)
        self.motion = self.motion.update(fit.cam_from_world, fit.covariance, dt_s)
        self.usual_support += max(USUAL_RATE, 1 / (1 + self.frames_ok)) * (fit.support - self.usual_support)
        self.ok_rows = self.seen_rows
        self.ok_ns, self.range_m, self.frames_ok = stamp_ns, fit.range_m, self.frames_ok + 1
        return TrackResult(
            status="ok",
            cam_from_world=fit.cam_from_world,
            covariance=fit.covariance,
            stage_ms=clock.ms,
            control_points=fit.control_points,
            candidates=fit.candidates,
            inliers=fit.inliers,
        )

    def in_other_light(
        self, raw: Image, image: Image, predicted: Pose, covariance: Array, fit: Fit, clock: StageClock
    ) -> tuple[Fit, Image]:
        """Fit and stretched image, the learned colours taken to the light of now where that is better supported."""
        if self.ok_rows is None or self.seen_rows is None or self.ok_rows.shape != self.seen_rows.shape:
            return fit, image
        stretch, ratio = Stretch.needed(raw), light_change(self.seen_rows, self.ok_rows)
        stretch = stretch if stretch.differs(self.stretch) else self.stretch
        if stretch == self.stretch and (ratio == 1).all():
            return fit, image
        colours, other_image = self.fitter.appearance, smoothed(stretch.of(raw))
        self.fitter.appearance = relit(colours, *self.stretch.towards(stretch, ratio))
        other = self.fitter.fit(other_image, predicted, covariance, clock)
        if other.finite and other.support > fit.support:
            self.stretch = stretch
            return other, other_image
        self.fitter.appearance = colours
        return fit, image

    def enough(self, fit: Fit, expected: Motion) -> float:
        """Support that a fit needs: far from where the camera is expected nearly as much as usual."""
        if self.ok_ns is not None:
            far = not fit.support >= self.usual_support and expected.misfit(fit.cam_from_world) > GIVEN_MISFIT
            part = FAR_PART if far else FOUND_PART if self.is_lost else 0.0
            return max(ENOUGH_SUPPORT, part * self.usual_support)
        return GIVEN_SUPPORT if self.motion.misfit(fit.cam_from_world) < GIVEN_MISFIT else FIRST_SUPPORT

    def held(self, image: Image, fit: Fit, clock: StageClock) -> Fit | None:
        """The fit that stays where the first pose was given; None where another one has clearly more support."""
        for narrow in (sigmas(sigma, self.range_m) for sigma in HELD_SIGMAS):
            held = self.fitter.fit(image, self.motion.cam_from_world, narrow, clock, HELD_HALF_PX)
            if held.finite and held.support >= max(GIVEN_SUPPORT, fit.support - HELD_ADVANTAGE):
                break
        else:
            return None
        right = inverse6(sigmas(RIGHT_SIGMA, self.range_m))
        information = inverse6(held.covariance) - inverse6(narrow) + right
        evidence = held.evidence and replace(held.evidence, prior=right)
        sure = max(SURE_SUPPORT, held.edge_support)  # patches are taken there at once
        return replace(held, covariance=inverse6(information), edge_support=sure, evidence=evidence)

    def recover(self, image: Image, predicted: Pose, covariance: Array, fit: Fit, slow: bool = False) -> Fit:
        """The best fit around the prediction and the last pose, if it is better than the fit at hand."""
        if self.frames_ok < YOUNG_FRAMES and not self.held_first:
            covariance = covariance + sigmas(AWAY_SIGMA, self.range_m)
        guesses = [predicted] if self.ok_ns is None else [predicted, self.motion.cam_from_world]
        best, advantage = self.relocator.best(image, guesses, covariance, self.range_m, fit)
        fits_given = self.ok_ns is None and self.motion.misfit(fit.cam_from_world) < GIVEN_MISFIT
        holds = fits_given or (self.ok_ns is not None and fit.support >= ENOUGH_SUPPORT)
        return best if advantage > (ADVANTAGE if holds and not slow else 0.0) else fit

    def without_patches(self, image: Image, fit: Fit, clock: StageClock) -> Fit:
        """The fit of the edges alone, all patches forgotten, where they are clearly better supported then."""
        kept, self.fitter.texture = self.fitter.texture, Texture(self.fitter.map, self.camera)
        self.fitter.texture.now_s = kept.now_s
        alone = self.fitter.fit(image, fit.cam_from_world, sigmas(FITTED_SIGMA, self.range_m), clock, REFIT_HALF_PX)
        if alone.finite and alone.support >= max(ENOUGH_SUPPORT, fit.edge_support + ADVANTAGE):
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
