"""A camera at a pose, as the compiled kernels take it."""

from typing import NamedTuple

import numpy as np

from uavbench.scenes.camera import Camera
from uavbench.tracker.geometry_kernels import camera_array
from uavbench.tracker.visible_edges import undistorted_bounds
from uavbench.trajectories.kernels.argument_types import named_tuple
from uavbench.trajectories.pose import Array, Pose

NEAR_M = 0.02
"""Points nearer to the camera's plane than this are not projected."""


class View(NamedTuple):
    """Pose, camera and image of one view.

    R (3, 3), t (3,) are cam_from_world; lens (11,) is of `camera_array`; size_px (2,) width and height of the image;
    bounds_px (4,) smallest x, y and largest x, y of its border without distortion; near_m the least depth of points
    that are projected.
    """

    R: Array
    t: Array
    lens: Array
    size_px: Array
    bounds_px: Array
    near_m: float

    @classmethod
    def of(cls, camera: Camera, near_m: float = NEAR_M) -> "View":
        """View of a camera at the identity."""
        return cls(
            np.eye(3),
            np.zeros(3),
            camera_array(camera),
            np.array([camera.width, camera.height], dtype=np.float64),
            np.array(undistorted_bounds(camera)),
            near_m,
        )

    def at(self, pose: Pose) -> "View":
        """The same camera at a pose (cam_from_world)."""
        return self._replace(R=np.array(pose.rotation), t=np.array(pose.translation))

    def to(self, R: Array, t: Array) -> "View":
        """The same camera at cam_from_world (R, t), arrays that can be written."""
        return self._replace(R=R, t=t)


VIEW = named_tuple(View, "f2! f1! f1! f1! f1! f0")
