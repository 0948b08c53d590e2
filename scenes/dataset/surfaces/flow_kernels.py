"""Kernels of the motion and occlusion of the surfaces that pixels show, row by row into the bytes of their files."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.scenes.dataset.surfaces.surface_files import (
    FLOW_UNITS_PER_PX,
    FLOW_ZERO,
    HIDDEN,
    LARGEST_FLOW_PX,
    OUTSIDE,
    SEEN,
    UNKNOWN,
)
from uavbench.scenes.png.filters import UP
from uavbench.scenes.rendering.antialiasing.facet_table import FACET_TABLE, nearness, ready
from uavbench.trajectories.kernels.argument_types import named_tuple
from uavbench.trajectories.kernels.compiled import compiled, inlined
from uavbench.trajectories.kernels.lens import distort
from uavbench.trajectories.pose import Array

BEFORE = 1e-3
"""Relative depth difference above which a nearer surface occludes a point."""
LEAST_SLOPE = 1e-6
"""Cosine of the angle to the optical axis from which on a point is before the camera."""
HIGHEST = np.uint16(0x8080)
"""Highest bits of the two bytes of a number."""


class Shown(NamedTuple):
    """What the pixels (h, w) of a camera show: facets, -1 for none, and inverse depths, 1/m, 0 for the sky and NaN for
    nothing. places (h, w, 2): where their rays meet the rendered image, px; (h, 0, 2) where it is the camera's own.
    """

    rows: NDArray[np.int32]
    near: Array
    places: Array


class Motions(NamedTuple):
    """mover_of (n,): the row of each facet in camera_from_place (m, 3, 4), of which row 0 is of what rests. They map a
    place u v 1 in the rendered image, px, and its inverse depth to a multiple of its point in the later camera's frame.
    moving (2,): the first facet that moves, and the one after the last.
    """

    mover_of: NDArray[np.int64]
    camera_from_place: Array
    moving: NDArray[np.int64]


class Lens(NamedTuple):
    """The array of a camera, see `camera_array`, and fx fy cx cy of the pinhole that was rendered."""

    camera: Array
    pinhole: Array


class RowScratch(NamedTuple):
    """A row of w pixels: columns (w,), their places (2, w) in the rendered image and points (3, w) in the later
    camera's frame, whose first two coordinates `project` divides by the third.

    later and rendered (2, w): places of the points in the camera's later image and in the rendered one, px; first
    (2, w): the first of the two rendered pixels about them along each axis; known (w,): 1 where there is a flow; codes
    (2, 3, w): the numbers of the files, the first byte the higher, of a row and of the one above it, in turns; words
    (3 w,): their residuals; listed (w,): some columns.
    """

    columns: Array
    places: Array
    points: Array
    later: Array
    rendered: Array
    known: NDArray[np.uint8]
    codes: NDArray[np.uint16]
    words: NDArray[np.uint16]
    first: NDArray[np.int32]
    listed: NDArray[np.int32]

    @classmethod
    def of(cls, width: int) -> "RowScratch":
        """Scratch for rows of a width in px."""
        columns, (two, three) = np.arange(width, dtype=np.float64), (np.empty((n, width)) for n in (2, 3))
        known, codes = np.empty(width, dtype=np.uint8), np.empty((2, 3, width), dtype=np.uint16)
        return cls(
            columns,
            two,
            three,
            np.empty_like(two),
            np.empty_like(two),
            known,
            codes,
            np.empty(3 * width, dtype=np.uint16),
            np.empty((2, width), dtype=np.int32),
            np.empty(width, dtype=np.int32),
        )


SHOWN = named_tuple(Shown, "j2! f2! f3!")
MOTIONS = named_tuple(Motions, "i1! f3! i1!")
LENS = named_tuple(Lens, "f1! f1!")
ROW_SCRATCH = named_tuple(RowScratch, "f1! f2! f2! f2! f2! u1! h3! h1! j2! j1!")


@compiled("shown motions f0 scratch f2! i2!", allocates=False, shown=SHOWN, motions=MOTIONS, scratch=ROW_SCRATCH)
def list_doubtful(shown: Any, motions: Any, widest: float, scratch: Any, points: Any, pixels: Any) -> int:
    """List points too far off-axis for the lens to be known as one-to-one there; returns how many.

    widest: tangent of the angle to the optical axis up to which it is. points (k, 3) and pixels (k, 2), column and row,
    have room for all pixels.
    """
    count: int = 0
    for i in range(shown.rows.shape[0]):
        carry(shown, motions, i, scratch)
        for j in range(shown.rows.shape[1]):
            x, y, z = scratch.points[0, j], scratch.points[1, j], scratch.points[2, j]
            if z > 0 and x * x + y * y > widest * widest * z * z:
                points[count, 0], points[count, 1], points[count, 2] = x, y, z
                pixels[count, 0], pixels[count, 1] = j, i
                count += 1
    return count


@compiled(
    "shown motions lens j2 facets scratch (u2! u2!)",
    allocates=False,
    shown=SHOWN,
    motions=MOTIONS,
    lens=LENS,
    facets=FACET_TABLE,
    scratch=ROW_SCRATCH,
)
def flow_rows(shown: Any, motions: Any, lens: Any, seen: Any, facets: Any, scratch: Any, out: Any) -> None:
    """Flow to a later image, and occlusion there, of all pixels (h, w).

    seen (h', w') and facets: what was rendered later. out: filtered rows (h, 1 + 6 w) of a PNG file, residuals against
    the row above of u v known in 16 bits, the first byte the higher; and the occlusion (h, w), UNKNOWN where it must
    stay so. A point is HIDDEN where a facet that one of the four rendered pixels around it shows is at its place,
    BEFORE it.
    """
    codes, occlusion = out
    scratch.codes[1] = 0
    for i in range(occlusion.shape[0]):
        carry(shown, motions, i, scratch)
        project(lens, i, scratch)
        _code(scratch, i, occlusion[i], codes[i])
        _hide(shown, seen, facets, i, scratch, occlusion[i])


@compiled
def carry(shown: Any, motions: Any, i: int, scratch: Any) -> None:
    """Points of row i in the frame of the later camera, divided by their depths before; NaN where there is nothing."""
    places, points, near = scratch.places, scratch.points, shown.near[i]
    for j in range(near.size):
        places[0, j], places[1, j] = scratch.columns[j], i
    for j in range(shown.places.shape[1]):
        places[0, j], places[1, j] = shown.places[i, j, 0], shown.places[i, j, 1]
    for axis in range(3):
        _carry_axis(motions.camera_from_place[0, axis], places[0], places[1], near, points[axis])
    if any_between(shown.rows[i], motions.moving[0], motions.moving[1]):
        _carry_movers(shown.rows[i], motions, near, places, points)


@compiled
def _carry_axis(a: Any, u: Any, v: Any, near: Any, out: Any) -> None:
    """One coordinate of the points of what rests. Kernels that write one array are compiled to vectors."""
    first, second, rest, by_nearness = a[0], a[1], a[2], a[3]
    for j in range(out.size):
        out[j] = first * u[j] + second * v[j] + rest + by_nearness * near[j]


@compiled("j1 i0 i0", allocates=False)
def any_between(rows: Any, first: int, beyond: int) -> bool:
    """Whether any of the facets (n,) is from a first one on, and before another."""
    low, high, found = np.int32(first), np.int32(beyond), np.int32(0)
    for j in range(rows.size):
        found |= np.int32((rows[j] >= low) & (rows[j] < high))
    return bool(found)


@compiled
def _carry_movers(rows: Any, motions: Any, near: Any, places: Any, points: Any) -> None:
    """Points of what moves."""
    last, mover = np.int32(-1), 0
    for j in range(rows.size):
        if rows[j] != last:
            last = rows[j]
            mover = motions.mover_of[last] if last >= 0 else 0
        if mover:
            for axis in range(3):
                a = motions.camera_from_place[mover, axis]
                points[axis, j] = a[0] * places[0, j] + a[1] * places[1, j] + a[2] + a[3] * near[j]


@compiled
def project(lens: Any, i: int, scratch: Any) -> None:
    """Places of the points of row i in the later images, and whether their flow is known and fits into the files."""
    cam, pinhole, points, later = lens.camera, lens.pinhole, scratch.points, scratch.later
    for axis in range(2):
        _divide(points[axis], points[2])
        _scale(points[axis], pinhole[axis], pinhole[axis + 2], scratch.rendered[axis])
        _scale(points[axis], cam[axis], cam[axis + 2], later[axis])
    if cam[4] != 0.0:
        for j in range(later.shape[1]):
            x, y = distort(points[0, j], points[1, j], cam)
            later[0, j], later[1, j] = cam[0] * x + cam[2], cam[1] * y + cam[3]
    for j in range(later.shape[1]):
        x, y = points[0, j], points[1, j]
        ahead = (points[2, j] > 0.0) & ((x * x + y * y + 1.0) * (LEAST_SLOPE * LEAST_SLOPE) < 1.0)
        fits = (abs(later[0, j] - scratch.columns[j]) < LARGEST_FLOW_PX) & (abs(later[1, j] - i) < LARGEST_FLOW_PX)
        scratch.known[j] = np.uint8(ahead & fits)


@compiled
def _divide(values: Any, by: Any) -> None:
    """Values (n,) divided by others."""
    for j in range(values.size):
        values[j] /= by[j]


@compiled
def _scale(values: Any, factor: float, offset: float, out: Any) -> None:
    """Out = factor * values + offset."""
    for j in range(out.size):
        out[j] = factor * values[j] + offset


@compiled
def _code(scratch: Any, i: int, occlusion: Any, out: Any) -> None:
    """Write a filtered row (1 + 6 w,) of a flow file; where the occlusion is UNKNOWN, no flow is known."""
    known, codes, above, words = scratch.known, scratch.codes[i % 2], scratch.codes[1 - i % 2], scratch.words
    for j in range(known.size):
        known[j] &= np.uint8(occlusion[j] != UNKNOWN)
    _code_axis(scratch.later[0], scratch.columns, known, codes[0])
    _scale(scratch.columns, 0.0, float(i), scratch.places[1])
    _code_axis(scratch.later[1], scratch.places[1], known, codes[1])
    for j in range(known.size):
        codes[2, j] = np.uint16(known[j]) << np.uint16(8)
    for k in range(3):
        _leave_residuals(codes[k], above[k])
    for j in range(known.size):
        words[3 * j], words[3 * j + 1], words[3 * j + 2] = above[0, j], above[1, j], above[2, j]
    out[0], residuals = UP, words.view(np.uint8)
    for k in range(residuals.size):
        out[1 + k] = residuals[k]


@compiled
def _leave_residuals(codes: Any, above: Any) -> None:
    """Replace the numbers above (w,) by the differences of their two bytes to those of others (Warren 2012)."""
    for j in range(above.size):
        here, there = codes[j], above[j]
        above[j] = ((here | HIGHEST) - (there & ~HIGHEST)) ^ ((here ^ ~there) & HIGHEST)


@compiled
def _code_axis(later: Any, here: Any, known: Any, out: Any) -> None:
    """Numbers (w,) of a component of the flow in the files, their first byte the higher."""
    for j in range(out.size):
        units = np.int32(np.rint((later[j] - here[j]) * FLOW_UNITS_PER_PX)) + np.int32(FLOW_ZERO)
        swapped = ((units >> 8) & 255) | ((units & 255) << 8)
        out[j] = np.uint16(swapped if known[j] else 0)


@compiled
def _hide(shown: Any, seen: Any, facets: Any, i: int, scratch: Any, occlusion: Any) -> None:
    """Occlusion (w,) of row i, UNKNOWN where no flow is known."""
    h, w = shown.rows.shape
    later, rendered, first, rows = scratch.later, scratch.rendered, scratch.first, shown.rows[i]
    for j in range(w):
        u, v = later[0, j], later[1, j]
        inside = (u >= -0.5) & (u <= w - 0.5) & (v >= -0.5) & (v <= h - 0.5)
        occlusion[j] = np.uint8((SEEN if inside else OUTSIDE) if scratch.known[j] else UNKNOWN)
    _first_of_two(rendered[0], occlusion, seen.shape[1], first[0])
    _first_of_two(rendered[1], occlusion, seen.shape[0], first[1])
    for k in range(_list_others(seen, first, rows, occlusion, scratch.listed)):
        j = scratch.listed[k]
        near = shown.near[i, j] / scratch.points[2, j]
        if _is_behind(seen, facets, rows[j], (rendered[0, j], rendered[1, j]), near):
            occlusion[j] = HIDDEN


@compiled
def _first_of_two(values: Any, occlusion: Any, size: int, out: Any) -> None:
    """The first of the two pixels about values (w,) of points that are SEEN, within 0 .. size - 2; 0 of others."""
    last = np.float64(size - 2)
    for j in range(out.size):
        first = min(max(np.floor(values[j]), 0.0), last)
        out[j] = np.int32(first if occlusion[j] == SEEN else 0.0)


@compiled
def _list_others(seen: Any, first: Any, rows: Any, occlusion: Any, listed: Any) -> int:
    """List the columns of points that are SEEN where a pixel of the four about them shows another facet; how many.

    Without a branch, which would often be mispredicted.
    """
    facets, width, count = seen.reshape(-1), np.int32(seen.shape[1]), np.uint64(0)
    for j in range(rows.size):
        first[0, j] += width * first[1, j]
    below = np.uint64(width)
    for j in range(np.uint64(rows.size)):
        listed[count] = j
        at, row = np.uint64(first[0, j]), rows[j]
        other = (facets[at] != row) | (facets[at + np.uint64(1)] != row)
        other |= (facets[at + below] != row) | (facets[at + below + np.uint64(1)] != row)
        count += np.uint64(other & (occlusion[j] == SEEN))
    return int(count)


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
    for facet in (seen[top, left], seen[top, right], seen[bottom, left], seen[bottom, right]):
        if (facet < 0) | (facet == row):
            continue
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
