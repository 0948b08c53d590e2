"""Facets in view: corners, neighbours, and their outlines and planes in the image, made when first asked for."""

from typing import Any, NamedTuple

import numpy as np

from uavbench.scenes.rendering.facets import Rows
from uavbench.trajectories.kernels.argument_types import named_tuple
from uavbench.trajectories.kernels.compiled import compiled
from uavbench.trajectories.pose import Array


class FacetTable(NamedTuple):
    """Facets in view: corners (n, 3, 3) in the world, m; part (n,) of each; opposite (n, 3), the facet beyond the side
    opposite each corner, -1 for none; plane (n,), see `number_planes`; smooth (n, 3), see `find_smooth`;
    image_from_world (3, 4) in px; outlines (n, 4, 3), scratch, NaN where not known.
    """

    corners: Array
    part: Rows
    opposite: Rows
    plane: Rows
    smooth: Rows
    image_from_world: Array
    outlines: Array


FACET_TABLE = named_tuple(FacetTable, "f3! i1! i2! i1! i2! f2! f3!")


@compiled
def ready(facets: Any, row: int) -> None:
    """Fill in the outline of a facet unless it is there."""
    if row >= 0 and np.isnan(facets.outlines[row, 3, 2]):
        _outline(facets, row)


@compiled
def _outline(facets: Any, row: int) -> None:
    """Set a facet's outline (4, 3): lines through its sides in the image, positive inside, and inverse depth, 1/m.

    In homogeneous coordinates (Olano & Greer 1997), so that corners may lie behind the camera.
    """
    out = facets.outlines
    for i in range(3):
        a, b = (i + 1) % 3, (i + 2) % 3
        ax, ay, az = _projected(facets, row, a)
        bx, by, bz = _projected(facets, row, b)
        out[row, i, 0], out[row, i, 1], out[row, i, 2] = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    x, y, z = _projected(facets, row, 0)
    volume = x * out[row, 0, 0] + y * out[row, 0, 1] + z * out[row, 0, 2]
    for k in range(3):
        whole = out[row, 0, k] + out[row, 1, k] + out[row, 2, k]
        out[row, 3, k] = whole / volume if volume != 0.0 else 0.0
        if volume < 0.0:
            for i in range(3):
                out[row, i, k] = -out[row, i, k]


@compiled
def _projected(facets: Any, row: int, corner: int) -> tuple[float, float, float]:
    """Homogeneous place of a facet's corner in the image."""
    corners, matrix = facets.corners, facets.image_from_world
    x, y, z = corners[row, corner, 0], corners[row, corner, 1], corners[row, corner, 2]
    u = matrix[0, 0] * x + matrix[0, 1] * y + matrix[0, 2] * z + matrix[0, 3]
    v = matrix[1, 0] * x + matrix[1, 1] * y + matrix[1, 2] * z + matrix[1, 3]
    return u, v, matrix[2, 0] * x + matrix[2, 1] * y + matrix[2, 2] * z + matrix[2, 3]


@compiled
def nearness(outlines: Any, row: int, u: float, v: float) -> float:
    """Inverse depth, 1/m, of the plane of a facet at a place in the image."""
    nearness: float = outlines[row, 3, 0] * u + outlines[row, 3, 1] * v + outlines[row, 3, 2]
    return nearness
