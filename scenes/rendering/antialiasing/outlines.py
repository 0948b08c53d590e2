"""The facets of a renderer as the antialiasing needs them: places at a time, parts, instances."""

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from uavbench.scenes.camera import Camera
from uavbench.scenes.rendering.antialiasing.border_kernels import find_smooth, number_planes
from uavbench.scenes.rendering.antialiasing.coverage import BORDERED, BorderRows, antialias, cells, part_numbers
from uavbench.scenes.rendering.antialiasing.facet_table import FacetTable
from uavbench.scenes.rendering.camera_simulator import Geometry
from uavbench.scenes.rendering.facets import Facets
from uavbench.trajectories.pose import Array, Pose

SAME_M = 1e-5
"""Distance below which corners of facets are one point, metres."""


class Moment(NamedTuple):
    """What a view depends on: `cam_from_world`, the camera, and the time in seconds."""

    cam_from_world: Pose
    camera: Camera
    time_s: float

    def same(self, other: "Moment | None") -> bool:
        """Whether the other is the same view."""
        if other is None or self[1:] != other[1:]:
            return False
        pose, others = self.cam_from_world, other.cam_from_world
        return pose is others or bool(np.array_equal(pose.matrix, others.matrix))


class Pixels(NamedTuple):
    """What a view shows at pixel centres: facets (h, w), -1 for the background, with their depths and instances.

    windows: of each of the `cells` of the image the plane that its window shows, -1 for none, BORDERED where it has
    borders, as all have before the image is antialiased.
    """

    facets: NDArray[np.int32]
    geometry: Geometry
    windows: NDArray[np.int32]


class Outlines:
    """Facets of drawn meshes, with the number of each mesh's part."""

    def __init__(self, facets: Facets, parts: Sequence[int]) -> None:
        counts = np.diff(facets.first, append=len(facets.corners_m))
        self._facets, self._seen = facets, np.empty(len(facets.corners_m) + 1, dtype=np.int64)
        corners, part = facets.corners_m.copy(), np.repeat(np.array(parts, dtype=np.int64), counts)
        opposite, plane, scratch = opposite_facets(corners, part), np.empty_like(part), np.empty((len(corners), 4, 3))
        smooth = np.empty_like(opposite)
        number_planes(corners, opposite, plane)
        find_smooth(corners, opposite, smooth)
        self._table = FacetTable(corners, part, opposite, plane, smooth, np.zeros((3, 4)), scratch)
        self._instance = np.concatenate([[0], facets.instances]).astype(np.uint8)
        self._moment: Moment | None = None

    def image(self, color: NDArray[np.uint8], pixels: "Pixels", moment: Moment) -> NDArray[np.uint8]:
        """Antialiased image (h, w, 3) BGR of the colours and facets rendered at pixel centres, see `antialias`.

        It finds the planes of the windows of the pixels.
        """
        table = self.table(moment)
        out = np.asarray(cv2.cvtColor(color, cv2.COLOR_RGBA2BGR), dtype=np.uint8)
        cv2.flip(out, 0, out)
        antialias(
            color, pixels.facets, table, self._seen, BorderRows.of(len(color), color.shape[1], pixels.windows), out
        )
        return out

    def table(self, moment: Moment) -> FacetTable:
        """The facets as they are in view; valid until it is asked for at another moment."""
        table, camera = self._table, moment.camera
        if not moment.same(self._moment):
            for rows, mover in self._facets.movers:
                moved = mover.world_from_part(moment.time_s).transform(self._facets.corners_m[rows].reshape(-1, 3))
                table.corners[rows] = moved.reshape(-1, 3, 3)
            K = np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1.0]])
            table.image_from_world[:] = K @ moment.cam_from_world.matrix[:3]
            table.outlines[:, 3, 2] = np.nan
            self._moment = moment
        return table

    def pixels(self, numbers: NDArray[np.float32]) -> "Pixels":
        """What was rendered at pixel centres, of numbers (h, w, 2) as read back: see `part_numbers`."""
        size = numbers.shape[:2]
        geometry = Geometry(np.empty(size, dtype=np.float32), np.empty(size, dtype=np.uint8))
        pixels = Pixels(np.empty(size, dtype=np.int32), geometry, np.full(cells(*size), BORDERED, dtype=np.int32))
        part_numbers(numbers, self._instance, pixels.facets, *geometry)
        return pixels


def opposite_facets(corners: Array, part: NDArray[np.int64]) -> NDArray[np.int64]:
    """Facets (n, 3) of the same part beyond the side that is opposite each corner, -1 where there is not exactly one.

    Corners (n, 3, 3) are the same point when they agree to SAME_M; sides are compared by hashes of their ends.
    """
    units = np.rint(corners / SAME_M).astype(np.int64).view(np.uint64)
    point = (units * np.array([0x9E3779B97F4A7C15, 0xBF58476D1CE4E5B9, 0x94D049BB133111EB], dtype=np.uint64)).sum(
        axis=2
    )
    point ^= point >> np.uint64(31)
    point *= np.uint64(0xD6E8FEB86659FD93)
    side = np.roll(point, -1, axis=1) + np.roll(point, -2, axis=1) + part[:, None].astype(np.uint64)
    order = np.argsort(side.reshape(-1), kind="stable")
    ordered = side.reshape(-1)[order]
    same = np.concatenate([[False], ordered[1:] == ordered[:-1], [False]])
    first = np.flatnonzero(~same[:-2] & same[1:-1] & ~same[2:]) if len(order) > 1 else np.zeros(0, dtype=np.int64)
    out = np.full(side.size, -1, dtype=np.int64)
    out[order[first]], out[order[first + 1]] = order[first + 1] // 3, order[first] // 3
    return out.reshape(-1, 3)
