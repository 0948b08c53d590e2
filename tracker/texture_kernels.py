"""Compiled texture: small patches on known planes, found again by aligning them (Baker & Matthews 2004).

A patch is a grid of SIDE x SIDE texels on a plane: its middle (3,), the steps of one texel along its two axes (2, 3) in
metres, and its grey values with mean 0 and norm 1.
"""

import math

import numpy as np
from numpy.typing import NDArray

from tracker.compiled import compiled
from tracker.geometry_kernels import normal_row, project
from trajectories.pose import Array

SIDE = 9
HALF = (SIDE - 1) / 2
STEPS = 8
"""Most Gauss-Newton steps of an alignment."""
REACH_TEXELS = 6
"""Half width of the coarse search when the first alignment fails."""
AGREES = 0.85
"""Least correlation of a patch that counts as found."""

Image = NDArray[np.uint8]
Indices = NDArray[np.int64]


@compiled
def sample_patch(image: Image, u: float, v: float, A: Array, da: float, db: float, out: Array) -> bool:
    """Texels of a patch shifted by (da, db) texels, mean 0 and norm 1; False outside the image or without contrast.

    (u, v) is the pixel of its middle, A (2, 2) the px of a texel step along either axis.
    """
    h, w = image.shape[0], image.shape[1]
    total = 0.0
    for i in range(SIDE):
        for j in range(SIDE):
            x = u + A[0, 0] * (j - HALF + da) + A[0, 1] * (i - HALF + db)
            y = v + A[1, 0] * (j - HALF + da) + A[1, 1] * (i - HALF + db)
            if not (0.0 <= x < w - 1.0 and 0.0 <= y < h - 1.0):
                return False
            r, c = int(y), int(x)
            b, a = y - r, x - c
            value = (1 - b) * ((1 - a) * image[r, c, 1] + a * image[r, c + 1, 1]) + b * (
                (1 - a) * image[r + 1, c, 1] + a * image[r + 1, c + 1, 1]
            )
            out[i, j] = value
            total += value
    mean = total / (SIDE * SIDE)
    power = 0.0
    for i in range(SIDE):
        for j in range(SIDE):
            out[i, j] -= mean
            power += out[i, j] * out[i, j]
    if power < 9.0 * SIDE * SIDE:  # less than 3 grey levels of contrast is mostly noise
        return False
    scale = 1.0 / math.sqrt(power)
    for i in range(SIDE):
        for j in range(SIDE):
            out[i, j] *= scale
    return True


@compiled
def correlation(a: Array, b: Array) -> float:
    """Sum of products of two patches."""
    total = 0.0
    for i in range(SIDE):
        for j in range(SIDE):
            total += a[i, j] * b[i, j]
    return total


@compiled
def align(
    image: Image, middles: Array, axes: Array, texels: Array, chosen: Indices, R: Array, t: Array, cam: Array
) -> tuple[Array, Array]:
    """Pixels (n, 2) at which the chosen patches are found near where a pose puts them, and their correlation (n,).

    The correlation is 0 where a patch is not found, -1 where it is seen too differently from when it was taken.
    """
    n = len(chosen)
    observed, score = np.zeros((n, 2)), np.zeros(n)
    c = np.empty(3)
    A = np.empty((2, 2))
    now = np.empty((SIDE, SIDE))
    for k in range(n):
        p = chosen[k]
        for i in range(3):
            c[i] = R[i, 0] * middles[p, 0] + R[i, 1] * middles[p, 1] + R[i, 2] * middles[p, 2] + t[i]
        if c[2] < 0.02:
            score[k] = -1.0
            continue
        u, v = project(c[0], c[1], c[2], cam)
        for axis in range(2):
            x, y, z = c[0], c[1], c[2]
            for i in range(3):
                x += R[0, i] * axes[p, axis, i]
                y += R[1, i] * axes[p, axis, i]
                z += R[2, i] * axes[p, axis, i]
            u1, v1 = project(x, y, max(z, 0.01), cam)
            A[0, axis], A[1, axis] = u1 - u, v1 - v
        area = A[0, 0] * A[1, 1] - A[0, 1] * A[1, 0]
        largest = max(abs(A[0, 0]), abs(A[0, 1]), abs(A[1, 0]), abs(A[1, 1]))
        if not (0.35 < area < 3.0 and largest < 2.0):
            score[k] = -1.0
            continue
        ref = texels[p]
        da, db = 0.0, 0.0
        best = -1.0
        if sample_patch(image, u, v, A, 0.0, 0.0, now):
            da, db, best = _refine(image, u, v, A, 0.0, 0.0, ref, now)
        if best < AGREES:
            top, ta, tb = -1.0, 0, 0
            for i in range(-REACH_TEXELS, REACH_TEXELS + 1, 2):
                for j in range(-REACH_TEXELS, REACH_TEXELS + 1, 2):
                    if sample_patch(image, u, v, A, float(j), float(i), now):
                        value = correlation(now, ref)
                        if value > top:
                            top, ta, tb = value, j, i
            if top > 0.4:
                ca, cb, value = _refine(image, u, v, A, float(ta), float(tb), ref, now)
                if value > best:
                    da, db, best = ca, cb, value
        if best >= AGREES:
            score[k] = best
            observed[k, 0] = u + A[0, 0] * da + A[0, 1] * db
            observed[k, 1] = v + A[1, 0] * da + A[1, 1] * db
    return observed, score


@compiled
def _refine(
    image: Image, u: float, v: float, A: Array, da: float, db: float, ref: Array, now: Array
) -> tuple[float, float, float]:
    """Shift (da, db) in texels that aligns a patch with its reference, and their correlation there."""
    h00, h01, h11 = 1e-9, 0.0, 1e-9
    for i in range(1, SIDE - 1):
        for j in range(1, SIDE - 1):
            ga, gb = 0.5 * (ref[i, j + 1] - ref[i, j - 1]), 0.5 * (ref[i + 1, j] - ref[i - 1, j])
            h00 += ga * ga
            h01 += ga * gb
            h11 += gb * gb
    det = h00 * h11 - h01 * h01
    if det < 1e-6 * (h00 + h11) ** 2:
        return da, db, -1.0
    for _ in range(STEPS):
        if not sample_patch(image, u, v, A, da, db, now):
            return da, db, -1.0
        ea, eb = 0.0, 0.0
        for i in range(1, SIDE - 1):
            for j in range(1, SIDE - 1):
                e = now[i, j] - ref[i, j]
                ea += 0.5 * (ref[i, j + 1] - ref[i, j - 1]) * e
                eb += 0.5 * (ref[i + 1, j] - ref[i - 1, j]) * e
        step_a, step_b = (h11 * ea - h01 * eb) / det, (h00 * eb - h01 * ea) / det
        da -= max(-1.5, min(1.5, step_a))
        db -= max(-1.5, min(1.5, step_b))
        if abs(da) > REACH_TEXELS + 2 or abs(db) > REACH_TEXELS + 2:
            return da, db, -1.0
        if abs(step_a) + abs(step_b) < 0.01:
            break
    if not sample_patch(image, u, v, A, da, db, now):
        return da, db, -1.0
    return da, db, correlation(now, ref)


@compiled
def patch_rows(middles: Array, chosen: Indices, observed: Array, R: Array, t: Array, cam: Array) -> tuple[Array, Array]:
    """Displacements (n, 2) in px from a pose's projection to where patches were observed (n, 2), and J (n, 2, 6)."""
    n = len(chosen)
    moved, J = np.full((n, 2), np.inf), np.zeros((n, 2, 6))
    c = np.empty(3)
    for k in range(n):
        p = chosen[k]
        for i in range(3):
            c[i] = R[i, 0] * middles[p, 0] + R[i, 1] * middles[p, 1] + R[i, 2] * middles[p, 2] + t[i]
        if c[2] < 0.02:
            continue
        u, v = project(c[0], c[1], c[2], cam)
        moved[k, 0], moved[k, 1] = observed[k, 0] - u, observed[k, 1] - v
        normal_row(c[0], c[1], c[2], 1.0, 0.0, cam, J[k, 0])
        normal_row(c[0], c[1], c[2], 0.0, 1.0, cam, J[k, 1])
    return moved, J


@compiled
def first_hit(eye: Array, rays: Array, corners: Array, owner: Indices) -> tuple[Indices, Array]:
    """The face (n,) that each ray (n, 3) from the eye meets first, -1 for none, and the distance (n,) in rays."""
    n = len(rays)
    face, near = np.full(n, -1), np.full(n, np.inf)
    for m in range(len(corners)):
        e, f, s = corners[m, 1] - corners[m, 0], corners[m, 2] - corners[m, 0], eye - corners[m, 0]
        q0 = s[1] * e[2] - s[2] * e[1]
        q1 = s[2] * e[0] - s[0] * e[2]
        q2 = s[0] * e[1] - s[1] * e[0]
        along = f[0] * q0 + f[1] * q1 + f[2] * q2
        for k in range(n):
            d0, d1, d2 = rays[k, 0], rays[k, 1], rays[k, 2]
            p0, p1, p2 = d1 * f[2] - d2 * f[1], d2 * f[0] - d0 * f[2], d0 * f[1] - d1 * f[0]
            det = e[0] * p0 + e[1] * p1 + e[2] * p2
            if det == 0.0:
                continue
            a = (s[0] * p0 + s[1] * p1 + s[2] * p2) / det
            b = (d0 * q0 + d1 * q1 + d2 * q2) / det
            if a >= 0.0 and b >= 0.0 and a + b <= 1.0 and 1e-6 < along / det < near[k]:
                near[k] = along / det
                face[k] = owner[m]
    return face, near
