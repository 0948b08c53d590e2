"""`hold`: repeats the initial pose, the floor that every other variant must beat."""

from dataclasses import dataclass, field

import numpy as np

from uavbench.scenes.camera import Camera
from uavbench.scenes.structure import Structure
from uavbench.tracker.protocol import Image, Run, StampOrder, TrackResult, check_image, check_start
from uavbench.trajectories.pose import Pose


@dataclass(frozen=True)
class Hold:
    """Parameters of `hold`: none."""

    def start(self, structure: Structure, camera: Camera, cam_from_world: Pose, rng: np.random.Generator) -> Run:
        """Start a run from the pose that will be repeated; StartError for inputs of another type, or no such pose."""
        return HoldRun(check_start(structure, camera, cam_from_world, rng), camera)


@dataclass(frozen=True)
class HoldRun:
    """A run of `hold`."""

    cam_from_world: Pose
    camera: Camera
    order: StampOrder = field(default_factory=StampOrder)

    def track(self, image: Image, stamp_ns: int) -> TrackResult:
        """The initial pose again; ImageError for an image of another size or type, StampError for no stamp."""
        check_image(image, self.camera)
        if not self.order.is_later(stamp_ns):
            return TrackResult(status="lost")
        return TrackResult(status="ok", cam_from_world=self.cam_from_world)
