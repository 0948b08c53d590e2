"""A camera at a pose, as arrays for the compiled kernels."""

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from uavbench.scenes.camera import Camera, camera_array
from uavbench.scenes.structure import Structure
from uavbench.tracker.visible_edges import near_depth, undistorted_bounds
from uavbench.trajectories.kernels.argument_types import named_tuple
from uavbench.trajectories.kernels.compiled import compiled, inlined
from uavbench.trajectories.kernels.lens import ImagePoint, project
from uavbench.trajectories.pose import Array, Pose

CLEAR_PX = 16.0
"""Least distance of what is looked for from masked pixels: what shows there, such as the border of an overlay, must be
in none of the pixels beside a control point (12 px along its edge) or in a patch."""
AT_ONCE = np.zeros(0)
NOTHING_MASKED = np.zeros((0, 0), dtype=np.float32)


class View(NamedTuple):
    """Pose, camera and image of one view.

    R (3, 3), t (3,): cam_from_world; lens (11,): see `camera_array`; size_px (2,): width and height of the image;
    bounds_px (4,): smallest x, y and largest x, y of its undistorted border; near: least projected depth, in units of
    the model; clear_px (h, w): distance of each pixel to the nearest masked one, (0, 0) where none is.
    sweep (6,): twist of the camera from one row's exposure to the next, (0,) where all are exposed at once; the pose is
    that at the middle row.
    """

    R: Array
    t: Array
    lens: Array
    size_px: Array
    bounds_px: Array
    near: float
    clear_px: NDArray[np.float32]
    sweep: Array

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
            clearance(camera),
            AT_ONCE,
        )

    def at(self, pose: Pose) -> "View":
        """The same camera at a pose (cam_from_world)."""
        return self.to(np.array(pose.rotation, order="C"), np.array(pose.translation))

    def to(self, R: Array, t: Array) -> "View":
        """The same camera at cam_from_world (R, t), in writable arrays."""
        return View(R, t, self.lens, self.size_px, self.bounds_px, self.near, self.clear_px, self.sweep)

    def swept(self, sweep: Array) -> "View":
        """The same camera, moving by a twist (6,) from one row to the next; (0,) for not at all."""
        return self._replace(sweep=sweep)

    def within_clearance(self, half_px: Array, pixels: Array, beside_px: float) -> Array:
        """Half lengths (n,) of search lines about pixels (n, 2), with no masked pixel within beside_px of any line."""
        if not self.clear_px.size:
            return half_px
        x, y = (pixels + 0.5).astype(np.int64).T
        free_px: Array = np.maximum(self.clear_px[y, x] - beside_px, 0.0)
        return np.asarray(np.minimum(half_px, free_px))


VIEW = named_tuple(View, "f2! f1! f1! f1! f1! f0 s2! f1!")
IMAGE_POINT = named_tuple(ImagePoint, "f0 f0")


def clearance(camera: Camera) -> NDArray[np.float32]:
    """Distance in px of each pixel (h, w) of a camera to the nearest masked one; (0, 0) where none is."""
    if not camera.masked:
        return NOTHING_MASKED
    return np.asarray(cv2.distanceTransform(camera.unmasked.view(np.uint8), cv2.DIST_L2, 5), dtype=np.float32)


@inlined
def placed(view: View, R: Array, t: Array) -> View:
    """The same camera at cam_from_world (R, t), for kernels."""
    return View(R, t, view.lens, view.size_px, view.bounds_px, view.near, view.clear_px, view.sweep)


@inlined(allocates=False)
def is_clear(u: float, v: float, view: View) -> bool:
    """Whether a pixel of the image is farther than CLEAR_PX from what is masked."""
    clear_px = view.clear_px
    return clear_px.size == 0 or clear_px[int(v + 0.5), int(u + 0.5)] > CLEAR_PX


@inlined(allocates=False)
def pixel_of(x: float, y: float, z: float, view: View) -> ImagePoint:
    """Pixel of a point in the camera's frame at the middle row, z > 0, where the camera moves on from row to row."""
    at = project(x, y, z, view.lens)
    return at if view.sweep.size == 0 else swept(x, y, z, at, view)


@compiled("f0 f0 f0 pixel view", inner=True, allocates=False, pixel=IMAGE_POINT, view=VIEW)
def swept(x: float, y: float, z: float, at: ImagePoint, view: View) -> ImagePoint:
    """Pixel of a point that would be seen `at` one if the camera did not move.

    The row there tells when it is seen; a second row, of the pixel then, is within the square of the sweep.
    """
    sweep, middle = view.sweep, 0.5 * (view.size_px[1] - 1.0)
    for _ in range(2):
        rows = at.y - middle
        xs = x + rows * (sweep[0] + sweep[4] * z - sweep[5] * y)
        ys = y + rows * (sweep[1] + sweep[5] * x - sweep[3] * z)
        zs = z + rows * (sweep[2] + sweep[3] * y - sweep[4] * x)
        if zs <= view.near:
            break
        at = project(xs, ys, zs, view.lens)
    return at
