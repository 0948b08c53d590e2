"""A facade of many windows, each of eight boxes, as a model from a building information system has them."""

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from uavbench.bench.speed.synthetic import BOX_TRIANGLES, CAMERA, look_at
from uavbench.scenes.structure import Structure
from uavbench.tracker.protocol import Image
from uavbench.trajectories.pose import Array, Pose

BAY_M, STOREY_M = 2.0, 3.0
PARTS = np.array(
    [
        [0.0, 1.2, 0.0, 0.08, 0.1, 235.0],
        [0.0, 1.2, 1.52, 1.6, 0.1, 235.0],
        [0.0, 0.08, 0.08, 1.52, 0.1, 235.0],
        [1.12, 1.2, 0.08, 1.52, 0.1, 235.0],
        [0.56, 0.64, 0.08, 1.52, 0.08, 235.0],
        [-0.1, 1.3, -0.12, 0.0, 0.25, 190.0],
        [0.08, 0.56, 0.08, 1.52, 0.02, 50.0],
        [0.64, 1.12, 0.08, 1.52, 0.02, 50.0],
    ]
)
PARTS = PARTS[np.argsort(PARTS[:, 4], kind="stable")]
"""Parts of a window: from and to along the facade and upwards, depth before the wall, m; brightness. Frame, bar, sill
and panes, the ones that stand out most last."""
LIGHT = np.array([-0.35, -0.75, 0.55])
"""Where the light comes from: along the facade, out of it and up."""
AMBIENT = 0.45
"""Part of the light that comes from everywhere."""
WALL_GREY, SKY_GREY, NOISE_GREY = 120.0, 200, 2.0
FRACTION_BITS = 4
"""Of a pixel, to which sides are drawn."""


@dataclass(frozen=True)
class Facade:
    """A block of bays x storeys windows on its front, which looks towards -y."""

    bays: int
    storeys: int

    @cached_property
    def solids(self) -> Array:
        """Corners (k, 8, 3) of all boxes: the block, and the parts of the windows by their depth."""
        bay, storey = (each.ravel() for each in np.meshgrid(np.arange(self.bays), np.arange(self.storeys)))
        found = [(-1.0, self.bays * BAY_M + 1.0, 0.0, 12.0, -1.0, self.storeys * STOREY_M + 1.0)]
        for left, right, low, high, depth, _ in PARTS:
            x, z = bay * BAY_M + 0.4, storey * STOREY_M + 0.8
            found += zip(x + left, x + right, 0.0 * x - depth, 0.0 * x, z + low, z + high, strict=True)
        bounds = np.array(found).reshape(-1, 3, 2)
        bits = np.array([[i, j, k] for k in (0, 1) for j in (0, 1) for i in (0, 1)])
        return np.take_along_axis(bounds, bits.T[None], axis=2).transpose(0, 2, 1)

    @cached_property
    def structure(self) -> Structure:
        """The facade as a model."""
        count = len(self.solids)
        triangles = BOX_TRIANGLES + 8 * np.arange(count)[:, None, None]
        return Structure.from_mesh(self.solids.reshape(-1, 3), triangles.reshape(-1, 3))

    def pose(self, seconds: float) -> Pose:
        """cam_from_world on a flight along the facade, 12 m before it."""
        middle = np.array([0.65 * self.bays * BAY_M, 0.0, 0.5 * self.storeys * STOREY_M])
        along = np.array([0.6 * seconds, 0.0, 0.1 * np.sin(2.0 * seconds)])
        return look_at(middle + along + [0.0, -12.0, 1.0], middle + along + [-1.0 - 0.1 * seconds, 0.0, 0.0])

    def image(self, cam_from_world: Pose, rng: np.random.Generator) -> Image:
        """BGR image (h, w, 3) from a pose before the facade: boxes by their depth, each side of one brightness."""
        image = np.full((CAMERA.height, CAMERA.width, 3), SKY_GREY, np.uint8)
        eye = cam_from_world.inverse().translation
        pixels = CAMERA.project(cam_from_world.transform(self.solids.reshape(-1, 3))).reshape(-1, 8, 2)
        ahead = cam_from_world.transform(self.solids.mean(axis=1))[:, 2] > 0.0
        size = np.array([CAMERA.width, CAMERA.height])
        seen = ahead & (pixels.max(axis=1) > 0.0).all(axis=1) & (pixels.min(axis=1) < size).all(axis=1)
        greys = np.concatenate([[WALL_GREY], np.repeat(PARTS[:, 5], self.bays * self.storeys)])
        for corners, places, grey in zip(self.solids[seen], pixels[seen], greys[seen], strict=True):
            draw(image, corners - eye, places, grey)
        noisy = cv2.GaussianBlur(image, (3, 3), 0.6) + rng.normal(0.0, NOISE_GREY, image.shape)
        return np.clip(noisy, 0.0, 255.0).astype(np.uint8)


def draw(image: Image, corners: Array, pixels: Array, grey: float) -> None:
    """Draw the sides of a box that face the camera; corners (8, 3) relative to it, at pixels (8, 2)."""
    for one, two in zip(BOX_TRIANGLES[::2], BOX_TRIANGLES[1::2], strict=True):
        a, b, c = corners[one]
        normal = np.cross(b - a, c - a)
        normal /= np.linalg.norm(normal)
        if normal @ a < 0.0:
            shade = grey * (AMBIENT + (1.0 - AMBIENT) * max(0.0, float(normal @ LIGHT)))
            side = cv2.convexHull(np.round(pixels[[*one, *two]] * 2**FRACTION_BITS).astype(np.int32))
            cv2.fillConvexPoly(image, side, (shade,) * 3, cv2.LINE_AA, FRACTION_BITS)
