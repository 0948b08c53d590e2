"""Kernels of what hides surface points from a later camera: facets at their places in its image, before them."""

from typing import Any

import numpy as np

from uavbench.scenes.dataset.surfaces.surface_files import HIDDEN, OUTSIDE, SEEN, UNKNOWN
from uavbench.scenes.rendering.antialiasing.coverage import (
    CELL_COLUMNS,
    CELL_ROWS,
    WINDOW_COLUMNS,
    WINDOW_ROWS,
)
from uavbench.scenes.rendering.antialiasing.facet_table import nearness, ready
from uavbench.trajectories.kernels.compiled import compiled, inlined
from uavbench.trajectories.kernels.equal_bytes import AT_ONCE, lowest_bit, unlike

BEFORE = 1e-3
"""Relative depth difference above which a nearer surface occludes a point."""
GROUP = 2 * AT_ONCE
"""Pixels of a row that are looked at together."""


@compiled
def hide(shown: Any, image: Any, facets: Any, i: int, row: Any, occlusion: Any) -> None:
    """Occlusion (w,) of row i, UNKNOWN where no flow is known.

    image: facets that were rendered later, and its `windows`; row: places (2, w) in it, and `RowScratch`.
    """
    (seen, _), (rendered, scratch) = image, row
    h, w = shown.rows.shape
    later, rows = scratch.later, shown.rows[i]
    for j in range(w):
        u, v = later[0, j], later[1, j]
        inside = (u >= -0.5) & (u <= w - 0.5) & (v >= -0.5) & (v <= h - 0.5)
        occlusion[j] = np.uint8((SEEN if inside else OUTSIDE) if scratch.known[j] else UNKNOWN)
    grouped = shown.places.shape[1] == 0
    for k in range(_list_others(image, facets.plane, (rows, rendered, grouped), occlusion, scratch)):
        j = scratch.listed[k]
        near = scratch.near[j] / scratch.points[2, j]
        if _is_behind(seen, facets, rows[j], (rendered[0, j], rendered[1, j]), near):
            occlusion[j] = HIDDEN


@inlined
def _list_others(image: Any, plane: Any, row: Any, occlusion: Any, scratch: Any) -> int:
    """List the columns of points that are SEEN where a pixel of the four about them shows another facet; how many.

    row: facets (w,), places (2, w), and whether all points lie in their facets' planes: then groups of pixels that are
    in one plane, as is all about their places, are left out.
    """
    (seen, _), (rows, rendered, grouped), first = image, row, scratch.first
    count = np.uint64(0)
    for begin in range(np.uint64(0), np.uint64(rows.size), np.uint64(GROUP)):
        end = min(begin + np.uint64(GROUP), np.uint64(rows.size))
        if grouped and end - begin == GROUP and _in_one_plane(image, plane, (rows, rendered), occlusion, begin):
            continue
        for axis in range(2):
            size = seen.shape[1 - axis]
            _first_of_two(rendered[axis, begin:end], occlusion[begin:end], size, first[axis, begin:end])
        count = _list_in_group(seen, (rows, first), occlusion, (begin, end), count, scratch.listed)
    return int(count)


@compiled
def _first_of_two(values: Any, occlusion: Any, size: int, out: Any) -> None:
    """The first of the two pixels about values (n,) of points that are SEEN, within 0 .. size - 2; 0 of others."""
    last = np.float64(size - 2)
    for j in range(out.size):
        first = min(max(np.floor(values[j]), 0.0), last)
        out[j] = np.int32(first if occlusion[j] == SEEN else 0.0)


@inlined
def _list_in_group(seen: Any, row: Any, occlusion: Any, group: Any, count: Any, listed: Any) -> Any:
    """List those of a group, without a branch for each, which would often be mispredicted; how many are listed then.

    row: facets (w,), and the first two pixels about their places (2, w).
    """
    rows, first = row
    facets, width = seen.reshape(-1), np.uint64(seen.shape[1])
    for j in range(group[0], group[1]):
        listed[count] = j
        at, facet = np.uint64(first[1, j]) * width + np.uint64(first[0, j]), rows[j]
        other = (facets[at] != facet) | (facets[at + np.uint64(1)] != facet)
        other |= (facets[at + width] != facet) | (facets[at + width + np.uint64(1)] != facet)
        count += np.uint64(other & (occlusion[j] == SEEN))
    return count


@inlined
def _in_one_plane(image: Any, plane: Any, row: Any, occlusion: Any, begin: Any) -> bool:
    """Whether a group of pixels shows one plane, as do all pixels about their places, which lie on a line in order.

    row: facets (w,), and their places (2, w).
    """
    (_, windows), (rows, rendered) = image, row
    end = begin + np.uint64(GROUP - 1)
    if (occlusion[begin] != SEEN) | (occlusion[end] != SEEN):
        return False
    data = rows.view(np.uint8)
    for part in (begin, end - np.uint64(AT_ONCE)):
        others = unlike(data, np.uint64(4) * part, np.uint64(4) * part + np.uint64(4), AT_ONCE)
        while others != 0:
            j = part + (lowest_bit(others) >> np.uint64(2))
            if not _is_one_plane(plane, rows[j], rows[j + np.uint64(1)]):
                return False
            others &= others - np.uint64(1)
    left, right = _between(rendered[0, begin], rendered[0, end])
    top, bottom = _between(rendered[1, begin], rendered[1, end])
    line, cell = top // np.uint64(CELL_ROWS), left // np.uint64(CELL_COLUMNS)
    beyond = (bottom // np.uint64(CELL_ROWS) >= line + np.uint64(WINDOW_ROWS)) | (
        right // np.uint64(CELL_COLUMNS) >= cell + np.uint64(WINDOW_COLUMNS)
    )
    facet = rows[begin]
    return bool(not beyond and windows[line, cell] == (plane[facet] if facet >= 0 else facet))


@compiled
def _between(one: float, other: float) -> Any:
    """The first pixel, and the last one, about places from the one to the other, without a sign."""
    return np.uint64(max(min(one, other), 0.0)), np.uint64(max(one, other) + 1.0)


@compiled
def _is_one_plane(plane: Any, here: Any, there: Any) -> bool:
    """Whether two facets, -1 for none, are the same, or of one plane."""
    return bool(here == there or (here >= 0 and there >= 0 and plane[here] == plane[there]))


@inlined
def _is_behind(seen: Any, facets: Any, row: Any, place: Any, near: float) -> bool:
    """Whether a facet that one of the four rendered pixels around a place, px, shows is at that place before a point's.

    near: the inverse depth of the point there, 1/m. Beyond the image its first or last pixels count.
    """
    u, v = place
    column, line = int(np.floor(u)), int(np.floor(v))
    left, right = _clipped(column, seen.shape[1]), _clipped(column + 1, seen.shape[1])
    top, bottom = _clipped(line, seen.shape[0]), _clipped(line + 1, seen.shape[0])
    outlines = facets.outlines
    last = row
    for facet in (seen[top, left], seen[top, right], seen[bottom, left], seen[bottom, right]):
        if (facet < 0) | (facet == row) | (facet == last):
            continue
        last = facet
        if np.isnan(outlines[facet, 3, 2]):
            ready(facets, facet)
        if near < (1 - BEFORE) * nearness(outlines, facet, u, v) and _covers(outlines, facet, u, v):
            return True
    return False


@inlined
def _covers(outlines: Any, facet: Any, u: float, v: float) -> bool:
    """Whether a facet is at a place in the image."""
    inside = True
    for i in range(3):
        inside &= outlines[facet, i, 0] * u + outlines[facet, i, 1] * v + outlines[facet, i, 2] >= 0.0
    return inside


@compiled
def _clipped(place: int, size: int) -> Any:
    """A place within 0 .. size - 1, without a sign."""
    return np.uint64(min(max(place, 0), size - 1))
