"""Kernels of geometric antialiasing (Persson 2011): pixels mixed by the places of outlines between them."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.scenes.rendering.antialiasing.border_kernels import borders, one_surface
from uavbench.scenes.rendering.antialiasing.facet_table import FACET_TABLE, ready
from uavbench.scenes.rendering.facets import Rows
from uavbench.trajectories.kernels.argument_types import named_tuple
from uavbench.trajectories.kernels.compiled import compiled
from uavbench.trajectories.pose import Array

BESIDE = 2
"""Row of `BorderRows` of the borders between a pixel and the next one in its row; 0 and 1 are those between rows."""


class BorderRows(NamedTuple):
    """Scratch: the borders, see `Border`, of a row of w pixels with the rows above and below it, and within it.

    places (3, w, 2), 0.5 where there is no border; between (3, w); mixed (2, w): 1 for the pixels of this row and the
    next that have any, else 0; columns (h, w) of some pixels of each row, of which counts (h,) are listed.
    """

    places: Array
    between: Rows
    mixed: NDArray[np.uint8]
    columns: NDArray[np.uint16]
    counts: Rows

    @classmethod
    def of(cls, height: int, width: int) -> "BorderRows":
        """Scratch for an image of a size in px."""
        places, between = np.full((3, width, 2), 0.5), np.empty((3, width), dtype=np.int64)
        columns, counts = np.empty((height, width), dtype=np.uint16), np.empty(height, dtype=np.int64)
        return cls(places, between, np.zeros((2, width), dtype=np.uint8), columns, counts)


BORDER_ROWS = named_tuple(BorderRows, "f3! i2! u2! h2! i1!")


@compiled("u3 s3 facets i1! rows u3!", allocates=False, facets=FACET_TABLE, rows=BORDER_ROWS)
def antialias(color: Any, numbers: Any, facets: Any, seen: Any, rows: Any, out: Any) -> None:
    """Out (h, w, 3) BGR: the square root of the light of each pixel and its neighbours by the share that each covers.

    color (h, w, 4) RGBA is square-root coded and numbers (h, w, 2) are depth and facet + 1, from the bottom row on; out
    has the same colours from the top row on. seen (n + 1,) is scratch for n facets. A facet between two pixels has the
    colour of the last pixel that shows it.
    """
    _list_unlike(numbers, seen, rows)
    for v in range(out.shape[0]):
        _find_borders(numbers, facets, v, seen, rows)
        _mix(color, v, seen, rows, out)


@compiled
def _list_unlike(numbers: Any, seen: Any, rows: Any) -> None:
    """List the pixels of each row whose facet is not that of the one to their right and of the one below.

    seen becomes the last pixel of each facet that begins a run in its row, -1 for none.
    """
    h, w = numbers.shape[0], numbers.shape[1]
    seen[:] = -1
    for y in range(h):
        rows.counts[y] = _unlike(numbers[y], numbers[max(y - 1, 0)], rows.columns[y])
        for k in range(rows.counts[y]):
            u = int(rows.columns[y, k]) + 1
            if u < w and numbers[y, u, 1] != numbers[y, u - 1, 1]:
                seen[int(numbers[y, u, 1])] = y * w + u


@compiled
def _find_borders(numbers: Any, facets: Any, v: int, seen: Any, rows: Any) -> None:
    """Borders of the pixels of row v with those to their right and below them."""
    h, w = numbers.shape[0], numbers.shape[1]
    y, places, between = h - 1 - v, rows.places, rows.between
    below, now, then = 1 - v % 2, rows.mixed[v % 2], rows.mixed[1 - v % 2]
    for k in range(rows.counts[y]):
        u = int(rows.columns[y, k])
        here = numbers[y, u, 1]
        right = numbers[y, u + 1, 1] if u + 1 < w else here
        down = numbers[y - 1, u, 1] if y else here
        row = int(here) - 1
        seen[row + 1] = y * w + u
        other = int(right) - 1
        if right != here and not one_surface(facets, row, other, u + 0.5, float(v)):
            now[u] = now[u + 1] = 1
            ready(facets, row)
            ready(facets, other)
            places[BESIDE, u, 0], places[BESIDE, u, 1], between[BESIDE, u] = borders(facets, row, other, u, v, 0)
        other = int(down) - 1
        if down != here and not one_surface(facets, row, other, float(u), v + 0.5):
            now[u] = then[u] = 1
            ready(facets, row)
            ready(facets, other)
            places[below, u, 0], places[below, u, 1], between[below, u] = borders(facets, row, other, u, v, 1)


@compiled
def _unlike(numbers: Any, under: Any, columns: Any) -> int:
    """List the pixels whose facet is not that of the one to their right and of the one below; returns how many.

    Without a branch, which would often be mispredicted, and with places that need no check for one below 0.
    """
    last, count, one = np.uint64(columns.size - 1), np.uint64(0), np.uint64(1)
    here = numbers[0, 1]
    for u in range(last):
        right = numbers[u + one, 1]
        columns[count] = u
        count += np.uint64((here != right) | (here != under[u, 1]))
        here = right
    columns[count] = last
    count += np.uint64(numbers[last, 1] != under[last, 1])
    return int(count)


@compiled
def _marked(marks: Any, columns: Any) -> int:
    """List where marks (w,) are 1, not 0; returns how many."""
    count: int = 0
    for u in range(marks.size):
        columns[count] = u
        count += marks[u]
    return count


@compiled
def _mix(color: Any, v: int, seen: Any, rows: Any, out: Any) -> None:
    """Mix the pixels of row v that have borders, and clear these borders for the rows to come."""
    h, w = out.shape[0], out.shape[1]
    y, places, between, now = h - 1 - v, rows.places, rows.between, rows.mixed[v % 2]
    above, below = v % 2, 1 - v % 2
    over, under = min(y + 1, h - 1), max(y - 1, 0)
    columns = rows.columns[y]
    count = _marked(now, columns)
    for k in range(count):
        u = int(columns[k])
        before, after = max(u - 1, 0), min(u + 1, w - 1)
        left, left_strip = _beyond(places[BESIDE, before, 0], places[BESIDE, before, 1]) if u else (0.0, 0.0)
        right, right_strip = _beyond(1.0 - places[BESIDE, u, 1], 1.0 - places[BESIDE, u, 0])
        top, top_strip = _beyond(places[above, u, 0], places[above, u, 1])
        bottom, bottom_strip = _beyond(1.0 - places[below, u, 1], 1.0 - places[below, u, 0])
        total = left + right + top + bottom + left_strip + right_strip + top_strip + bottom_strip
        if total == 0.0:
            continue
        rest, scale = max(1.0 - total, 0.0), 1.0 / max(total, 1.0)
        light = _add(color, y, u, rest, (0.0, 0.0, 0.0))
        light = _add(color, y, before, scale * left, light)
        light = _add(color, y, after, scale * right, light)
        light = _add(color, over, u, scale * top, light)
        light = _add(color, under, u, scale * bottom, light)
        for row, share in (
            (between[BESIDE, before], left_strip),
            (between[BESIDE, u], right_strip),
            (between[above, u], top_strip),
            (between[below, u], bottom_strip),
        ):
            if share > 0.0:
                place = seen[row + 1] if seen[row + 1] >= 0 else y * w + u
                light = _add(color, place // w, place % w, scale * share, light)
        for channel in range(3):
            out[v, u, channel] = np.uint8(np.sqrt(light[channel]) + 0.5)
    for k in range(count):
        u = int(columns[k])
        now[u] = 0
        for i in range(2):
            places[BESIDE, u, i] = places[above, u, i] = 0.5


@compiled
def _beyond(begins: float, ends: float) -> tuple[float, float]:
    """Shares of the pixel at 1 on the near side of a strip between two places, and in the strip."""
    return max(begins - 0.5, 0.0), max(ends - 0.5, 0.0) - max(begins - 0.5, 0.0)


@compiled
def _add(color: Any, y: int, u: int, share: float, light: tuple[float, float, float]) -> tuple[float, float, float]:
    """Light BGR, in squared codes, plus a share of the light of a pixel."""
    if share <= 0.0:
        return light
    b, g, r = float(color[y, u, 2]), float(color[y, u, 1]), float(color[y, u, 0])
    return light[0] + share * b * b, light[1] + share * g * g, light[2] + share * r * r


@compiled("s3 u1 s2! u2!", allocates=False)
def depth_and_instances(numbers: Any, instance: Any, depth: Any, instances: Any) -> None:
    """Depth and instances (h, w) from the top row on, of numbers (h, w, 2) as in `antialias`.

    instance (n + 1,) is that of each facet, after that of the background.
    """
    h, w = depth.shape
    for v in range(h):
        row, far, of = numbers[h - 1 - v], depth[v], instances[v]
        for u in range(w):
            far[u] = row[u, 0]
        for u in range(w):
            of[u] = instance[np.uint32(row[u, 1])]


@compiled("s3 j2!", allocates=False)
def facet_rows(numbers: Any, rows: Any) -> None:
    """Facets (h, w) from the top row on, -1 for the background, of numbers (h, w, 2) as in `antialias`."""
    h, w = rows.shape
    for v in range(h):
        row, into = numbers[h - 1 - v], rows[v]
        for u in range(w):
            into[u] = np.int32(row[u, 1]) - np.int32(1)
