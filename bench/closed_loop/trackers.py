"""Trackers for closed-loop flights only: the upper and lower bounds of all others."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Gt

from uavbench.scenes.camera import Camera
from uavbench.scenes.structure import Structure
from uavbench.tracker.protocol import Image, Run, Tracker, TrackResult
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.pose import Pose


@dataclass(frozen=True)
class GroundTruth:
    """The true pose of the camera at every frame, with claimed standard deviations as its parameters."""

    sigma_m: Annotated[float, Gt(0)] = 0.001
    sigma_deg: Annotated[float, Gt(0)] = 0.05

    def start(self, structure: Structure, camera: Camera, cam_from_world: Pose, rng: np.random.Generator) -> Run:
        """Raise UserError: the ground truth is known in closed loop only."""
        raise UserError("the tracker `truth` is for flights only: `uavbench fly`")

    def answer(self, true_cam_from_world: Pose) -> TrackResult:
        """The true pose as a result."""
        sigmas = np.repeat([self.sigma_m, np.radians(self.sigma_deg)], 3)
        return TrackResult(status="ok", cam_from_world=true_cam_from_world, covariance=np.diag(sigmas**2))


@dataclass(frozen=True)
class Blind:
    """Never returns a pose: the vehicle flies on its other sensors alone, the lower bound of every comparison."""

    def start(self, structure: Structure, camera: Camera, cam_from_world: Pose, rng: np.random.Generator) -> Run:
        """Start a run."""
        return BlindRun()


class BlindRun:
    """A run of `blind`."""

    def track(self, image: Image, stamp_ns: int) -> TrackResult:
        """A lost frame."""
        return TrackResult(status="lost")


FLIGHT_TRACKERS: dict[str, type[Tracker]] = {"truth": GroundTruth, "blind": Blind}
"""Name -> tracker for closed-loop flights."""
