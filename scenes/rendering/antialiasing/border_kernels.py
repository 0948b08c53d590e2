"""Kernels of the border between two pixels: where the outlines of the facets that they show pass between them."""

from typing import Any, NamedTuple

import numpy as np

from uavbench.scenes.rendering.antialiasing.facet_table import nearness, ready
from uavbench.trajectories.kernels.compiled import compiled, inlined

FLAT_COS = 0.999
"""Cosine of the angle between adjacent facets of a part (2.6 degrees) above which they are one smooth surface."""
SAME_DEPTH = 2e-3
"""Relative difference of depth below which two facets of a part are adjacent."""
SAME_PLANE_COS = 1 - 1e-10
"""Cosine of the angle between facets with a common side (1.4e-5 rad) above which they lie in one plane."""
SNAP = 2 / 256
"""How far beyond a pixel an outline may pass that is taken for before it, px: rasterizers snap corners to 1/256 px."""
STRIP = 0.05
"""Gap between two facets, px, below which the one continues the other: a shared side is the same to rounding."""
NOWHERE = 2.0
"""Place of an outline that does not pass between two pixels, which are at 0 and 1."""


class Border(NamedTuple):
    """Places, 0 .. 1 from a pixel to the next one, where the facet of the one ends and that of the other begins; and
    the facet between them, -1 for none.
    """

    ends: float
    begins: float
    between: int


@compiled("f3 i2 i1!", allocates=False)
def number_planes(corners: Any, opposite: Any, plane: Any) -> None:
    """Number the planes (n,) of facets: the same for facets that common sides join to one plane."""
    for row in range(plane.size):
        plane[row] = row
    for row in range(plane.size):
        for side in range(3):
            other = opposite[row, side]
            if other > row and _in_one_plane(corners, row, other):
                here, there = _first_of(plane, row), _first_of(plane, other)
                plane[max(here, there)] = min(here, there)
    for row in range(plane.size):
        plane[row] = _first_of(plane, row)


@compiled("f3 i2 i2!", allocates=False)
def find_smooth(corners: Any, opposite: Any, smooth: Any) -> None:
    """The facets (n, 3) beyond the sides of others that go on in a direction by FLAT_COS, -1 where none does."""
    for row in range(smooth.shape[0]):
        for side in range(3):
            other = opposite[row, side]
            goes_on = other >= 0 and _cosine(corners, row, other) > FLAT_COS
            smooth[row, side] = other if goes_on else -1


@compiled
def _first_of(plane: Any, row: int) -> int:
    """The facet that stands for the plane of another so far."""
    while plane[row] != row:
        row = plane[row]
    return row


@compiled
def _in_one_plane(corners: Any, one: int, other: int) -> bool:
    """Whether two facets with a common side lie in one plane; false where one has no area."""
    ax, ay, az, a = _normal(corners, one)
    bx, by, bz, b = _normal(corners, other)
    return bool(a * b > 0.0 and ax * bx + ay * by + az * bz > SAME_PLANE_COS * np.sqrt(a * b))


@inlined
def one_surface(facets: Any, here: int, there: int, u: float, v: float) -> bool:
    """Whether facets, -1 for the background, are of one plane that has a depth at a place in the image.

    There is no border between such facets: a short cut of `borders` for most pairs of a finely divided surface.
    """
    if here < 0 or there < 0 or facets.plane[here] != facets.plane[there]:
        return False
    ready(facets, here)
    return nearness(facets.outlines, here, u, v) > 0.0


@inlined
def borders(facets: Any, here: int, there: int, u: int, v: int, axis: int) -> Border:
    """The border between a pixel and the next one.

    here, there: the facets, -1 for the background; axis: 0 for the next pixel in the row, 1 for the one in the column.
    Both ends are 0.5 where the border runs rather along the axis, or the two are one smooth surface.
    """
    outlines, part = facets.outlines, facets.part
    along_u, along_v = 1.0 - axis, float(axis)
    if here >= 0 and there >= 0 and part[here] == part[there]:
        near = nearness(outlines, here, u + 0.5 * along_u, v + 0.5 * along_v)
        far = nearness(outlines, there, u + 0.5 * along_u, v + 0.5 * along_v)
        if abs(near - far) < SAME_DEPTH * near and _cosine(facets.corners, here, there) > FLAT_COS:
            return Border(0.5, 0.5, -1)
    first, first_side, back, second_side = NOWHERE, -1, NOWHERE, -1
    if here >= 0:
        first, first_side = _crossing(outlines, here, u, v, axis, 0)
    if there >= 0:
        back, second_side = _crossing(outlines, there, u, v, axis, 1)
    second = 1.0 - back
    if first_side < 0 and second_side < 0:
        return Border(0.5, 0.5, -1)
    of_here = second_side < 0
    if first_side >= 0 and second_side >= 0:
        middle = 0.5 * (first + second)
        place_u, place_v = u + middle * along_u, v + middle * along_v
        of_here = nearness(outlines, here, place_u, place_v) >= nearness(outlines, there, place_u, place_v)
    row, side, at = (here, first_side, first) if of_here else (there, second_side, second)
    a, b = abs(outlines[row, side, 0]), abs(outlines[row, side, 1])
    if (b > a) if axis == 0 else (a >= b):
        return Border(0.5, 0.5, -1)
    between = facets.opposite[row, side]
    if between < 0 or between in (here, there):
        return Border(at, at, -1)
    ready(facets, between)
    enters, leaves = _within(outlines, between, u, v, axis)
    if enters >= at + STRIP or leaves <= at - STRIP or (leaves <= at if of_here else enters >= at):
        return Border(at, at, -1)  # it is behind
    for k in range(3):  # the rest of a face of two triangles
        rest = facets.smooth[between, k]
        if rest >= 0 and rest != row:
            ready(facets, rest)
            begins, ends = _within(outlines, rest, u, v, axis)
            if begins < leaves + STRIP and ends > enters - STRIP:
                enters, leaves = min(enters, begins), max(leaves, ends)
    return Border(at, min(leaves, 1.0), between) if of_here else Border(max(enters, 0.0), at, between)


@compiled
def _crossing(outlines: Any, row: int, u: int, v: int, axis: int, end: int) -> tuple[float, int]:
    """Where a way from a pixel to the next one (end 0), or back (end 1), leaves a facet, 0 .. 1, and by which side.

    NOWHERE and -1 when the facet covers both.
    """
    at, side = NOWHERE, -1
    for i in range(3):
        inside = outlines[row, i, 0] * u + outlines[row, i, 1] * v + outlines[row, i, 2]
        step = outlines[row, i, axis]
        if end == 1:
            inside += step
            step = -step
        if step < 0.0 and inside <= -(1.0 + SNAP) * step:
            place = max(inside, 0.0) / -step
            if place < at:
                at, side = min(place, 1.0), i
    return at, side


@compiled
def _within(outlines: Any, row: int, u: int, v: int, axis: int) -> tuple[float, float]:
    """Where a way from a pixel, at 0, to the next one, at 1, enters and leaves a facet; 1e9 and -1e9 if never."""
    enters, leaves = -1e9, 1e9
    for i in range(3):
        inside = outlines[row, i, 0] * u + outlines[row, i, 1] * v + outlines[row, i, 2]
        step = outlines[row, i, axis]
        if step > 0.0:
            enters = max(enters, -inside / step)
        elif step < 0.0:
            leaves = min(leaves, -inside / step)
        elif inside < 0.0:
            return 1e9, -1e9
    return (enters, leaves) if enters < leaves else (1e9, -1e9)


@compiled
def _cosine(corners: Any, one: int, other: int) -> float:
    """Cosine of the angle between the normals of two facets."""
    ax, ay, az, a = _normal(corners, one)
    bx, by, bz, b = _normal(corners, other)
    size = np.sqrt(a * b)
    return (ax * bx + ay * by + az * bz) / size if size > 0.0 else 1.0


@compiled
def _normal(corners: Any, row: int) -> tuple[float, float, float, float]:
    """Normal of a facet, of any length, and its squared length."""
    x0, y0, z0 = corners[row, 0, 0], corners[row, 0, 1], corners[row, 0, 2]
    ax, ay, az = corners[row, 1, 0] - x0, corners[row, 1, 1] - y0, corners[row, 1, 2] - z0
    bx, by, bz = corners[row, 2, 0] - x0, corners[row, 2, 1] - y0, corners[row, 2, 2] - z0
    x, y, z = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    return x, y, z, x * x + y * y + z * z
