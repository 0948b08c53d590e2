"""Compiled texture tracking: small patches on known planes, matched by image alignment (Baker & Matthews 2004)."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.tracker.geometry_kernels import camera_centre, normal_row
from uavbench.tracker.order_kernels import sort_falling
from uavbench.tracker.robust.config.patches import AlignmentConfig
from uavbench.tracker.robust.edges.hidden_line_kernels import TRIANGLES, Triangles, hidden, sight_from
from uavbench.tracker.robust.kernel_values import kernel_type
from uavbench.tracker.robust.patches.likeness_kernels import (
    TEXELS,
    Likeness,
    Texels,
    likeness,
    room_for_texels,
    sample,
    sample_texels,
)
from uavbench.tracker.robust.patches.matches import (
    HALF,
    PATCHES,
    SIDE,
    WARP,
    Patches,
    PatchMatches,
    Shift,
    Warp,
)
from uavbench.tracker.robust.view import VIEW, View, is_clear, pixel_of
from uavbench.trajectories.kernels.argument_types import named_tuple
from uavbench.trajectories.kernels.compiled import compiled, inlined
from uavbench.trajectories.kernels.lens import ImagePoint, project
from uavbench.trajectories.pose import Array

BORDER_PX = HALF + 2
"""Least distance from the image border at which a patch is searched: half its size, and 2 px for a larger scale."""
MAX_STEPS, SETTLED_TEXELS = 6, 0.02
"""An alignment ends with a step below a fifth of a patch's error, or after this many steps."""
MAX_COARSE = 6
"""Most patches of a frame with a coarse search, at 49 places: limits its time."""
REACH_TEXELS = 6
"""Half width of the coarse search, in steps of two texels, and largest shift of an alignment: limits its time."""
LEAST_AGE_S = 1e-3
"""Least age of a patch, s: a patch of the current frame has a small but positive weight."""
YOUNG_S = 0.1
"""Age at which the variance of a patch is twice that of an old one, since it may lie on a moving occluder. Measured on
19 flights at 15 Hz: those of one frame are as near to the others as old ones, 0.05 to 0.09 px, except before moving
trees (0.34 px RMS in place of 0.14). With 1 s in its place errors are 4 % larger, with 0.02 s 3 % at 5 Hz.
"""
ALIGNMENT = kernel_type(AlignmentConfig)

Image = NDArray[np.uint8]
Indices = NDArray[np.int64]


@compiled("f1 f2 view alignment", inner=True, allocates=False, view=VIEW, alignment=ALIGNMENT)
def warp(middle: Array, axes: Array, view: View, config: AlignmentConfig) -> Warp:
    """Warp of a patch with its centre (3,) and texel steps (2, 3) into a view; zeros if it is too close."""
    R, t = view.R, view.t
    x = R[0, 0] * middle[0] + R[0, 1] * middle[1] + R[0, 2] * middle[2] + t[0]
    y = R[1, 0] * middle[0] + R[1, 1] * middle[1] + R[1, 2] * middle[2] + t[1]
    z = R[2, 0] * middle[0] + R[2, 1] * middle[1] + R[2, 2] * middle[2] + t[2]
    if z < view.near:
        return Warp(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, False)
    u, v = pixel_of(x, y, z, view)
    right, down = texel(axes, 0, x, y, z, view), texel(axes, 1, x, y, z, view)
    x_right, x_down, y_right, y_down = right.x - u, down.x - u, right.y - v, down.y - v
    area = x_right * y_down - x_down * y_right
    alike = 1.0 < area * config.max_area_change < config.max_area_change * config.max_area_change
    return Warp(u, v, x_right, x_down, y_right, y_down, alike)


@inlined(allocates=False)
def texel(axes: Array, k: int, x: float, y: float, z: float, view: View) -> ImagePoint:
    """Pixel of the texel next to the centre (x, y, z) of a patch, in the frame of the camera, along one of its axes."""
    R = view.R
    xk = x + R[0, 0] * axes[k, 0] + R[0, 1] * axes[k, 1] + R[0, 2] * axes[k, 2]
    yk = y + R[1, 0] * axes[k, 0] + R[1, 1] * axes[k, 1] + R[1, 2] * axes[k, 2]
    zk = z + R[2, 0] * axes[k, 0] + R[2, 1] * axes[k, 1] + R[2, 2] * axes[k, 2]
    return pixel_of(xk, yk, max(zk, view.near), view)


@compiled(
    "patches i0 f2 triangles view i0 alignment",
    patches=PATCHES,
    triangles=TRIANGLES,
    view=VIEW,
    alignment=ALIGNMENT,
)
def choose(
    patches: Patches,
    count: int,
    planes: Array,
    triangles: Triangles,
    view: View,
    most: int,
    config: AlignmentConfig,
) -> Indices:
    """Sorted rows of at most `most` of the first `count` patches that can be found at a pose: those found most often.

    planes (f, 4), triangles: those of the structure, see `EdgeMap`. A patch whose scale has changed too much since its
    creation takes no place of one that can be found.
    """
    middles, face = patches.middles, patches.face
    R, t, cam, size = view.R, view.t, view.lens, view.size_px
    eye = camera_centre(R, t)
    rows = np.empty(count, np.int64)
    n = 0
    for p in range(count):
        f = face[p]
        if planes[f, 0] * eye[0] + planes[f, 1] * eye[1] + planes[f, 2] * eye[2] <= planes[f, 3]:
            continue
        z = R[2, 0] * middles[p, 0] + R[2, 1] * middles[p, 1] + R[2, 2] * middles[p, 2] + t[2]
        if z < view.near:
            continue
        x = R[0, 0] * middles[p, 0] + R[0, 1] * middles[p, 1] + R[0, 2] * middles[p, 2] + t[0]
        y = R[1, 0] * middles[p, 0] + R[1, 1] * middles[p, 1] + R[1, 2] * middles[p, 2] + t[1]
        u, v = project(x, y, z, cam)
        if not (BORDER_PX < u < size[0] - BORDER_PX and BORDER_PX < v < size[1] - BORDER_PX):
            continue
        if not is_clear(u, v, view):
            continue
        rows[n] = p
        n += 1
    rows = rows[:n]
    if n > most:
        sort_falling(rows, patches.hits)
    shown, sight = np.zeros(count, np.int64), sight_from(eye)
    m = 0
    for k in range(n):
        if m == most:
            break
        p = rows[k]
        if not warp(middles[p], patches.axes[p], view, config).alike:
            continue
        if not hidden(sight, middles[p], triangles, face[p], face[p]):
            shown[p] = 1
            m += 1
    chosen = np.empty(m, np.int64)
    m = 0
    for p in range(count):
        if shown[p]:
            chosen[m] = p
            m += 1
    return chosen


class PatchesInView(NamedTuple):
    """Patches, the chosen ones (m,) at a time, their least contrast in grey, and the values of their alignment."""

    patches: Patches
    chosen: Indices
    now_s: float
    least_grey: float
    config: AlignmentConfig


PATCHES_IN_VIEW = named_tuple(PatchesInView, "patches i1! f0 f0 alignment", patches=PATCHES, alignment=ALIGNMENT)


@compiled("u3 given view", given=PATCHES_IN_VIEW, view=VIEW)
def align(image: Image, given: PatchesInView, view: View) -> PatchMatches:
    """Matches of the chosen patches (m,) near their projections in a view.

    Patches whose scale has changed too much since their creation are not searched. The variance grows with the
    difference between a patch and its reference, and is larger for new patches.
    """
    patches, chosen, now_s, least_grey, config = given
    n = len(chosen)
    places = np.empty((n, 3))
    observed, score, variance = np.zeros((n, 2)), np.zeros(n), np.empty(n)
    variance[:] = config.variance_px2
    reach = REACH_TEXELS
    now, around = room_for_texels(), np.empty((SIDE + 2 * reach, SIDE + 2 * reach))
    coarse = 0
    for k in range(n):
        p = chosen[k]
        for i in range(3):
            places[k, i] = patches.middles[p, i]
        at = warp(patches.middles[p], patches.axes[p], view, config)
        if not at.alike:
            score[k] = -1.0
            continue
        ref = patches.texels[p]
        fine = _refine(image, at, 0.0, 0.0, ref, now, least_grey)
        da, db, best, spread = fine.da, fine.db, fine.correlation, fine.spread
        if best < config.min_correlation and coarse < MAX_COARSE:
            coarse += 1
            top, ta, tb = -1.0, 0, 0
            sample(image, at, -float(reach), -float(reach), around)
            for i in range(0, 2 * reach + 1, 2):
                for j in range(0, 2 * reach + 1, 2):
                    value = likeness(around, i, j, ref, least_grey).correlation
                    if value > top:
                        top, ta, tb = value, j - reach, i - reach
            if top > 0.0:
                other = _refine(image, at, float(ta), float(tb), ref, now, least_grey)
                if other.correlation > best:
                    da, db, best = other.da, other.db, other.correlation
        if best >= config.min_correlation:
            score[k] = best
            observed[k, 0] = at.u + at.x_right * da + at.x_down * db
            observed[k, 1] = at.v + at.y_right * da + at.y_down * db
            area = abs(at.x_right * at.y_down - at.x_down * at.y_right)
            variance[k] += 2.0 * (1.0 - best) / (SIDE * SIDE) * spread * area
    for k in range(n):
        variance[k] *= 1.0 + YOUNG_S / max(now_s - patches.taken_s[chosen[k]], LEAST_AGE_S)
    return PatchMatches(places, observed, score, variance)


@compiled("u3 warp f0 f0 f2 texels f0", inner=True, allocates=False, warp=WARP, texels=TEXELS)
def _refine(image: Image, at: Warp, da: float, db: float, ref: Array, now: Texels, least_grey: float) -> Shift:
    """The shift that aligns a patch with its reference `ref`, starting from (da, db); grey values there go to `now`."""
    h00, h01, h11 = 1e-9, 0.0, 1e-9
    for i in range(1, SIDE - 1):
        for j in range(1, SIDE - 1):
            ga, gb = 0.5 * (ref[i, j + 1] - ref[i, j - 1]), 0.5 * (ref[i + 1, j] - ref[i - 1, j])
            h00 += ga * ga
            h01 += ga * gb
            h11 += gb * gb
    det = h00 * h11 - h01 * h01
    if det < 1e-6 * (h00 + h11) ** 2:
        return Shift(da, db, -1.0, 0.0)
    reach, grey = REACH_TEXELS, now.grey
    begin_a, begin_b, found = da, db, Likeness(-1.0, 0.0, 0.0)
    for _ in range(MAX_STEPS):
        sample_texels(image, at, da, db, now)
        found = likeness(grey, 0, 0, ref, least_grey)
        if found.scale == 0.0:
            return Shift(da, db, -1.0, 0.0)
        ea, eb = 0.0, 0.0
        for i in range(1, SIDE - 1):
            for j in range(1, SIDE - 1):
                e = (grey[i, j] - found.mean) * found.scale - ref[i, j]
                ea += 0.5 * (ref[i, j + 1] - ref[i, j - 1]) * e
                eb += 0.5 * (ref[i + 1, j] - ref[i - 1, j]) * e
        step_a, step_b = (h11 * ea - h01 * eb) / det, (h00 * eb - h01 * ea) / det
        da, db = da - step_a, db - step_b
        if abs(da - begin_a) > reach or abs(db - begin_b) > reach:
            return Shift(da, db, -1.0, 0.0)
        if abs(step_a) + abs(step_b) < SETTLED_TEXELS:
            break
    return Shift(da, db, found.correlation, 0.5 * (h00 + h11) / det)


class Hits(NamedTuple):
    """Number of patches that were inliers of a fit, their faces (number,), and whether one was missed too often."""

    number: int
    faces: Indices
    any_lost: bool


@compiled("patches i1 f1 f1 i0", patches=PATCHES)
def count_hits(patches: Patches, chosen: Indices, weights: Array, correlation: Array, most: int) -> Hits:
    """Count hits and misses of the chosen patches (m,), in place; a patch is lost when missed more than `most` times.

    weights (m,): > 0 for inliers; correlation (m,): < 0 for patches that were not searched.
    """
    n, faces, any_lost = 0, np.empty(len(chosen), np.int64), False
    for k in range(len(chosen)):
        p = chosen[k]
        if weights[k] > 0.0:
            faces[n] = patches.face[p]
            n += 1
            patches.hits[p] += 1
            patches.missed[p] = 0
        elif correlation[k] >= 0.0:
            patches.missed[p] += 1
            any_lost |= patches.missed[p] > most
    return Hits(n, faces[:n].copy(), any_lost)


@compiled("patches i0 i1 f1 view alignment", patches=PATCHES, view=VIEW, alignment=ALIGNMENT)
def shift_places(
    patches: Patches, count: int, faces: Indices, twist: Array, view: View, config: AlignmentConfig
) -> None:
    """Shift the patches of the seen faces, rows (f,), on their planes such that their pixels do not change when the
    pose is moved by a twist (6,).
    """
    middles, axes, R, t, cam = patches.middles, patches.axes, view.R, view.t, view.lens
    last = 0
    for p in range(count):
        last = max(last, patches.face[p])
    for face in faces:
        last = max(last, face)
    seen = np.zeros(last + 1, np.bool_)
    for face in faces:
        seen[face] = True
    row, c = np.empty(6), np.empty(3)
    for p in range(count):
        if not seen[patches.face[p]]:
            continue
        at = warp(middles[p], axes[p], view, config)
        det = at.x_right * at.y_down - at.x_down * at.y_right
        if abs(det) < 0.05:
            continue
        for i in range(3):
            c[i] = R[i, 0] * middles[p, 0] + R[i, 1] * middles[p, 1] + R[i, 2] * middles[p, 2] + t[i]
        if c[2] < view.near:
            continue
        du, dv = 0.0, 0.0
        normal_row(c[0], c[1], c[2], 1.0, 0.0, cam, row)
        for i in range(6):
            du -= row[i] * twist[i]
        normal_row(c[0], c[1], c[2], 0.0, 1.0, cam, row)
        for i in range(6):
            dv -= row[i] * twist[i]
        a, b = (at.y_down * du - at.x_down * dv) / det, (at.x_right * dv - at.y_right * du) / det
        for i in range(3):
            middles[p, i] += a * axes[p, 0, i] + b * axes[p, 1, i]
