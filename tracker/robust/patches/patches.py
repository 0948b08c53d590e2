"""Texture patches on known planes: created at poses that are certain, and matched in later frames.

The relative positions of patches are accurate to a tenth of a pixel, but all of them depend on the pose at which they
were created: its error is one of the `NuisanceBiases`, observed by the edges of each frame. Patches thus accumulate the
information of the edges over frames, and do not drift. When edges constrain the pose poorly, as in front of a single
face, the patches constrain it.
"""

import math
from itertools import product

import numpy as np
from numpy.typing import NDArray

from uavbench.scenes.camera import Camera
from uavbench.tracker.protocol import Image
from uavbench.tracker.robust.config import RobustConfig
from uavbench.tracker.robust.edges.columns import BESIDE
from uavbench.tracker.robust.edges.edge_graph import EdgeMap
from uavbench.tracker.robust.kernel_values import kernel_values
from uavbench.tracker.robust.patches.corner_kernels import KeepOut, faces_of_all, strong_pixels
from uavbench.tracker.robust.patches.matches import HALF, SIDE, Patches, PatchMatches
from uavbench.tracker.robust.patches.patch_kernels import Hits, PatchesInView, align, choose, count_hits, shift_places
from uavbench.tracker.robust.view import CLEAR_PX, View
from uavbench.trajectories.kernels.compiled import unchecked
from uavbench.trajectories.pose import Array, Pose

MAX_PATCHES = 600
"""Capacity; when it is exceeded, three quarters of the patches are kept: those in use, and others found most often."""
MOST_USED = 32
"""Patches searched per frame, and number found below which new ones are created: limits their time."""
MOST_NEW = 6
"""Most new patches per frame, except for the first ones: limits its time."""
MAX_MISSES = 6
"""A patch missed in more frames than this is removed: limits the time spent on vanished patches."""
FIRST_SPOTS = 400
"""Start positions of the corner detection while there are no patches yet; a quarter of them, others each time, after a
frame that has none: limits the time of structures where no patch is found.
"""
SPACING_PX = float(SIDE)
"""Least distance between patches, so that they do not overlap. Measured around a box 2.5 m away: patches 6 px apart
drift.
"""

Indices = NDArray[np.int64]


class Texture:
    """The patches of a structure created so far; rows from len(self) on are free."""

    def __init__(self, edges: EdgeMap, camera: Camera, view: View, config: RobustConfig) -> None:
        self.alignment, self.noise_grey = kernel_values(config.patches.alignment), config.preprocessing.max_noise_grey
        self.from_edges_px = config.solver.estimator.separate_px
        self.edges, self.camera, self.view = edges, camera, view
        self.count = 0
        self.patches = Patches.room_for(MAX_PATCHES)
        self.chosen = np.zeros(0, dtype=np.int64)
        self.turn = 0
        self.barren, self.first_spots = False, FIRST_SPOTS
        self.now_s, self.searched_s = 0.0, -math.inf

    def __len__(self) -> int:
        return self.count

    def choose(self, view: View) -> None:
        """Select the patches to search in a view: on visible faces, inside the image, those with most hits first."""
        planes, triangles = self.edges.planes, self.edges.triangles
        self.chosen = unchecked(choose)(self.patches, self.count, planes, triangles, view, MOST_USED, self.alignment)

    @property
    def in_view(self) -> PatchesInView:
        """The chosen patches, and how they are aligned."""
        return PatchesInView(self.patches, self.chosen, self.now_s, self.noise_grey, self.alignment)

    def align(self, image: Image, view: View) -> PatchMatches:
        """Matches of the chosen patches near their projections in a view, in an image (h, w, c)."""
        return unchecked(align)(image, self.in_view, view)

    def count_hits(self, chosen: Indices, weights: Array, correlation: Array) -> Hits:
        """Which of the chosen patches (m,) were inliers; those missed too often are removed.

        weights (m,): > 0 for inliers; correlation (m,): < 0 for patches that were not searched.
        """
        hits: Hits = unchecked(count_hits)(self.patches, chosen, weights, correlation, MAX_MISSES)
        if hits.any_lost:
            self._keep(self.patches.missed[: self.count] <= MAX_MISSES)
        return hits

    def shift(self, faces: Indices, twist: Array, view: View) -> None:
        """Shift the patches of some faces on their planes so that their pixels in a view are kept when its pose moves
        by a twist (6,).
        """
        unchecked(shift_places)(self.patches, self.count, faces, twist, view, self.alignment)

    def take(self, image: Image, pose: Pose, edge_pixels: Array) -> None:
        """Create patches at corners of an image (h, w, c) on the structure, away from pixels (n, 2) of its edges.

        The least strength of a corner is what the most noise left in a frame alone is expected to give: the variance of
        half the difference of two pixels. `barren` tells afterwards that there were none, `searched_s` when it was.
        """
        self.barren, self.searched_s = True, self.now_s
        if self.count > MAX_PATCHES - MOST_USED:
            in_use = np.isin(np.arange(self.count), self.chosen)
            order = np.lexsort([-self.patches.hits[: self.count], ~in_use])
            self._keep(np.argsort(order, kind="stable") < MAX_PATCHES * 3 // 4)
        spots = self._spots(pose, MOST_USED if self.count else self.first_spots)
        self.first_spots = FIRST_SPOTS if self.count else FIRST_SPOTS // 4
        if not len(spots):
            return
        most = min(MAX_PATCHES - self.count, 2 * MOST_USED if self.count == 0 else MOST_NEW)
        edges = KeepOut(np.ascontiguousarray(edge_pixels), self.from_edges_px)
        known = KeepOut(self._known_pixels(pose), SPACING_PX)
        pixels = strong_pixels(image, spots, edges, known, 0.5 * self.noise_grey**2, most)
        if len(pixels):
            self._append(image, pixels, pose)

    def _append(self, image: Image, pixels: Array, pose: Pose) -> None:
        """Add patches at pixels (n, 2) on the structure."""
        eye = pose.inverse().translation
        around = self._around()
        grid = pixels[:, None] + around
        rays = (self.camera.rays(grid.reshape(-1, 2)) @ pose.rotation).reshape(-1, len(around), 3)
        p, reach, channel = self.patches, int(HALF), 1 if image.shape[2] > 1 else 0
        faces = faces_of_all(eye, rays, self.edges.triangles)  # the whole patch is on one face
        on = faces >= 0
        for (x, y), ray, face in zip(pixels[on].astype(int).tolist(), rays[on], faces[on].tolist(), strict=True):
            texels = image[y - reach : y + reach + 1, x - reach : x + reach + 1, channel].astype(np.float64)
            texels -= texels.mean()
            norm = float(np.linalg.norm(texels))
            if norm < self.noise_grey * SIDE:
                continue
            plane = self.edges.planes[face]
            points = eye + ray[:3] * ((plane[3] - plane[:3] @ eye) / (ray[:3] @ plane[:3]))[:, None]
            row, self.barren = self.count, False
            p.middles[row], p.axes[row], p.texels[row] = points[0], points[1:] - points[0], texels / norm
            p.face[row], p.missed[row], p.hits[row] = face, 0, 0
            p.taken_s[row] = self.now_s
            self.count += 1

    def _around(self) -> Array:
        """Pixels (n, 2) around a patch's centre that must be on the same face, the first three on its texels' axes.

        As far from the patch as the colours beside an edge reach, so that no edge shows in it.
        """
        corner = HALF + BESIDE
        return np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], *product((-corner, corner), repeat=2)])

    def _spots(self, pose: Pose, n: int) -> Indices:
        """Up to n quasi-random pixels (n, 2) in the box around the projection, others each time (Roberts 2018)."""
        low, high = np.zeros(2), self.view.size_px.copy()
        cam = pose.transform(self.edges.extent)
        if (cam[:, 2] > self.view.near).all():
            px = self.camera.project(cam)
            low, high = np.maximum(px.min(axis=0), 0), np.minimum(px.max(axis=0), high)
        k = np.arange(self.turn, self.turn + n)
        self.turn += n
        spread = np.column_stack([k * 0.7548776662466927 % 1.0, k * 0.5698402909980532 % 1.0])
        spots = np.asarray(low + spread * np.maximum(high - low, 0), dtype=np.int64)
        return spots[self._clear(spots)] if self.view.clear_px.size else spots

    def _clear(self, spots: Indices) -> NDArray[np.bool_]:
        """Whether each of the pixels (n, 2) is inside the image, and CLEAR_PX from what is masked."""
        inside = np.all(spots < self.view.size_px, axis=1)
        x, y = np.where(inside[:, None], spots, 0).T
        return np.asarray(inside & (self.view.clear_px[y, x] > CLEAR_PX))

    def _known_pixels(self, pose: Pose) -> Array:
        cam = pose.transform(self.patches.middles[self.chosen])
        cam = cam[cam[:, 2] > self.view.near]
        return np.ascontiguousarray(self.camera.project(cam)) if len(cam) else np.zeros((0, 2))

    def _keep(self, rows: NDArray[np.bool_]) -> None:
        kept = np.flatnonzero(rows)
        for array in self.patches:
            array[: len(kept)] = array[kept]
        self.count = len(kept)
        self.chosen = np.zeros(0, dtype=np.int64)
