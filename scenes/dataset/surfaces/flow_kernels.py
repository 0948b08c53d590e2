"""Kernels of the motion and occlusion of the surfaces that pixels show, row by row into the bytes of their files."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.scenes.dataset.surfaces.occlusion_kernels import hide
from uavbench.scenes.dataset.surfaces.shown_kernels import SHOWN, read_near
from uavbench.scenes.dataset.surfaces.surface_files import FLOW_UNITS_PER_PX, FLOW_ZERO, LARGEST_FLOW_PX, UNKNOWN
from uavbench.scenes.png.filters import UP
from uavbench.scenes.rendering.antialiasing.facet_table import FACET_TABLE
from uavbench.trajectories.kernels.argument_types import named_tuple
from uavbench.trajectories.kernels.compiled import compiled
from uavbench.trajectories.kernels.lens import distort
from uavbench.trajectories.pose import Array

LEAST_SLOPE = 1e-6
"""Cosine of the angle to the optical axis from which on a point is before the camera."""
HIGHEST = np.uint16(0x8080)
"""Highest bits of the two bytes of a number."""


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
    (3 w,): their residuals; listed (w,): some columns; near (w,): inverse depths of all, 1/m.
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
    near: Array

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
            np.empty(width),
        )


MOTIONS = named_tuple(Motions, "i1! f3! i1!")
LENS = named_tuple(Lens, "f1! f1!")
ROW_SCRATCH = named_tuple(RowScratch, "f1! f2! f2! f2! f2! u1! h3! h1! j2! j1! f1!")


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
    "shown motions lens (j2 j2) facets scratch (u2! u2!)",
    allocates=False,
    shown=SHOWN,
    motions=MOTIONS,
    lens=LENS,
    facets=FACET_TABLE,
    scratch=ROW_SCRATCH,
)
def flow_rows(shown: Any, motions: Any, lens: Any, later: Any, facets: Any, scratch: Any, out: Any) -> None:
    """Flow to a later image, and occlusion there, of all pixels (h, w).

    later (h', w') and facets: what was rendered later, with its `windows`. out: filtered rows (h, 1 + 6 w) of a
    PNG file, residuals against the row above of u v known in 16 bits, the first byte the higher; and the occlusion
    (h, w), UNKNOWN where it must stay so. A point is HIDDEN where a facet that one of the four rendered pixels around
    it shows is at its place, BEFORE it.
    """
    codes, occlusion = out
    scratch.codes[1] = 0
    rendered = scratch.later if _is_rendered(lens) else scratch.rendered
    for i in range(occlusion.shape[0]):
        _carry_divided(shown, motions, i, scratch)
        _project(lens, i, scratch)
        _code(scratch, i, occlusion[i], codes[i])
        hide(shown, later, facets, i, (rendered, scratch), occlusion[i])


@compiled
def _is_rendered(lens: Any) -> bool:
    """Whether the camera is the pinhole that was rendered."""
    cam, pinhole = lens.camera, lens.pinhole
    same = bool(cam[4] == 0.0)
    for k in range(pinhole.size):
        same &= cam[k] == pinhole[k]
    return same


@compiled
def carry(shown: Any, motions: Any, i: int, scratch: Any) -> None:
    """Points of row i in the frame of the later camera, divided by their depths before; NaN where there is nothing."""
    places, points, near = scratch.places, scratch.points, scratch.near
    read_near(shown, i, near)
    for j in range(near.size):
        places[0, j], places[1, j] = scratch.columns[j], i
    for j in range(shown.places.shape[1]):
        places[0, j], places[1, j] = shown.places[i, j, 0], shown.places[i, j, 1]
    for axis in range(3):
        _carry_axis(motions.camera_from_place[0, axis], places[0], places[1], near, points[axis])
    if _any_moves(shown, motions, i):
        _carry_movers(shown.rows[i], motions, near, places, points)


@compiled
def _any_moves(shown: Any, motions: Any, i: int) -> bool:
    """Whether row i shows anything that moves."""
    some = motions.camera_from_place.shape[0] > 1
    return some and any_between(shown.rows[i], motions.moving[0], motions.moving[1])


@compiled
def _carry_divided(shown: Any, motions: Any, i: int, scratch: Any) -> None:
    """Points as by `carry`, whose first two coordinates are divided by the third."""
    points, near, a = scratch.points, scratch.near, motions.camera_from_place[0]
    if shown.places.shape[1] or _any_moves(shown, motions, i):
        carry(shown, motions, i, scratch)
        for axis in range(2):
            _divide(points[axis], points[2])
    else:
        read_near(shown, i, near)
        _carry_row(a[2], scratch.columns, float(i), near, points[2])
        for axis in range(2):
            _carry_row_divided(a[axis], scratch.columns, float(i), near, points[2], points[axis])


@compiled
def _carry_row(a: Any, u: Any, v: float, near: Any, out: Any) -> None:
    """As by `_carry_axis` of places in one row."""
    first, second, rest, by_nearness = a[0], a[1] * v, a[2], a[3]
    for j in range(out.size):
        out[j] = first * u[j] + second + rest + by_nearness * near[j]


@compiled
def _carry_row_divided(a: Any, u: Any, v: float, near: Any, by: Any, out: Any) -> None:
    """The same, divided by others."""
    first, second, rest, by_nearness = a[0], a[1] * v, a[2], a[3]
    for j in range(out.size):
        out[j] = (first * u[j] + second + rest + by_nearness * near[j]) / by[j]


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
def _project(lens: Any, i: int, scratch: Any) -> None:
    """Places of the points of row i in the later images, and whether their flow is known and fits into the files.

    Those in the rendered image only where it is another one than the camera's.
    """
    cam, pinhole, points, later = lens.camera, lens.pinhole, scratch.points, scratch.later
    for axis in range(2):
        if not _is_rendered(lens):
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
    _code_axis(scratch.later[0], scratch.columns, (1.0, 0.0), known, codes[0])
    _code_axis(scratch.later[1], scratch.columns, (0.0, float(i)), known, codes[1])
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
def _code_axis(later: Any, columns: Any, here: Any, known: Any, out: Any) -> None:
    """Numbers (w,) of a component of the flow in the files, their first byte the higher.

    here: how much a pixel's own place is per column, and in the first one.
    """
    step, begin = here
    for j in range(out.size):
        units = np.int32(np.rint((later[j] - (step * columns[j] + begin)) * FLOW_UNITS_PER_PX)) + np.int32(FLOW_ZERO)
        swapped = ((units >> 8) & 255) | ((units & 255) << 8)
        out[j] = np.uint16(swapped if known[j] else 0)
