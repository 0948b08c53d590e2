"""`robust`: prediction, hidden-line removal, learned edge appearance, hypotheses, M-estimation, loss and recovery."""

from dataclasses import dataclass

import numpy as np

from scenes.camera import Camera
from scenes.structure import Structure
from tracker.base import Image, Run, TrackResult
from tracker.clock import StageClock
from tracker.edge_fit import EdgeFitter, Fit
from tracker.motion import Motion
from tracker.pose_search import PoseSearch, spread
from trajectories.errors import UserError
from trajectories.pose import Pose

GOOD_SUPPORT = 0.65
"""With less support than this other poses are searched."""
ENOUGH_SUPPORT = 0.55
"""With less than this the track is lost."""
SEARCH_FITS = 16
"""Poses of a search that are fitted."""


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
        self.motion = Motion(cam_from_world, np.diag([0.01**2] * 3 + [0.01**2] * 3))
        self.stamp_ns: int | None = None
        self.range_m = float(np.linalg.norm(cam_from_world.transform(structure.bounds.mean(axis=0, keepdims=True))))

    def track(self, image: Image, stamp_ns: int) -> TrackResult:
        """Estimate at the next frame."""
        image = image if image.ndim == 3 else image[..., None]
        clock = StageClock()
        dt = 0.0 if self.stamp_ns is None else (stamp_ns - self.stamp_ns) * 1e-9
        with clock.stage("predict"):
            predicted, covariance = self.motion.predict(dt, self.range_m)
        fit = self.fitter.fit(image, predicted, covariance, clock)
        if not fit.support >= GOOD_SUPPORT:
            with clock.stage("recover"):
                fit = self.recover(image, predicted, fit)
        self.support = fit.support
        if not fit.support >= ENOUGH_SUPPORT:
            self.stamp_ns = stamp_ns
            return TrackResult(status="lost", stage_ms=clock.ms)
        with clock.stage("learn"):
            self.fitter.learn(image, fit)
        self.motion = self.motion.update(fit.cam_from_world, fit.covariance, dt)
        self.stamp_ns, self.range_m = stamp_ns, fit.range_m
        return TrackResult(
            status="ok",
            cam_from_world=fit.cam_from_world,
            covariance=fit.covariance,
            stage_ms=clock.ms,
            control_points=fit.control_points,
            candidates=fit.candidates,
            inliers=fit.inliers,
        )

    def recover(self, image: Image, predicted: Pose, fit: Fit) -> Fit:
        """The best supported fit among the poses around the prediction and the last pose that agree with the image."""
        clock = StageClock()
        found = self.searcher.best_poses(
            image, [predicted, self.motion.cam_from_world], spread(0.4, 0.12, 0.25, 0.3), SEARCH_FITS
        )
        sigma = np.diag([(0.06 * self.range_m) ** 2] * 3 + [0.06**2] * 3)
        for _, pose in found:
            other = self.fitter.fit(image, pose, sigma, clock, 28.0)
            if other.support > fit.support:
                fit = other
        return fit
