"""A rehearsal: what a process sets up at the first call of a kernel or of OpenCV does not delay the first frames."""

from collections.abc import Callable
from functools import cache

import cv2
import numpy as np

from uavbench.scenes.camera import Camera
from uavbench.scenes.primitives.meshes import box
from uavbench.scenes.structure import Structure
from uavbench.tracker.protocol import Image, Run
from uavbench.trajectories.kernels.compiled import KERNELS
from uavbench.trajectories.pose import Array, Pose

BOX = box((-0.6, -0.4, -0.3), (0.6, 0.4, 0.3))
"""A box whose sides differ, in m."""
SIDES = np.array([[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]])
"""Its vertices (6, 4) about each side, counter-clockwise from outside."""
SPOTS, SPOT = 5, np.array([[0.3, 0.3], [0.7, 0.3], [0.7, 0.7], [0.3, 0.7]])
"""Spots along a side, and the corners (4, 2) of each in its part of the side."""
CAMERA = Camera.from_field_of_view(320, 240, 60.0)
RANGE_M, FRAMES, LOST, FRAME_NS = 2.5, 6, 2, 100_000_000
"""Distance of the box; frames that show it, enough for a learning of every kind; blank ones; their interval in ns."""


@cache
def rehearse(start: Callable[[Structure, Camera, Pose, np.random.Generator], Run]) -> None:
    """Track a box that is seen, lost, and seen again, once in a process; `start` starts the run."""
    if not KERNELS:  # where numba is switched off, there is nothing to set up
        return
    poses = [seen_from(0.5 + 0.01 * k) for k in range(FRAMES)]
    run = start(Structure.from_mesh(*BOX), CAMERA, poses[0], np.random.default_rng(0))
    blank = np.full((CAMERA.height, CAMERA.width), 90, dtype=np.uint8)
    shown = [*map(picture, poses), *(blank + k for k in np.arange(LOST, dtype=np.uint8)), *map(picture, poses)]
    for k, image in enumerate(shown):
        run.track(image, k * FRAME_NS)


def seen_from(azimuth_rad: float) -> Pose:
    """The pose `cam_from_world` of a camera that looks at the box from an azimuth, and from above."""
    eye = RANGE_M * np.array([np.cos(azimuth_rad), np.sin(azimuth_rad), 0.6]) / np.hypot(1.0, 0.6)
    z = -eye / RANGE_M
    x = np.cross(z, [0.0, 0.0, 1.0])
    x /= np.linalg.norm(x)
    R = np.array([x, np.cross(z, x), z])
    return Pose(R, -R @ eye)


def picture(pose: Pose) -> Image:
    """The box (h, w) in front of a dark wall, its sides of different greys with a pattern of spots."""
    image = np.full((CAMERA.height, CAMERA.width), 40, dtype=np.uint8)
    eye = pose.inverse().translation
    for k, side in enumerate(BOX.vertices[SIDES]):
        if (eye - side[0]) @ np.cross(side[1] - side[0], side[2] - side[1]) > 0.0:
            fill(image, pose, side, 90 + 25 * k)
            for i, j in np.ndindex(SPOTS, SPOTS):
                spot = side[0] + (SPOT + np.array([i, j])) / SPOTS @ (side[[1, 3]] - side[0])
                fill(image, pose, spot, 60 + (37 * i + 91 * j + 53 * k) % 160)
    return image


def fill(image: Image, pose: Pose, corners: Array, grey: int) -> None:
    """Fill a polygon of corners (n, 3) in an image, in place."""
    pixels = CAMERA.project(pose.transform(corners))
    cv2.fillConvexPoly(image, np.round(pixels * 16.0).astype(np.int32), grey, cv2.LINE_AA, 4)
