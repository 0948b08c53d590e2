"""Step 6, control points: sampled on each projected visible edge, in number proportional to its length in px."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from uavbench.tracker.visible_edges import ProjectedEdges
from uavbench.trajectories.pose import Array

CONTROL_POINT_SPACING_PX = 8.0
"""Spacing of control points along a visible edge, px."""


@dataclass(frozen=True, eq=False)
class ControlPoints:
    """Points on the visible edges, ordered by edge.

    points_m (n, 3) in the world; pixels (n, 2) and unit normals (n, 2) of the edge's projection in the undistorted
    image; edge (n,) row of `ProjectedEdges`.
    """

    points_m: Array
    pixels: Array
    normals: Array
    edge: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.edge)

    def select(self, rows: NDArray[np.bool_] | NDArray[np.int64]) -> "ControlPoints":
        """The chosen rows."""
        return ControlPoints(self.points_m[rows], self.pixels[rows], self.normals[rows], self.edge[rows])


def control_points(visible: ProjectedEdges, spacing_px: float = CONTROL_POINT_SPACING_PX) -> ControlPoints:
    """Control points, evenly spaced in the image; an edge shorter than half the spacing has none."""
    lengths = visible.lengths_px
    counts = np.round(lengths / spacing_px).astype(np.int64)
    edge = np.repeat(np.arange(len(counts)), counts)
    first = np.repeat(np.cumsum(counts) - counts, counts)
    part = ((np.arange(len(edge)) - first + 0.5) / np.maximum(counts[edge], 1))[:, None]
    a, b = visible.segments_px[edge, 0], visible.segments_px[edge, 1]
    # Inverse depth is linear along a projected line, so the part of the length in space is
    near, far = part / visible.depths_m[edge, 1:], (1 - part) / visible.depths_m[edge, :1]
    in_space = near / (near + far)
    points = visible.segments_m[edge, 0] * (1 - in_space) + visible.segments_m[edge, 1] * in_space
    direction = (b - a) / np.maximum(lengths[edge, None], 1e-12)
    normals = np.column_stack([-direction[:, 1], direction[:, 0]])
    return ControlPoints(points, a * (1 - part) + b * part, normals, edge)
