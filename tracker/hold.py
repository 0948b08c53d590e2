"""`hold`: repeats the first pose, the floor that every other variant must beat."""

from dataclasses import dataclass

import numpy as np

from scenes.camera import Camera
from scenes.structure import Structure
from tracker.base import Image, Run, TrackResult
from trajectories.pose import Pose


@dataclass(frozen=True)
class Hold:
    """Parameters of `hold`: none."""

    def start(self, structure: Structure, camera: Camera, cam_from_world: Pose, rng: np.random.Generator) -> Run:
        """Begin a run at the pose that will be repeated."""
        return HoldRun(cam_from_world)


@dataclass(frozen=True)
class HoldRun:
    """A run of `hold`."""

    cam_from_world: Pose

    def track(self, image: Image, stamp_ns: int) -> TrackResult:
        """The first pose again."""
        return TrackResult(status="ok", cam_from_world=self.cam_from_world)
