"""A camera at a pose, as arrays for the compiled kernels."""

from typing import NamedTuple

import numpy as np

from uavbench.scenes.camera import Camera, camera_array
from uavbench.scenes.structure import Structure
from uavbench.tracker.visible_edges import near_depth, undistorted_bounds
from uavbench.trajectories.kernels.argument_types import named_tuple
from uavbench.trajectories.pose import Array, Pose


class View(NamedTuple):
    """Pose, camera and image of one view.

    R (3, 3), t (3,): cam_from_world; lens (11,): see `camera_array`; size_px (2,): width and height of the image;
    bounds_px (4,): smallest x, y and largest x, y of its undistorted border; near: least projected depth, in units of
    the model.
    """

    R: Array
    t: Array
    lens: Array
    size_px: Array
    bounds_px: Array
    near: float

    @classmethod
    def of(cls, camera: Camera, structure: Structure) -> "View":
        """View of a structure by a camera at the identity pose."""
        return cls(
            np.eye(3),
            np.zeros(3),
            camera_array(camera),
            np.array([camera.width, camera.height], dtype=np.float64),
            np.array(undistorted_bounds(camera)),
            near_depth(structure),
        )

    def at(self, pose: Pose) -> "View":
        """The same camera at a pose (cam_from_world)."""
        return self.to(np.array(pose.rotation, order="C"), np.array(pose.translation))

    def to(self, R: Array, t: Array) -> "View":
        """The same camera at cam_from_world (R, t), in writable arrays."""
        return View(R, t, self.lens, self.size_px, self.bounds_px, self.near)


VIEW = named_tuple(View, "f2! f1! f1! f1! f1! f0")
