"""Texture on known planes: patches are taken where the pose is sure, and found again in later frames.

Relative to each other the patches are known to a tenth of a pixel, but all of them rest on the pose that they were
taken at: its error is one of the `CommonErrors` that each frame's edges observe. So patches carry over what the edges
of some frames agree on, and do not drift. Where edges leave the pose nearly free, as before a single face, they hold
it.
"""

from itertools import product

import numpy as np
from numpy.typing import NDArray

from uavbench.scenes.camera import Camera
from uavbench.tracker.geometry_kernels import camera_array
from uavbench.tracker.protocol import Image
from uavbench.tracker.robust.config.patches import PatchesConfig
from uavbench.tracker.robust.edges.edge_graph import EdgeMap
from uavbench.tracker.robust.kernel_values import kernel_values
from uavbench.tracker.robust.patches.corner_kernels import first_hit, strong_pixels
from uavbench.tracker.robust.patches.patch_kernels import HALF, SIDE, align, choose, count_hits, shift_places
from uavbench.trajectories.pose import Array, Pose

MOST_PATCHES = 600
"""Patches that are remembered; where there is no room for new ones, three quarters are kept."""
NEAR_M = 0.02
"""Points nearer to the camera's plane than this are not projected."""

Indices = NDArray[np.int64]


class Texture:
    """The patches of a structure that were taken so far; rows from len(self) on are free."""

    def __init__(self, edges: EdgeMap, camera: Camera, config: PatchesConfig) -> None:
        self.config, self.alignment = config, kernel_values(config.alignment)
        self.edges, self.camera, self.cam = edges, camera, camera_array(camera)
        self.size = np.array([camera.width, camera.height], dtype=np.float64)
        self.count = 0
        self.middles = np.zeros((MOST_PATCHES, 3))
        self.axes = np.zeros((MOST_PATCHES, 2, 3))
        self.texels = np.zeros((MOST_PATCHES, SIDE, SIDE))
        self.face = np.zeros(MOST_PATCHES, dtype=np.int64)
        self.missed = np.zeros(MOST_PATCHES, dtype=np.int64)
        self.found = np.zeros(MOST_PATCHES, dtype=np.int64)
        self.chosen = np.zeros(0, dtype=np.int64)
        self.turn = 0
        self.now_s = 0.0
        self.taken_s = np.zeros(MOST_PATCHES)

    def __len__(self) -> int:
        return self.count

    def choose(self, R: Array, t: Array) -> None:
        """Choose the patches to look for at a pose: on faces turned to the camera, in view, the best known first."""
        e = self.edges
        self.chosen = choose(
            self.count, self.middles, self.face, self.found, e.planes, e.corners, e.owner, e.boxes, e.nodes,
            R, t, self.cam, self.size, self.config.max_used, self.config.alignment.border_px,
        )  # fmt: skip

    def align(self, image: Image, R: Array, t: Array) -> tuple[Array, Array, Array]:
        """Pixels (n, 2) at which the chosen patches are found near a pose in an image (h, w, c).

        With their correlations (n,) and the variance (n,) of the pixels in px^2.
        """
        observed, score, variance = align(
            image, self.middles, self.axes, self.texels, self.chosen, R, t, self.cam, self.alignment
        )
        age_s = np.maximum(self.now_s - self.taken_s[self.chosen], self.config.min_age_s)
        return observed, score, variance * (1 + self.config.young_s / age_s)

    def places(self) -> Array:
        """Middles (n, 3) of the chosen patches in the world."""
        return self.middles[self.chosen]

    def count_hits(self, chosen: Indices, weights: Array, found: Array) -> int:
        """Number of the chosen patches (n,) that took part; those missed again and again are dropped.

        weights (n,) > 0 are the patches that took part, found (n,) < 0 those that were not tried.
        """
        hits, tired = count_hits(chosen, weights, found, self.found, self.missed, self.config.max_misses)
        if tired:
            self._keep(self.missed[: self.count] <= self.config.max_misses)
        return hits

    def shift(self, twist: Array, pose: Pose) -> None:
        """Move the patches on their planes so that what was seen at a pose is now seen at one moved by a twist (6,)."""
        R, t = pose.rotation, pose.translation
        shift_places(self.count, self.middles, self.axes, twist, R, t, self.cam, self.alignment)

    def take(self, image: Image, pose: Pose, edge_pixels: Array) -> None:
        """Take new patches at corners of an image (h, w, c) that lie on the structure, away from its edges (n, 2)."""
        c = self.config
        if self.count > MOST_PATCHES - c.spots:
            order = np.argsort(-self.found[: self.count], kind="stable")
            self._keep(np.argsort(order, kind="stable") < MOST_PATCHES * 3 // 4)
        spots = self._spots(pose)
        if not len(spots):
            return
        most = min(MOST_PATCHES - self.count, c.initial_new if self.count == 0 else c.new)
        pixels = strong_pixels(
            image,
            spots,
            edge_pixels,
            c.edge_margin_px,
            self._known_pixels(pose),
            c.spacing_px,
            c.min_corner_grey2,
            most,
        )
        if len(pixels):
            self._append(image, pixels, pose)

    def _append(self, image: Image, pixels: Array, pose: Pose) -> None:
        """Add patches at pixels (n, 2) on the structure."""
        eye = pose.inverse().translation
        around = self._around()
        grid = pixels[:, None] + around
        rays = (self.camera.rays(grid.reshape(-1, 2)) @ pose.rotation).reshape(-1, len(around), 3)
        e, reach, channel = self.edges, int(HALF), 1 if image.shape[2] > 1 else 0
        for (x, y), ray in zip(pixels.astype(int).tolist(), rays, strict=True):
            hit = {first_hit(eye, r, e.corners, e.owner, e.boxes, e.nodes) for r in ray}
            face = hit.pop() if len(hit) == 1 else -1  # all of it on one face
            texels = image[y - reach : y + reach + 1, x - reach : x + reach + 1, channel].astype(np.float64)
            texels -= texels.mean()
            norm = float(np.linalg.norm(texels))
            if face < 0 or norm < self.config.min_contrast_grey * SIDE:
                continue
            plane = e.planes[face]
            points = eye + ray[:3] * ((plane[3] - plane[:3] @ eye) / (ray[:3] @ plane[:3]))[:, None]
            row = self.count
            self.middles[row], self.axes[row], self.texels[row] = points[0], points[1:] - points[0], texels / norm
            self.face[row], self.missed[row], self.found[row] = face, 0, 0
            self.taken_s[row] = self.now_s
            self.count += 1

    def _around(self) -> Array:
        """Pixels (n, 2) about a patch's middle that must lie on the same face, the first three on its texels' axes."""
        corner = HALF + self.config.flat_margin_px
        return np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], *product((-corner, corner), repeat=2)])

    def _spots(self, pose: Pose) -> Indices:
        """Pixels (n, 2) spread over the box around the structure's projection, others in every frame (Roberts 2018)."""
        low, high = np.zeros(2), self.size.copy()
        cam = pose.transform(self.edges.extent)
        if (cam[:, 2] > NEAR_M).all():
            px = self.camera.project(cam)
            low, high = np.maximum(px.min(axis=0), 0), np.minimum(px.max(axis=0), high)
        n = self.config.initial_spots if self.count == 0 else self.config.spots
        k = np.arange(self.turn, self.turn + n)
        self.turn += n
        spread = np.column_stack([k * 0.7548776662466927 % 1.0, k * 0.5698402909980532 % 1.0])
        return np.asarray(low + spread * np.maximum(high - low, 0), dtype=np.int64)

    def _known_pixels(self, pose: Pose) -> Array:
        cam = pose.transform(self.middles[self.chosen])
        cam = cam[cam[:, 2] > NEAR_M]
        return self.camera.project(cam) if len(cam) else np.zeros((0, 2))

    def _keep(self, rows: NDArray[np.bool_]) -> None:
        kept = np.flatnonzero(rows)
        for array in (self.middles, self.axes, self.texels, self.face, self.missed, self.found, self.taken_s):
            array[: len(kept)] = array[kept]
        self.count = len(kept)
        self.chosen = np.zeros(0, dtype=np.int64)
