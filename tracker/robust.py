"""`robust`: prediction, hidden-line removal, learned edge appearance, hypotheses, M-estimation, loss and recovery."""

from dataclasses import dataclass

import cv2
import numpy as np

from scenes.camera import Camera
from scenes.structure import Structure
from tracker.base import Image, Run, TrackResult
from tracker.clock import StageClock
from tracker.edge_fit import EdgeFitter, Fit
from tracker.motion import Motion
from tracker.pose_search import PoseSearch, spread
from trajectories.errors import UserError
from trajectories.pose import Array, Pose

GOOD_SUPPORT = 0.6
"""With less support than this other poses are searched."""
YOUNG_FRAMES, YOUNG_SUPPORT = 5, 0.68
"""The first frames are searched again with less support than this: the given pose may have been wrong."""
ENOUGH_SUPPORT = 0.5
"""With less than this the track is lost; the first frame, whose appearance nobody knows yet, needs less."""
FIRST_SUPPORT = 0.4
FIRST_ADVANTAGE = 0.03
"""Support by which another pose must exceed the first pose that was given."""
FIRST_FITS = 40
SEARCH_FITS = 16
"""Poses of a search that are fitted, on the first frame and later."""
FIRST_SIGMA = 0.005
"""One standard deviation of a given first pose, in parts of the range and in rad."""
SEARCH_SIGMA = 0.06
"""The same of a pose found by search."""
FAR_COST = 0.02
"""Support that a pose needs more for each squared standard deviation that it lies from the prediction."""
SEARCH_SPREAD = spread(view_rad=0.4, roll_rad=0.12, range_part=0.25, shift_part=0.3)


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
        self.searcher = PoseSearch(self.fitter.map, camera)
        middle = structure.bounds.mean(axis=0, keepdims=True)
        self.range_m = float(np.linalg.norm(cam_from_world.transform(middle)))
        self.motion = Motion(cam_from_world, self.covariance(FIRST_SIGMA))
        self.ok_ns: int | None = None
        self.seen_ns: int | None = None
        self.support = 0.0
        self.frames_ok = 0

    def track(self, image: Image, stamp_ns: int) -> TrackResult:
        """Estimate at the next frame; `lost` too for an image of another size and a stamp that goes back."""
        clock = StageClock()
        if image.shape[:2] != (self.camera.height, self.camera.width) or not self.comes_after(stamp_ns):
            return TrackResult(status="lost")
        image = colour(image)
        dt_s = 0.0 if self.ok_ns is None else (stamp_ns - self.ok_ns) * 1e-9
        with clock.stage("predict"):
            predicted, covariance = self.motion.predict(dt_s, self.range_m)
        fit = self.fitter.fit(image, predicted, covariance, clock)
        young = self.frames_ok < YOUNG_FRAMES
        if self.ok_ns is None or not fit.support >= (YOUNG_SUPPORT if young else GOOD_SUPPORT):
            with clock.stage("recover"):
                fit = self.recover(image, predicted, covariance, fit)
        self.support = fit.support
        if not (fit.support >= (FIRST_SUPPORT if self.ok_ns is None else ENOUGH_SUPPORT) and fit.finite):
            return TrackResult(status="lost", stage_ms=clock.ms, control_points=fit.control_points, inliers=fit.inliers)
        with clock.stage("learn"):
            self.fitter.learn(image, fit)
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

    def recover(self, image: Image, predicted: Pose, covariance: Array, fit: Fit) -> Fit:
        """The best supported fit among the poses around the prediction and the last pose that agree with the image."""
        clock = StageClock()
        wide = self.covariance(SEARCH_SIGMA)
        information = np.linalg.inv(covariance + wide if self.frames_ok < YOUNG_FRAMES else covariance)

        def score(candidate: Fit) -> float:
            away = (candidate.cam_from_world @ predicted.inverse()).log()
            return candidate.support - FAR_COST * float(away @ information @ away)

        guesses = [predicted] if self.ok_ns is None else [predicted, self.motion.cam_from_world]
        most = FIRST_FITS if self.ok_ns is None else SEARCH_FITS
        found = [pose for _, pose in self.searcher.best_poses(image, guesses, SEARCH_SPREAD, most)]
        fits = [self.fitter.fit(image, pose, wide, clock, 28.0) for pose in [*guesses, *found]]
        fits += [
            self.fitter.fit(image, other.cam_from_world, self.covariance(FIRST_SIGMA), clock, 12.0)
            for other in sorted(fits, key=score)[-4:]
            if other.finite
        ]
        best = max([fit, *(other for other in fits if other.finite)], key=score)
        return best if score(best) > score(fit) + (FIRST_ADVANTAGE if self.ok_ns is None else 0.0) else fit

    def covariance(self, sigma: float) -> Array:
        """Covariance (6, 6) of a pose known to sigma, in parts of the range and in rad."""
        return np.diag([(sigma * self.range_m) ** 2] * 3 + [sigma**2] * 3)

    def comes_after(self, stamp_ns: int) -> bool:
        """Whether a frame is later than those before it; remembers its stamp."""
        later = self.seen_ns is None or stamp_ns > self.seen_ns
        self.seen_ns = stamp_ns if later else self.seen_ns
        return later


def colour(image: Image) -> Image:
    """BGR image (h, w, 3) of a BGR or grey one, contiguous."""
    if image.ndim == 2:
        return np.asarray(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR), dtype=np.uint8)
    return np.ascontiguousarray(image)
