"""Kernels that trace the pixels of a camera to the facets that were rendered around them."""

from typing import Any

import numpy as np

from uavbench.scenes.dataset.surfaces.shown_kernels import end_of_run
from uavbench.scenes.rendering.antialiasing.facet_table import FACET_TABLE, nearness, ready
from uavbench.trajectories.kernels.compiled import compiled, inlined

ON_BORDER = 1e-9
"""Tolerance of barycentric coordinates for points on the border of a triangle."""
FARTHEST_BESIDE = 0.1
"""Relative depth by which a plane may differ between a ray beside its facet and the rendered pixel's centre."""


@compiled("j2 facets (i2 i0 u1) f0 j2! f2!", allocates=False, facets=FACET_TABLE)
def trace_centres(seen: Any, facets: Any, tried: Any, background: float, rows: Any, planes: Any) -> None:
    """Facet of each pixel of the camera that was rendered, as by `trace`, and the planes of these: see `Shown`.

    Facets are convex: where both ends of a row's run of pixels that were rendered of a facet lie on it, all do.
    """
    h, w = seen.shape
    planes[0, 0], planes[0, 1], planes[0, 2] = 0.0, 0.0, background
    for i in range(h):
        _copy(seen[i], rows[i])
        begin = 0
        while begin < w:
            facet, end = seen[i, begin], end_of_run(seen[i], begin)
            if facet >= 0:
                if _is_on(facets, facet, begin, i) and _is_on(facets, facet, end - 1, i):
                    _note_plane(facets, facet, planes)
                else:
                    for j in range(begin, end):
                        rows[i, j], _ = _met(seen, facets, (float(j), float(i)), (j, i), (j, i), tried)
                        _note_plane(facets, rows[i, j], planes)
            begin = end


@compiled
def _copy(seen: Any, rows: Any) -> None:
    """Facets (w,) as they were rendered."""
    for j in range(rows.size):
        rows[j] = seen[j]


@compiled
def _note_plane(facets: Any, row: Any, planes: Any) -> None:
    """The plane of a facet, whose outline is there."""
    for k in range(3):
        planes[row + 1, k] = facets.outlines[row, 3, k]


@compiled("j2 f3 facets (i2 i0 u1) f0 j2! f2!", allocates=False, facets=FACET_TABLE)
def trace(seen: Any, places: Any, facets: Any, tried: Any, background: float, rows: Any, near: Any) -> None:
    """Facet and inverse depth, 1/m, of each pixel: the nearest facet rendered around it that its ray passes through.

    seen (h', w'): rendered facets, -1 for none. places (h, w, 2): where the rays of the camera's pixels meet the
    rendered image, px. tried: steps (m, 2) that are added to the rendered pixel left of and above a place; the number
    of the first ones that are tried for every pixel; and 1 for each facet with an alpha mask, else 0. The other steps
    are left out where the first ones show one facet, and the ray meets it. Where they show several, those beyond their
    sides are tried, too. A facet with an alpha mask is met only where it is rendered next to the place: beside it, it
    may have a gap. A ray that misses all facets meets nothing where one of the first ones shows nothing; otherwise it
    has the plane of the facet rendered next to it, and where that plane is too slanted, its depth in the centre.
    Without a facet rows are -1, and the inverse depth that of the background.
    """
    h, w = rows.shape
    for i in range(h):
        for j in range(w):
            u, v = places[i, j, 0], places[i, j, 1]
            next_to = int(np.rint(u)), int(np.rint(v))
            base = int(np.floor(u)), int(np.floor(v))
            rows[i, j], near[i, j] = _met(seen, facets, (u, v), next_to, base, tried)
            if rows[i, j] < 0:
                near[i, j] = background


@compiled
def _met(seen: Any, facets: Any, place: Any, next_to: Any, base: Any, tried: Any) -> tuple[Any, float]:
    """Facet and inverse depth, 1/m, of one place; 0 m^-1 where the plane of its facet is never met."""
    steps, sure, masked = tried
    u, v = place
    h, w = seen.shape
    centre = seen[next_to[1], next_to[0]]
    row, last, nearest, alike, beside_nothing = np.int32(-1), np.int32(-1), 0.0, True, False
    if centre >= 0 and masked[centre]:
        row, nearest = _nearer(facets, centre, place, (row, nearest))
    for number in range(steps.shape[0]):
        if number == sure and alike and (centre < 0 or nearest > 0.0):
            break
        i = min(max(base[1] + steps[number, 1], 0), h - 1)
        j = min(max(base[0] + steps[number, 0], 0), w - 1)
        facet = seen[i, j]
        is_new, last = facet != last, facet
        alike = alike and (number == 0 or not is_new)
        beside_nothing = beside_nothing or (facet < 0 and number < sure and sure > 1)
        if facet < 0 or not is_new or masked[facet]:
            continue
        row, nearest = _nearer(facets, facet, place, (row, nearest))
    if not alike and sure > 1:
        last = np.int32(-1)
        for number in range(sure):
            i = min(max(base[1] + steps[number, 1], 0), h - 1)
            j = min(max(base[0] + steps[number, 0], 0), w - 1)
            facet = seen[i, j]
            if facet >= 0 and facet != last and not masked[facet]:
                row, nearest = _beyond(facets, facet, place, (row, nearest))
            last = facet
    if row < 0 and centre >= 0 and not beside_nothing:
        row = centre
        ready(facets, row)
        nearest = max(nearness(facets.outlines, row, u, v), 0.0)
        there = max(nearness(facets.outlines, row, float(next_to[0]), float(next_to[1])), 0.0)
        if not abs(there - nearest) <= FARTHEST_BESIDE * nearest:
            nearest = there
    return row, nearest


@inlined
def _beyond(facets: Any, facet: int, place: Any, found: Any) -> tuple[Any, float]:
    """What was found of a place, or a facet beyond one or two sides of another one that its ray meets nearer.

    A face that is thinner than a pixel may be rendered nowhere; it is two triangles beside faces that are.
    """
    row, nearest = found
    for way in range(12):
        there = facets.opposite[facet, way // 4]
        if there >= 0 and way % 4 > 0:
            there = facets.opposite[there, way % 4 - 1]
        if there >= 0 and there != facet:
            row, nearest = _nearer(facets, there, place, (row, nearest))
    return row, nearest


@inlined
def _nearer(facets: Any, facet: Any, place: Any, found: Any) -> tuple[Any, float]:
    """A facet and its inverse depth where the ray of a place meets it nearer than what was found, or that."""
    row, nearest = found
    u, v = place
    if _is_on(facets, facet, u, v):
        near = nearness(facets.outlines, facet, u, v)
        if near > nearest:
            row, nearest = np.int32(facet), near
    return row, nearest


@inlined
def _is_on(facets: Any, row: int, u: float, v: float) -> bool:
    """Whether the ray of a place in the image passes through a facet, by its barycentric coordinates."""
    ready(facets, row)
    a, b, c = _side(facets, row, 0, u, v), _side(facets, row, 1, u, v), _side(facets, row, 2, u, v)
    total = a + b + c
    return bool(total > 0.0 and min(a, b, c) >= -ON_BORDER * total)


@compiled
def _side(facets: Any, row: int, side: int, u: float, v: float) -> float:
    """How far a place is inside a side of a facet, as a share of the sum of all three."""
    inside: float = (
        facets.outlines[row, side, 0] * u + facets.outlines[row, side, 1] * v + facets.outlines[row, side, 2]
    )
    return inside
