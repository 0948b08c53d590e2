"""Texture on known planes: patches are taken where the pose is sure, and found again in later frames.

Where edges leave the pose nearly free, as before a single face, the patches hold it.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from scenes.camera import Camera
from tracker.base import Image
from tracker.edge_map import EdgeMap
from tracker.geometry_kernels import camera_array
from tracker.texture_kernels import HALF, SIDE, align, first_hit, patch_rows
from trajectories.pose import Array, Pose

MOST_PATCHES = 600
MOST_USED = 48
"""Patches looked for in a frame."""
ENOUGH_FOUND = 24
"""New patches are taken when fewer than this are found."""
APART_PX = 14.0
EDGE_MARGIN_PX = 8.0
"""Patches are taken no nearer to each other, and to the edges, than this."""
MISSES = 6
"""A patch that should be seen and is not found for so many frames is dropped."""

Indices = NDArray[np.int64]


class Texture:
    """The patches of a structure that were taken so far."""

    def __init__(self, edges: EdgeMap, camera: Camera) -> None:
        self.edges, self.camera, self.cam = edges, camera, camera_array(camera)
        self.middles = np.zeros((0, 3))
        self.axes = np.zeros((0, 2, 3))
        self.texels = np.zeros((0, SIDE, SIDE))
        self.face = np.zeros(0, dtype=np.int64)
        self.missed = np.zeros(0, dtype=np.int64)
        self.found = np.zeros(0, dtype=np.int64)
        self.chosen = np.zeros(0, dtype=np.int64)

    def __len__(self) -> int:
        return len(self.face)

    def choose(self, R: Array, t: Array) -> None:
        """Choose the patches to look for at a pose: on faces turned to the camera, in view, the best known first."""
        eye = -R.T @ t
        facing = self.edges.planes[self.face, :3] @ eye > self.edges.planes[self.face, 3]
        cam = self.middles @ R.T + t
        z = np.maximum(cam[:, 2], 1e-6)
        u, v = self.camera.fx * cam[:, 0] / z + self.camera.cx, self.camera.fy * cam[:, 1] / z + self.camera.cy
        inside = (cam[:, 2] > 0.02) & (u > 6) & (v > 6) & (u < self.camera.width - 6) & (v < self.camera.height - 6)
        rows = np.flatnonzero(facing & inside)
        if len(rows) > MOST_USED:
            rows = np.sort(rows[np.argsort(-self.found[rows], kind="stable")[:MOST_USED]])
        self.chosen = rows

    def align(self, image: Image, R: Array, t: Array) -> tuple[Array, Array]:
        """Pixels (n, 2) at which the chosen patches are found near a pose, and their correlations (n,)."""
        return align(image, self.middles, self.axes, self.texels, self.chosen, R, t, self.cam)

    def rows(self, observed: Array, R: Array, t: Array) -> tuple[Array, Array]:
        """Displacements (n, 2) to the pixels observed, and J (n, 2, 6), at a pose."""
        return patch_rows(self.middles, self.chosen, observed, R, t, self.cam)

    def remember(self, chosen: Indices, hit: NDArray[np.bool_], tried: NDArray[np.bool_]) -> None:
        """Count which of the chosen patches were found of those tried; drop those that are missed again and again."""
        self.found[chosen[hit]] += 1
        self.missed[chosen[hit]] = 0
        self.missed[chosen[tried & ~hit]] += 1
        if (self.missed > MISSES).any():
            self._keep(self.missed <= MISSES)

    def take(self, image: Image, pose: Pose, edge_pixels: Array) -> None:
        """Take new patches at the corners of the image that lie on the structure, away from its edges (n, 2)."""
        if len(self) >= MOST_PATCHES:
            self._keep(np.argsort(np.argsort(-self.found, kind="stable"), kind="stable") < MOST_PATCHES * 3 // 4)
        gray = np.ascontiguousarray(image[..., 1])
        corners = cv2.goodFeaturesToTrack(gray, 250, 0.002, APART_PX / 2, mask=self._mask(pose))
        if corners is None or not len(corners):
            return
        pixels = np.round(corners.reshape(-1, 2)).astype(np.float64)
        pixels = pixels[_apart(pixels, edge_pixels, EDGE_MARGIN_PX)]
        near = HALF + 2
        pixels = pixels[
            (pixels.min(axis=1) >= near)
            & (pixels[:, 0] < self.camera.width - near)
            & (pixels[:, 1] < self.camera.height - near)
        ]
        pixels = pixels[_apart(pixels, self._known_pixels(pose), APART_PX)]
        eye = pose.inverse().translation
        grid = pixels[:, None] + np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
        flat = self.camera.undistort(grid.reshape(-1, 2))
        rays = np.column_stack(
            [
                (flat[:, 0] - self.camera.cx) / self.camera.fx,
                (flat[:, 1] - self.camera.cy) / self.camera.fy,
                np.ones(len(flat)),
            ]
        )
        rays = (rays @ pose.rotation).reshape(-1, 3, 3)
        face, _ = first_hit(eye, np.ascontiguousarray(rays[:, 0]), self.edges.corners, self.edges.owner)
        for k in np.flatnonzero(face >= 0):
            plane = self.edges.planes[face[k]]
            points = eye + rays[k] * ((plane[3] - plane[:3] @ eye) / (rays[k] @ plane[:3]))[:, None]
            x, y = int(pixels[k, 0]), int(pixels[k, 1])
            reach = int(HALF)
            texels = gray[y - reach : y + reach + 1, x - reach : x + reach + 1].astype(np.float64)
            texels -= texels.mean()
            norm = float(np.linalg.norm(texels))
            if norm < 4.0 * SIDE:
                continue
            self._append(points[0], points[1:] - points[0], texels / norm, int(face[k]))

    def _mask(self, pose: Pose) -> Image:
        """Where the structure may be seen: the box around its projection."""
        mask = np.zeros((self.camera.height, self.camera.width), dtype=np.uint8)
        cam = pose.transform(self.edges.ends.reshape(-1, 3))
        if (cam[:, 2] < 0.02).any():
            return np.full_like(mask, 255)
        px = self.camera.project(cam)
        size = [self.camera.width, self.camera.height]
        x0, y0 = np.clip(px.min(axis=0), 0, size).astype(int).tolist()
        x1, y1 = np.clip(px.max(axis=0) + 1, 0, size).astype(int).tolist()
        mask[y0:y1, x0:x1] = 255
        return mask

    def _known_pixels(self, pose: Pose) -> Array:
        cam = pose.transform(self.middles[self.chosen])
        cam = cam[cam[:, 2] > 0.02]
        return self.camera.project(cam) if len(cam) else np.zeros((0, 2))

    def _append(self, middle: Array, axes: Array, texels: Array, face: int) -> None:
        self.middles = np.concatenate([self.middles, middle[None]])
        self.axes = np.concatenate([self.axes, axes[None]])
        self.texels = np.concatenate([self.texels, texels[None]])
        self.face = np.append(self.face, face)
        self.missed, self.found = np.append(self.missed, 0), np.append(self.found, 0)

    def _keep(self, rows: NDArray[np.bool_]) -> None:
        for name in ("middles", "axes", "texels", "face", "missed", "found"):
            setattr(self, name, np.ascontiguousarray(getattr(self, name)[rows]))
        self.chosen = np.zeros(0, dtype=np.int64)


def _apart(pixels: Array, others: Array, distance_px: float) -> NDArray[np.bool_]:
    """Whether each pixel (n, 2) is farther than a distance from all others (m, 2)."""
    if not len(others) or not len(pixels):
        return np.ones(len(pixels), dtype=bool)
    far: NDArray[np.bool_] = np.linalg.norm(pixels[:, None] - others[None], axis=2).min(axis=1) >= distance_px
    return far
