"""Kernels of geometric antialiasing (Persson 2011): pixels mixed by the places of outlines between them."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.scenes.rendering.antialiasing.border_kernels import borders, one_surface
from uavbench.scenes.rendering.antialiasing.facet_table import FACET_TABLE, ready
from uavbench.scenes.rendering.facets import Rows
from uavbench.trajectories.kernels.argument_types import named_tuple
from uavbench.trajectories.kernels.compiled import compiled
from uavbench.trajectories.kernels.equal_bytes import AT_ONCE, BITS, equal_bytes, lowest_bit, unlike
from uavbench.trajectories.pose import Array

BESIDE = 2
"""Row of `BorderRows` of the borders between a pixel and the next one in its row; 0 and 1 are those between rows."""

CELL_ROWS, CELL_COLUMNS = 4, 8
"""Size in px of the cells of an image."""
WINDOW_ROWS, WINDOW_COLUMNS = 2, 6
"""Cells of the window that begins with each cell, to its right and below it."""
BORDERED = -2
"""In place of the plane that a window shows: it has borders, or may have some."""


def cells(height: int, width: int) -> tuple[int, int]:
    """Rows and columns of the cells of an image of a size in px."""
    return -(-height // CELL_ROWS), -(-width // CELL_COLUMNS)


class BorderRows(NamedTuple):
    """Scratch: the borders, see `Border`, of a row of w pixels with the rows above and below it, and within it.

    places (3, w, 2), 0.5 where there is no border; between (3, w); mixed (3, w'), in whole words of bytes: 1 for the
    pixels of this row and the next that have any, else 0, and a row of 0; columns (h, w) of some pixels of each row, of
    which counts (h,) are listed; bordered: 1 for the `cells` with a pixel that a border divides from the next one in
    its row or from the one below, at the end for those whose windows have one; windows: see `Pixels`.
    """

    places: Array
    between: Rows
    mixed: NDArray[np.uint8]
    columns: NDArray[np.uint16]
    counts: Rows
    bordered: NDArray[np.uint8]
    windows: NDArray[np.int32]

    @classmethod
    def of(cls, height: int, width: int, windows: NDArray[np.int32]) -> "BorderRows":
        """Scratch for an image of a size in px, and the array of its windows."""
        places, between = np.full((3, width, 2), 0.5), np.empty((3, width), dtype=np.int64)
        columns, counts = np.empty((height, width), dtype=np.uint16), np.empty(height, dtype=np.int64)
        mixed = np.zeros((3, -(-width // BITS) * BITS), dtype=np.uint8)
        return cls(places, between, mixed, columns, counts, np.empty(windows.shape, dtype=np.uint8), windows)


BORDER_ROWS = named_tuple(BorderRows, "f3! i2! u2! h2! i1! u2! j2!")


@compiled("u3 j2 facets i1! rows u3!", allocates=False, facets=FACET_TABLE, rows=BORDER_ROWS)
def antialias(color: Any, shown: Any, facets: Any, seen: Any, rows: Any, out: Any) -> None:
    """Out (h, w, 3) BGR: the square root of the light of each pixel and its neighbours by the share that each covers.

    color (h, w, 4) RGBA is square-root coded, from the bottom row on; out has the same colours, and shown (h, w) the
    facets, from the top row on. seen (n + 1,) is scratch for n facets. A facet between two pixels has the colour of the
    last pixel that shows it.
    """
    _list_unlike(shown, seen, rows)
    rows.bordered[:] = 0
    for v in range(out.shape[0]):
        _find_borders(shown, facets, v, seen, rows)
        _mix(color, v, seen, rows, out)
    _widen(rows.bordered)
    _find_planes(shown, facets.plane, rows)


@compiled
def _widen(bordered: Any) -> None:
    """Turn cells that are 1 where they have borders into those that are 1 where their windows have any."""
    lines, cells = bordered.shape
    for line in range(lines):
        row = bordered[line]
        for step in range(1, WINDOW_ROWS):
            _add_marks(bordered[min(line + step, lines - 1)], row)
        for _ in range(1, WINDOW_COLUMNS):
            _add_marks(row[1:], row[: cells - 1])


@compiled
def _add_marks(marks: Any, row: Any) -> None:
    """Set to 1 where the marks (n,) are."""
    for k in range(row.size):
        row[k] |= marks[k]


@compiled
def _find_planes(shown: Any, plane: Any, rows: Any) -> None:
    """Planes of the windows without borders, which their first pixels show."""
    for line in range(rows.windows.shape[0]):
        for cell in range(rows.windows.shape[1]):
            facet = shown[line * CELL_ROWS, cell * CELL_COLUMNS]
            there = plane[facet] if facet >= 0 else facet
            rows.windows[line, cell] = BORDERED if rows.bordered[line, cell] else there


@compiled
def _list_unlike(shown: Any, seen: Any, rows: Any) -> None:
    """List the pixels of each row whose facet is not that of the one to their right and of the one below.

    seen becomes the last pixel of each facet that begins a run in its row, -1 for none.
    """
    h, w = shown.shape
    data = shown.reshape(-1).view(np.uint8)
    seen[:] = -1
    for v in range(h - 1, -1, -1):
        rows.counts[v] = _unlike(data, v, shown.shape, rows.columns[v])
        for k in range(rows.counts[v]):
            u = int(rows.columns[v, k]) + 1
            if u < w and shown[v, u] != shown[v, u - 1]:
                seen[shown[v, u] + 1] = (h - 1 - v) * w + u


@compiled
def _find_borders(shown: Any, facets: Any, v: int, seen: Any, rows: Any) -> None:
    """Borders of the pixels of row v with those to their right and below them."""
    h, w = shown.shape
    places, between = rows.places, rows.between
    below, now, then = 1 - v % 2, rows.mixed[v % 2], rows.mixed[1 - v % 2]
    bordered = rows.bordered[v // CELL_ROWS]
    for k in range(rows.counts[v]):
        u = int(rows.columns[v, k])
        here = int(shown[v, u])
        right = int(shown[v, u + 1]) if u + 1 < w else here
        down = int(shown[v + 1, u]) if v + 1 < h else here
        seen[here + 1] = (h - 1 - v) * w + u
        if right != here and not one_surface(facets, here, right, u + 0.5, float(v)):
            now[u] = now[u + 1] = bordered[u // CELL_COLUMNS] = 1
            ready(facets, here)
            ready(facets, right)
            places[BESIDE, u, 0], places[BESIDE, u, 1], between[BESIDE, u] = borders(facets, here, right, u, v, 0)
        if down != here and not one_surface(facets, here, down, float(u), v + 0.5):
            now[u] = then[u] = bordered[u // CELL_COLUMNS] = 1
            ready(facets, here)
            ready(facets, down)
            places[below, u, 0], places[below, u, 1], between[below, u] = borders(facets, here, down, u, v, 1)


@compiled
def _unlike(data: Any, v: int, size: Any, columns: Any) -> int:
    """List the pixels of row v whose facet is not that of the one to their right and of the one below.

    Returns how many. data: the bytes of the facets of an image of a size (h, w).
    """
    h, w = size
    stride, count = np.uint64(4 * w), 0
    for first in range(0, w, AT_ONCE):
        here = np.uint64(4 * (v * w + first))
        others = unlike(data, here, here + np.uint64(4), min(w - 1 - first, AT_ONCE))
        if v + 1 < h:
            others |= unlike(data, here, here + stride, min(w - first, AT_ONCE))
        while others != 0:
            columns[count] = first + (np.int64(lowest_bit(others)) >> 2)
            others &= others - np.uint64(1)
            count += 1
    return count


@compiled
def _marked(marks: Any, row: int, columns: Any) -> int:
    """List where a row of marks (3, w') is 1, not 0, as its last row is; returns how many."""
    data, width, count = marks.reshape(-1), np.uint64(marks.shape[1]), 0
    here, zeros = np.uint64(row) * width, np.uint64(2) * width
    for first in range(np.uint64(0), width, np.uint64(BITS)):
        marked = ~equal_bytes(data, here + first, zeros + first)
        while marked != 0:
            columns[count] = first + lowest_bit(marked)
            marked &= marked - np.uint64(1)
            count += 1
    return count


@compiled
def _mix(color: Any, v: int, seen: Any, rows: Any, out: Any) -> None:
    """Mix the pixels of row v that have borders, and clear these borders for the rows to come."""
    h, w = out.shape[0], out.shape[1]
    y, places, between, now = h - 1 - v, rows.places, rows.between, rows.mixed[v % 2]
    above, below = v % 2, 1 - v % 2
    over, under = min(y + 1, h - 1), max(y - 1, 0)
    columns = rows.columns[v]
    count = _marked(rows.mixed, v % 2, columns)
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


@compiled("s3 u1 j2! s2! u2!", allocates=False)
def part_numbers(numbers: Any, instance: Any, facets: Any, depth: Any, instances: Any) -> None:
    """Facets, -1 for none, depth and instances (h, w) from the top row on, of numbers (h, w, 2): depth and facet + 1,
    from the bottom row on.

    instance (n + 1,) is that of each facet, after that of the background. Both numbers of a pixel are loaded as one,
    which becomes vectors.
    """
    h, w = depth.shape
    for v in range(h):
        both, shown, of = numbers[h - 1 - v].reshape(-1).view(np.uint64), facets[v], instances[v]
        far, codes, number = depth[v].view(np.uint32), shown.view(np.uint32), shown.view(np.float32)
        for u in range(w):
            far[u] = np.uint32(both[u] & np.uint64(0xFFFFFFFF))
        for u in range(w):
            codes[u] = np.uint32(both[u] >> np.uint64(32))
        for u in range(w):
            shown[u] = np.int32(number[u]) - np.int32(1)
        for u in range(w):
            of[u] = instance[np.uint32(shown[u] + np.int32(1))]
