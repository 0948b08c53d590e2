"""Compiled geometry: SO(3) and SE(3), clipping, small linear systems.

A camera is an array (11,); see `scenes.camera.camera_array`.
"""

import math
from typing import NamedTuple

import numpy as np

from uavbench.trajectories.kernels.compiled import compiled, inlined
from uavbench.trajectories.kernels.lens import distort
from uavbench.trajectories.pose import Array


class RigidMotion(NamedTuple):
    """Rotation matrix R (3, 3) and translation t (3,)."""

    R: Array
    t: Array


@inlined(allocates=False)
def normal_row(x: float, y: float, z: float, nx: float, ny: float, cam: Array, row: Array) -> None:
    """Motion in px along the image normal (nx, ny) per unit of a twist of the camera, into row (6,)."""
    a, b = x / z, y / z
    gu, gv = cam[0] * nx, cam[1] * ny
    if cam[4] == 0.0:
        ga, gb = gu, gv
    else:
        h = 1e-5
        u0, v0 = distort(a - h, b, cam)
        u1, v1 = distort(a + h, b, cam)
        ga = (gu * (u1 - u0) + gv * (v1 - v0)) / (2 * h)
        u0, v0 = distort(a, b - h, cam)
        u1, v1 = distort(a, b + h, cam)
        gb = (gu * (u1 - u0) + gv * (v1 - v0)) / (2 * h)
    g0, g1 = ga / z, gb / z
    g2 = -(g0 * x + g1 * y) / z
    row[0], row[1], row[2] = g0, g1, g2
    row[3] = y * g2 - z * g1
    row[4] = z * g0 - x * g2
    row[5] = x * g1 - y * g0


class SharesInside(NamedTuple):
    """Shares of a segment at which its part inside starts and ends."""

    start: float
    end: float


class Point(NamedTuple):
    """A point or a ray by its numbers, which a processor keeps in its registers, as it does not those of an array."""

    x: float
    y: float
    z: float


@inlined(allocates=False)
def clip_segment(a: Point, b: Point, planes: Array) -> SharesInside:
    """Shares of the segment a-b at which its part inside all planes (k, 4) starts and ends; start >= end: none.

    A point p is inside where n . p + d >= 0 (Liang & Barsky 1984).
    """
    low, high = 0.0, 1.0
    for k in range(len(planes)):
        da = planes[k, 0] * a[0] + planes[k, 1] * a[1] + planes[k, 2] * a[2] + planes[k, 3]
        db = planes[k, 0] * b[0] + planes[k, 1] * b[1] + planes[k, 2] * b[2] + planes[k, 3]
        if da < 0.0 and db < 0.0:
            return SharesInside(2.0, high)
        if da < 0.0:
            low = max(low, da / (da - db))
        elif db < 0.0:
            high = min(high, da / (da - db))
    return SharesInside(low, high)


class RotationTerms(NamedTuple):
    """sin a / a, (1 - cos a) / a^2 and (a - sin a) / a^3 of an angle a."""

    sine: float
    cosine: float
    cubic: float


@compiled("f0", inner=True, allocates=False)
def rodrigues(angle2: float) -> RotationTerms:
    """The terms sin a / a, (1 - cos a) / a^2 and (a - sin a) / a^3 of a squared angle a^2."""
    angle = math.sqrt(angle2)
    if angle < 1e-6:
        return RotationTerms(1.0 - angle2 / 6, 0.5 - angle2 / 24, 1.0 / 6 - angle2 / 120)
    a = math.sin(angle) / angle
    return RotationTerms(a, (1.0 - math.cos(angle)) / angle2, (1.0 - a) / angle2)


@compiled("f1~ f0 f0 f0", inner=True)
def combination(phi: Array, one: float, s: float, c: float) -> Array:
    """The matrix one I + s [phi]x + c [phi]x [phi]x: a rotation or a Jacobian of SO(3), by its coefficients."""
    x, y, z = phi[0], phi[1], phi[2]
    return np.array([
        [one - c * (y * y + z * z), c * (x * y) - s * z, c * (x * z) + s * y],
        [c * (x * y) + s * z, one - c * (x * x + z * z), c * (y * z) - s * x],
        [c * (x * z) - s * y, c * (y * z) + s * x, one - c * (x * x + y * y)],
    ])  # fmt: skip


@compiled("f1~", inner=True)
def so3_exp(phi: Array) -> Array:
    """Rotation matrix (3, 3) of a rotation vector (3,) in rad (Rodrigues)."""
    a, b, _ = rodrigues(phi[0] * phi[0] + phi[1] * phi[1] + phi[2] * phi[2])
    return combination(phi, 1.0, a, b)


@compiled("f1~", inner=True)
def so3_left_jacobian(phi: Array) -> Array:
    """Integral of so3_exp(u phi) over u from 0 to 1 (3, 3) (Sola 2017, eq. 145)."""
    _, b, c = rodrigues(phi[0] * phi[0] + phi[1] * phi[1] + phi[2] * phi[2])
    return combination(phi, 1.0, b, c)


@compiled("f2 f1", inner=True)
def camera_centre(R: Array, t: Array) -> Array:
    """Position (3,) of the camera in the world, for cam_from_world (R, t)."""
    centre = np.zeros(3)
    for i in range(3):
        for j in range(3):
            centre[i] -= R[j, i] * t[j]
    return centre


@compiled("f2 f1 f1")
def se3_exp_left(R: Array, t: Array, xi: Array) -> RigidMotion:
    """exp(xi) @ (R, t): left perturbation of a pose by a twist (6,), translation first."""
    E, V = so3_exp(xi[3:]), so3_left_jacobian(xi[3:])
    R_out, t_out = np.zeros((3, 3)), np.zeros(3)
    for i in range(3):
        for j in range(3):
            t_out[i] += V[i, j] * xi[j]
    for i in range(3):
        for j in range(3):
            t_out[i] += E[i, j] * t[j]
            for k in range(3):
                R_out[i, j] += E[i, k] * R[k, j]
    return RigidMotion(R_out, t_out)


@compiled("f2 f1 f2 f1")
def se3_log_left(R: Array, t: Array, R_to: Array, t_to: Array) -> Array:
    """The twist xi (6,) with exp(xi) @ (R, t) = (R_to, t_to), for rotations well below half a turn."""
    E, d = np.zeros((3, 3)), t_to.copy()
    for i in range(3):
        for j in range(3):
            for k in range(3):
                E[i, j] += R_to[i, k] * R[j, k]
    for i in range(3):
        for j in range(3):
            d[i] -= E[i, j] * t[j]
    wx, wy, wz = 0.5 * (E[2, 1] - E[1, 2]), 0.5 * (E[0, 2] - E[2, 0]), 0.5 * (E[1, 0] - E[0, 1])
    sine = math.sqrt(wx * wx + wy * wy + wz * wz)
    angle = math.atan2(sine, 0.5 * (E[0, 0] + E[1, 1] + E[2, 2] - 1.0))
    scale = angle / sine if sine > 1e-9 else 1.0
    wx, wy, wz = wx * scale, wy * scale, wz * scale
    # the inverse of V in exp: 1 - K / 2 + c K K
    c = 1.0 / 12 if angle < 1e-4 else (1.0 - 0.5 * angle * math.sin(angle) / (1.0 - math.cos(angle))) / (angle * angle)
    ax, ay, az = wy * d[2] - wz * d[1], wz * d[0] - wx * d[2], wx * d[1] - wy * d[0]
    bx, by, bz = wy * az - wz * ay, wz * ax - wx * az, wx * ay - wy * ax
    return np.array([d[0] - 0.5 * ax + c * bx, d[1] - 0.5 * ay + c * by, d[2] - 0.5 * az + c * bz, wx, wy, wz])


@compiled("f2 f1 f1!", inner=True)
def solve6(A: Array, b: Array, x: Array) -> bool:
    """Solve A x = b for a symmetric positive definite A (6, 6) by Cholesky; False if A is not positive definite."""
    L = np.empty((6, 6))
    if not factor6(A, L):
        return False
    substitute6(L, b, x)
    return True


@compiled("f2 f2!", inner=True, allocates=False)
def factor6(A: Array, L: Array) -> bool:
    """Lower Cholesky factor L (6, 6) of a matrix A, which may be L itself; False if A is not positive definite."""
    for i in range(6):
        for j in range(i + 1):
            s = A[i, j]
            for k in range(j):
                s -= L[i, k] * L[j, k]
            if i == j:
                if s <= 0.0:
                    return False
                L[i, i] = math.sqrt(s)
            else:
                L[i, j] = s / L[j, j]
    return True


@compiled("f2 f1 f1!", inner=True, allocates=False)
def substitute6(L: Array, b: Array, x: Array) -> None:
    """Solve L L' x = b with a lower triangular L (6, 6)."""
    for i in range(6):
        s = b[i]
        for k in range(i):
            s -= L[i, k] * x[k]
        x[i] = s / L[i, i]
    for i in range(5, -1, -1):
        s = x[i]
        for k in range(i + 1, 6):
            s -= L[k, i] * x[k]
        x[i] = s / L[i, i]


@compiled("f2 f2!", inner=True, allocates=False)
def cholesky(S: Array, L: Array) -> bool:
    """Lower factor L of a symmetric matrix S, which may be L itself; False when it is not positive."""
    n = S.shape[0]
    for i in range(n):
        for j in range(i + 1):
            s = S[i, j]
            for k in range(j):
                s -= L[i, k] * L[j, k]
            if i == j:
                if not s > 0.0:
                    return False
                L[i, i] = math.sqrt(s)
            else:
                L[i, j] = s / L[j, j]
    return True


@compiled("f2 f2", inner=True)
def solved(L: Array, B: Array) -> Array:
    """X with L L' X = B."""
    n, m = B.shape
    X = B.copy()
    for c in range(m):
        for i in range(n):
            s = X[i, c]
            for k in range(i):
                s -= L[i, k] * X[k, c]
            X[i, c] = s / L[i, i]
        for i in range(n - 1, -1, -1):
            s = X[i, c]
            for k in range(i + 1, n):
                s -= L[k, i] * X[k, c]
            X[i, c] = s / L[i, i]
    return X


@compiled("f2! f2!", inner=True, allocates=False)
def eliminate(M: Array, N: Array) -> None:
    """Replace N (6, k) by M^-1 N, by Gauss-Jordan elimination with partial pivoting; M (6, 6) is overwritten."""
    k = N.shape[1]
    for i in range(6):
        pivot = i
        for r in range(i + 1, 6):
            if abs(M[r, i]) > abs(M[pivot, i]):
                pivot = r
        if pivot != i:
            for j in range(6):
                M[i, j], M[pivot, j] = M[pivot, j], M[i, j]
            for j in range(k):
                N[i, j], N[pivot, j] = N[pivot, j], N[i, j]
        scale = 1.0 / M[i, i]
        for j in range(6):
            M[i, j] *= scale
        for j in range(k):
            N[i, j] *= scale
        for r in range(6):
            if r != i:
                f = M[r, i]
                for j in range(6):
                    M[r, j] -= f * M[i, j]
                for j in range(k):
                    N[r, j] -= f * N[i, j]


@compiled("f2 f1 f2 f1 f2")
def squared_mahalanobis(R: Array, t: Array, R_to: Array, t_to: Array, covariance: Array) -> float:
    """Squared Mahalanobis distance of a pose (R_to, t_to) from (R, t) with a covariance (6, 6) of its twist.

    Infinite where the covariance is not positive definite.
    """
    away, x = se3_log_left(R, t, R_to, t_to), np.empty(6)
    if not solve6(covariance, away, x):
        return math.inf
    square = 0.0
    for i in range(6):
        square += away[i] * x[i]
    return square


@compiled("f3 f2 f2 f1 f2")
def least_squared_mahalanobis(R: Array, t: Array, R_to: Array, t_to: Array, covariance: Array) -> float:
    """As `squared_mahalanobis`, from the nearest of poses R (k, 3, 3), t (k, 3)."""
    least = math.inf
    for k in range(len(R)):
        least = min(least, squared_mahalanobis(R[k], t[k], R_to, t_to, covariance))
    return least


@compiled("f2")
def inverse6(A: Array) -> Array:
    """Inverse of a symmetric positive definite matrix (6, 6); NaN if it is not positive definite."""
    out, L, unit, column = np.empty((6, 6)), np.empty((6, 6)), np.zeros(6), np.zeros(6)
    if not factor6(A, L):
        out[:] = math.nan
        return out
    for j in range(6):
        unit[:] = 0.0
        unit[j] = 1.0
        substitute6(L, unit, column)
        for i in range(6):
            out[i, j] = column[i]
    return 0.5 * (out + out.T)
