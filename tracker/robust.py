"""`robust`: prediction, hidden-line removal, learned edge appearance, hypotheses, M-estimation, loss and recovery."""

from dataclasses import dataclass

import numpy as np

from scenes.camera import Camera
from scenes.structure import Structure
from tracker.base import Image, Run, TrackResult
from tracker.clock import StageClock
from tracker.edge_fit import EdgeFitter, Fit
from tracker.motion import Motion
from tracker.relocate import AWAY_SIGMA, GOOD_SUPPORT, Relocator, sigmas
from trajectories.errors import UserError
from trajectories.pose import Array, Pose

YOUNG_FRAMES, DOUBTED_SUPPORT = 5, 0.68
"""A run does not trust its first predictions, nor, where the given pose was wrong, fits with less support than this."""
SEARCH_EVERY = 8
"""Frames from a search that found nothing better to the next, while the support is enough."""
ENOUGH_SUPPORT = 0.5
"""With less than this the track is lost."""
FIRST_SUPPORT, GIVEN_SUPPORT = 0.4, 0.3
"""What the first frame needs, whose appearance nobody knows yet, and where it fits the pose that was given."""
ADVANTAGE = 0.1
GIVEN_MISFIT = 12.6
"""Support by which another pose must exceed a fit that holds: one with enough, or that lies where it was given.

Where it was given: within the squared distance in standard deviations that 95 % of right poses keep (chi-square, six
degrees of freedom).
"""
FIRST_SIGMA = 0.005
"""One standard deviation of a given first pose, in parts of the range and in rad."""


@dataclass(frozen=True)
class Robust:
    """Parameters of `robust`: none; what differs between sequences is learned from their frames."""

    def start(self, structure: Structure, camera: Camera, cam_from_world: Pose, rng: np.random.Generator) -> Run:
        """Begin a run near a first pose; UserError when that pose is not finite."""
        if not np.isfinite(cam_from_world.matrix).all():
            raise UserError("the first pose is not finite; give numbers")
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
        self.support = 0.0
        self.frames_ok = 0
        self.until_search = 0
        self.was_wrong = False

    def track(self, image: Image, stamp_ns: int) -> TrackResult:
        """Estimate at the next frame; `lost` too for an image of another size and a stamp that goes back."""
        clock = StageClock()
        if image.shape[:2] != (self.camera.height, self.camera.width) or not self.comes_after(stamp_ns):
            return TrackResult(status="lost")
        dt_s = 0.0 if self.ok_ns is None else (stamp_ns - self.ok_ns) * 1e-9
        with clock.stage("predict"):
            predicted, covariance = self.motion.predict(dt_s, self.range_m)
        fit = self.fitter.fit(image, predicted, covariance, clock)
        self.until_search -= 1
        doubted = self.was_wrong and self.frames_ok < YOUNG_FRAMES
        good = fit.support >= (DOUBTED_SUPPORT if doubted else GOOD_SUPPORT)
        due = not good and (doubted or self.until_search < 0 or not fit.support >= ENOUGH_SUPPORT)
        if self.ok_ns is None or due or not fit.finite:
            with clock.stage("recover"):
                better = self.recover(image, predicted, covariance, fit)
            self.was_wrong |= self.ok_ns is None and better is not fit
            self.until_search = 0 if better is not fit else SEARCH_EVERY
            fit = better
        self.support = fit.support
        if not (fit.finite and fit.support >= self.enough(fit)):
            return TrackResult(status="lost", stage_ms=clock.ms, control_points=fit.control_points, inliers=fit.inliers)
        with clock.stage("learn"):
            self.fitter.learn(image, fit, dt_s)
        self.motion = self.motion.update(fit.cam_from_world, fit.covariance, dt_s)
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

    def enough(self, fit: Fit) -> float:
        """Support that a fit needs."""
        if self.ok_ns is not None:
            return ENOUGH_SUPPORT
        return GIVEN_SUPPORT if self.motion.misfit(fit.cam_from_world) < GIVEN_MISFIT else FIRST_SUPPORT

    def recover(self, image: Image, predicted: Pose, covariance: Array, fit: Fit) -> Fit:
        """The best fit around the prediction and the last pose, if it is better than the fit at hand."""
        if self.frames_ok < YOUNG_FRAMES:
            covariance = covariance + sigmas(AWAY_SIGMA, self.range_m)
        guesses = [predicted] if self.ok_ns is None else [predicted, self.motion.cam_from_world]
        best, advantage = self.relocator.best(image, guesses, covariance, self.range_m, fit)
        fits_given = self.ok_ns is None and self.motion.misfit(fit.cam_from_world) < GIVEN_MISFIT
        holds = fits_given or (self.ok_ns is not None and fit.support >= ENOUGH_SUPPORT)
        return best if advantage > (ADVANTAGE if holds else 0.0) else fit

    def comes_after(self, stamp_ns: int) -> bool:
        """Whether a frame is later than those before it; remembers its stamp."""
        later = self.seen_ns is None or stamp_ns > self.seen_ns
        self.seen_ns = stamp_ns if later else self.seen_ns
        return later
