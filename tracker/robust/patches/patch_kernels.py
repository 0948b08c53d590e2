"""Compiled texture: small patches on known planes, found again by aligning them (Baker & Matthews 2004).

A patch is a grid of SIDE x SIDE texels on a plane: its middle (3,), the steps of one texel along its two axes (2, 3) in
metres, and its grey values with mean 0 and norm 1.
"""

import math

import numpy as np
from numpy.typing import NDArray

from uavbench.tracker.geometry_kernels import normal_row, project
from uavbench.tracker.order_kernels import sort_falling
from uavbench.tracker.robust.config.patches import AlignmentConfig
from uavbench.tracker.robust.edges.hidden_line_kernels import hidden
from uavbench.tracker.robust.kernel_values import kernel_type
from uavbench.trajectories.kernels.compiled import compiled
from uavbench.trajectories.pose import Array

SIDE = 9
HALF = (SIDE - 1) / 2
NEAR_M = 0.02
"""Points nearer to the camera's plane than this are not projected."""
ALIGNMENT = kernel_type(AlignmentConfig)

Image = NDArray[np.uint8]
Indices = NDArray[np.int64]


@compiled("u3 f0 f0 f2 f0 f0 f2! f0", inner=True)
def sample_patch(
    image: Image, u: float, v: float, A: Array, da: float, db: float, out: Array, least_grey: float
) -> bool:
    """Texels of a patch shifted by (da, db) texels, mean 0 and norm 1; False outside the image or with less contrast.

    (u, v) is the pixel of its middle, A (2, 2) the px of a texel step along either axis. Green is taken of colours.
    """
    h, w = image.shape[0], image.shape[1]
    channel = 1 if image.shape[2] > 1 else 0
    total = 0.0
    u0 = u + A[0, 0] * (da - HALF) + A[0, 1] * (db - HALF)
    v0 = v + A[1, 0] * (da - HALF) + A[1, 1] * (db - HALF)
    for k in range(4):
        x = u0 + A[0, 0] * (SIDE - 1) * (k & 1) + A[0, 1] * (SIDE - 1) * (k >> 1)
        y = v0 + A[1, 0] * (SIDE - 1) * (k & 1) + A[1, 1] * (SIDE - 1) * (k >> 1)
        if not (0.0 <= x < w - 1.0 and 0.0 <= y < h - 1.0):
            return False
    for i in range(SIDE):
        for j in range(SIDE):
            x = u0 + A[0, 0] * j + A[0, 1] * i
            y = v0 + A[1, 0] * j + A[1, 1] * i
            r, c = int(y), int(x)
            b, a = y - r, x - c
            value = (1 - b) * ((1 - a) * image[r, c, channel] + a * image[r, c + 1, channel]) + b * (
                (1 - a) * image[r + 1, c, channel] + a * image[r + 1, c + 1, channel]
            )
            out[i, j] = value
            total += value
    mean = total / (SIDE * SIDE)
    power = 0.0
    for i in range(SIDE):
        for j in range(SIDE):
            out[i, j] -= mean
            power += out[i, j] * out[i, j]
    if power < least_grey * least_grey * SIDE * SIDE:
        return False
    scale = 1.0 / math.sqrt(power)
    for i in range(SIDE):
        for j in range(SIDE):
            out[i, j] *= scale
    return True


@compiled("f2 f2", inner=True)
def correlation(a: Array, b: Array) -> float:
    """Sum of products of two patches."""
    total = 0.0
    for i in range(SIDE):
        for j in range(SIDE):
            total += a[i, j] * b[i, j]
    return total


@compiled("f1 f2 f2 f1 f1 f2! alignment", inner=True, alignment=ALIGNMENT)
def warp(
    middle: Array, axes: Array, R: Array, t: Array, cam: Array, A: Array, config: AlignmentConfig
) -> tuple[float, float, bool]:
    """Pixel of a patch's middle, its texel steps in px into A (2, 2), and whether it is seen like when it was taken."""
    x = R[0, 0] * middle[0] + R[0, 1] * middle[1] + R[0, 2] * middle[2] + t[0]
    y = R[1, 0] * middle[0] + R[1, 1] * middle[1] + R[1, 2] * middle[2] + t[1]
    z = R[2, 0] * middle[0] + R[2, 1] * middle[1] + R[2, 2] * middle[2] + t[2]
    if z < NEAR_M:
        return 0.0, 0.0, False
    u, v = project(x, y, z, cam)
    for k in range(2):
        xk = x + R[0, 0] * axes[k, 0] + R[0, 1] * axes[k, 1] + R[0, 2] * axes[k, 2]
        yk = y + R[1, 0] * axes[k, 0] + R[1, 1] * axes[k, 1] + R[1, 2] * axes[k, 2]
        zk = z + R[2, 0] * axes[k, 0] + R[2, 1] * axes[k, 1] + R[2, 2] * axes[k, 2]
        u1, v1 = project(xk, yk, max(zk, 0.01), cam)
        A[0, k], A[1, k] = u1 - u, v1 - v
    area = A[0, 0] * A[1, 1] - A[0, 1] * A[1, 0]
    largest = max(abs(A[0, 0]), abs(A[0, 1]), abs(A[1, 0]), abs(A[1, 1]))
    return u, v, config.min_area < area < config.max_area and largest < config.max_stretch


@compiled("i0 f2 i1 i1 f2 f3 i1 f3 i2 f2 f1 f1 f1 i0 f0")
def choose(
    count: int,
    middles: Array,
    face: Indices,
    hits: Indices,
    planes: Array,
    corners: Array,
    owner: Indices,
    boxes: Array,
    nodes: Indices,
    R: Array,
    t: Array,
    cam: Array,
    size: Array,
    most: int,
    border: float,
) -> Indices:
    """Rows of at most `most` patches that a pose shows, those found most often first taken, in order."""
    eye = np.zeros(3)
    for i in range(3):
        for j in range(3):
            eye[i] -= R[j, i] * t[j]
    rows = np.empty(count, np.int64)
    n = 0
    for p in range(count):
        f = face[p]
        if planes[f, 0] * eye[0] + planes[f, 1] * eye[1] + planes[f, 2] * eye[2] <= planes[f, 3]:
            continue
        z = R[2, 0] * middles[p, 0] + R[2, 1] * middles[p, 1] + R[2, 2] * middles[p, 2] + t[2]
        if z < NEAR_M:
            continue
        x = R[0, 0] * middles[p, 0] + R[0, 1] * middles[p, 1] + R[0, 2] * middles[p, 2] + t[0]
        y = R[1, 0] * middles[p, 0] + R[1, 1] * middles[p, 1] + R[1, 2] * middles[p, 2] + t[1]
        u, v = project(x, y, z, cam)
        if not (border < u < size[0] - border and border < v < size[1] - border):
            continue
        rows[n] = p
        n += 1
    rows = rows[:n]
    if n > most:
        sort_falling(rows, hits)
    shown = np.zeros(count, np.bool_)
    m = 0
    for k in range(n):
        if m == most:
            break
        if not hidden(eye, middles[rows[k]], corners, owner, boxes, nodes, face[rows[k]], face[rows[k]]):
            shown[rows[k]] = True
            m += 1
    return np.flatnonzero(shown)


@compiled("u3 f2 f3 f3 i1 f2 f1 f1 alignment", alignment=ALIGNMENT)
def align(
    image: Image,
    middles: Array,
    axes: Array,
    texels: Array,
    chosen: Indices,
    R: Array,
    t: Array,
    cam: Array,
    config: AlignmentConfig,
) -> tuple[Array, Array, Array]:
    """Pixels (n, 2) at which the chosen patches are found near where a pose puts them, with correlation and variance.

    The correlation (n,) is 0 where a patch is not found, -1 where it is seen too differently from when it was taken.
    The variance (n,) in px^2 is that of a place along either axis, by how much of a patch is not as it was.
    """
    n = len(chosen)
    observed, score, variance = np.zeros((n, 2)), np.zeros(n), np.full(n, config.variance_px2)
    reach, least = config.reach_texels, config.min_contrast_grey
    A = np.empty((2, 2))
    now = np.empty((SIDE, SIDE))
    coarse = 0
    for k in range(n):
        p = chosen[k]
        u, v, alike = warp(middles[p], axes[p], R, t, cam, A, config)
        if not alike:
            score[k] = -1.0
            continue
        ref = texels[p]
        da, db, best, spread = _refine(image, u, v, A, 0.0, 0.0, ref, now, config)
        if best < config.min_correlation and coarse < config.max_coarse:
            coarse += 1
            top, ta, tb = -1.0, 0, 0
            for i in range(-reach, reach + 1, 2):
                for j in range(-reach, reach + 1, 2):
                    if sample_patch(image, u, v, A, float(j), float(i), now, least):
                        value = correlation(now, ref)
                        if value > top:
                            top, ta, tb = value, j, i
            if top > config.coarse_correlation:
                ca, cb, value, _ = _refine(image, u, v, A, float(ta), float(tb), ref, now, config)
                if value > best:
                    da, db, best = ca, cb, value
        if best >= config.min_correlation:
            score[k] = best
            observed[k, 0] = u + A[0, 0] * da + A[0, 1] * db
            observed[k, 1] = v + A[1, 0] * da + A[1, 1] * db
            area = abs(A[0, 0] * A[1, 1] - A[0, 1] * A[1, 0])
            variance[k] += 2.0 * (1.0 - best) / (SIDE * SIDE) * spread * area
    return observed, score, variance


@compiled("u3 f0 f0 f2 f0 f0 f2 f2! alignment", inner=True, alignment=ALIGNMENT)
def _refine(
    image: Image,
    u: float,
    v: float,
    A: Array,
    da: float,
    db: float,
    ref: Array,
    now: Array,
    config: AlignmentConfig,
) -> tuple[float, float, float, float]:
    """Shift (da, db) in texels that aligns a patch with its reference, their correlation there, and its spread.

    The spread is the mean variance of da and db for texels that differ by a variance of one.
    """
    h00, h01, h11 = 1e-9, 0.0, 1e-9
    for i in range(1, SIDE - 1):
        for j in range(1, SIDE - 1):
            ga, gb = 0.5 * (ref[i, j + 1] - ref[i, j - 1]), 0.5 * (ref[i + 1, j] - ref[i - 1, j])
            h00 += ga * ga
            h01 += ga * gb
            h11 += gb * gb
    det = h00 * h11 - h01 * h01
    if det < 1e-6 * (h00 + h11) ** 2:
        return da, db, -1.0, 0.0
    reach, longest, least = config.reach_texels, config.max_step_texels, config.min_contrast_grey
    begin_a, begin_b = da, db
    for _ in range(config.max_steps):
        if not sample_patch(image, u, v, A, da, db, now, least):
            return da, db, -1.0, 0.0
        ea, eb = 0.0, 0.0
        for i in range(1, SIDE - 1):
            for j in range(1, SIDE - 1):
                e = now[i, j] - ref[i, j]
                ea += 0.5 * (ref[i, j + 1] - ref[i, j - 1]) * e
                eb += 0.5 * (ref[i + 1, j] - ref[i - 1, j]) * e
        step_a, step_b = (h11 * ea - h01 * eb) / det, (h00 * eb - h01 * ea) / det
        da -= max(-longest, min(longest, step_a))
        db -= max(-longest, min(longest, step_b))
        if abs(da - begin_a) > reach or abs(db - begin_b) > reach:
            return da, db, -1.0, 0.0
        if abs(step_a) + abs(step_b) < config.settled_texels:
            break
    return da, db, correlation(now, ref), 0.5 * (h00 + h11) / det


@compiled("i1 f1 f1 i1! i1! i0")
def count_hits(
    chosen: Indices, weights: Array, found: Array, hits: Indices, missed: Indices, most: int
) -> tuple[int, bool]:
    """Number of chosen patches with weight, and whether one was missed more than `most` times; counts both in place."""
    n, tired = 0, False
    for k in range(len(chosen)):
        p = chosen[k]
        if weights[k] > 0.0:
            n += 1
            hits[p] += 1
            missed[p] = 0
        elif found[k] >= 0.0:
            missed[p] += 1
            tired |= missed[p] > most
    return n, tired


@compiled("i0 f2! f3 f1 f2 f1 f1 alignment", alignment=ALIGNMENT)
def shift_places(
    count: int,
    middles: Array,
    axes: Array,
    twist: Array,
    R: Array,
    t: Array,
    cam: Array,
    config: AlignmentConfig,
) -> None:
    """Move the patches on their planes so that a pose moved by -twist (6,) sees them where it saw them."""
    A = np.empty((2, 2))
    row, c = np.empty(6), np.empty(3)
    for p in range(count):
        warp(middles[p], axes[p], R, t, cam, A, config)
        det = A[0, 0] * A[1, 1] - A[0, 1] * A[1, 0]
        if abs(det) < 0.05:
            continue
        for i in range(3):
            c[i] = R[i, 0] * middles[p, 0] + R[i, 1] * middles[p, 1] + R[i, 2] * middles[p, 2] + t[i]
        if c[2] < NEAR_M:
            continue
        du, dv = 0.0, 0.0
        normal_row(c[0], c[1], c[2], 1.0, 0.0, cam, row)
        for i in range(6):
            du -= row[i] * twist[i]
        normal_row(c[0], c[1], c[2], 0.0, 1.0, cam, row)
        for i in range(6):
            dv -= row[i] * twist[i]
        a, b = (A[1, 1] * du - A[0, 1] * dv) / det, (A[0, 0] * dv - A[1, 0] * du) / det
        for i in range(3):
            middles[p, i] += a * axes[p, 0, i] + b * axes[p, 1, i]
