"""Compiled rotations and twists: quaternions, exponentials and logarithms of SO(3) and SE(3), to the same bits always.

Sums keep their order, and elementary functions are those of the C library: see `reproducible_math`.
"""

import math

import numpy as np
from numpy.typing import NDArray

from uavbench.trajectories.kernels.compiled import compiled

Array = NDArray[np.float64]


@compiled("f2~ f1!", inner=True, allocates=False)
def _quaternion(R: Array, q: Array) -> None:
    """Unit quaternion wxyz into q (4,), from the largest of its four squared components (Shepperd 1978)."""
    m00, m11, m22 = R[0, 0], R[1, 1], R[2, 2]
    ww, xx, yy, zz = 1 + m00 + m11 + m22, 1 + m00 - m11 - m22, 1 - m00 + m11 - m22, 1 - m00 - m11 + m22
    wx, wy, wz = R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]
    xy, xz, yz = R[1, 0] + R[0, 1], R[2, 0] + R[0, 2], R[2, 1] + R[1, 2]
    if not (ww < xx or ww < yy or ww < zz):
        q[0], q[1], q[2], q[3] = ww, wx, wy, wz
    elif not (xx < yy or xx < zz):
        q[0], q[1], q[2], q[3] = wx, xx, xy, xz
    elif not yy < zz:
        q[0], q[1], q[2], q[3] = wy, xy, yy, yz
    else:
        q[0], q[1], q[2], q[3] = wz, xz, yz, zz
    norm = math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    for i in range(4):
        q[i] /= norm
    if q[0] < 0:
        for i in range(4):
            q[i] = -q[i]


@compiled("f3~ f2!", allocates=False)
def fill_quaternions(R: Array, q: Array) -> None:
    """Unit quaternions wxyz, w >= 0, into q (n, 4), of rotation matrices (n, 3, 3)."""
    for n in range(len(R)):
        _quaternion(R[n], q[n])


@compiled("f2~ f3!", allocates=False)
def fill_rotations(q: Array, R: Array) -> None:
    """Rotation matrices into R (n, 3, 3), of quaternions wxyz (n, 4), which are normalized first."""
    for n in range(len(q)):
        w, x, y, z = q[n, 0], q[n, 1], q[n, 2], q[n, 3]
        norm = math.sqrt(w * w + x * x + y * y + z * z)
        w, x, y, z = w / norm, x / norm, y / norm, z / norm
        R[n, 0, 0], R[n, 0, 1], R[n, 0, 2] = 1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)
        R[n, 1, 0], R[n, 1, 1], R[n, 1, 2] = 2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)
        R[n, 2, 0], R[n, 2, 1], R[n, 2, 2] = 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)


@compiled("f2~ f1!", inner=True, allocates=False)
def _log(R: Array, phi: Array) -> None:
    """Rotation vector in rad into phi (3,); phi (4,) holds the quaternion meanwhile."""
    _quaternion(R, phi)
    w, x, y, z = phi[0], phi[1], phi[2], phi[3]
    norm = math.sqrt(x * x + y * y + z * z)
    scale = 2.0 * math.atan2(norm, w) / norm if norm > 0 else 2.0
    phi[0], phi[1], phi[2] = x * scale, y * scale, z * scale


@compiled("f3~ f2!", allocates=False)
def fill_logarithms(R: Array, phi: Array) -> None:
    """Rotation vectors in rad into phi (n, 4), the fourth column to be dropped, of rotation matrices (n, 3, 3)."""
    for n in range(len(R)):
        _log(R[n], phi[n])


@compiled("f1~", inner=True, allocates=False)
def _length(v: Array) -> float:
    """Euclidean norm of a vector (3,), its squares summed in the order of `reproducible_math.length`."""
    return math.sqrt(v[0] * v[0] + v[2] * v[2] + v[1] * v[1])


@compiled("f1~ f0 f0 f0 f2!", inner=True, allocates=False)
def _fill_combination(v: Array, a: float, b: float, divisor: float, M: Array) -> None:
    """I + a K + b K K / divisor into M (3, 3), K the skew-symmetric matrix of the vector v (3,)."""
    x, y, z = v[0], v[1], v[2]
    M[0, 0] = 1.0 + b * (-z * z + -y * y) / divisor
    M[1, 1] = 1.0 + b * (-z * z + -x * x) / divisor
    M[2, 2] = 1.0 + b * (-y * y + -x * x) / divisor
    xy, xz, yz = b * (0.0 + x * y) / divisor, b * (0.0 + x * z) / divisor, b * (0.0 + y * z) / divisor
    M[0, 1], M[0, 2], M[1, 2] = 0.0 - a * z + xy, 0.0 + a * y + xz, 0.0 - a * x + yz
    M[1, 0], M[2, 0], M[2, 1] = 0.0 + a * z + xy, 0.0 - a * y + xz, 0.0 + a * x + yz


@compiled("f1~ f2!", inner=True, allocates=False)
def _exp(phi: Array, R: Array) -> None:
    """Rotation matrix into R (3, 3), of a rotation vector (3,) in rad (Rodrigues' formula)."""
    angle = _length(phi)
    if angle < 1e-6:
        a, b = 1.0 - angle * angle / 6.0, 0.5 - angle * angle / 24.0
    else:
        a, b = math.sin(angle) / angle, (1.0 - math.cos(angle)) / (angle * angle)
    _fill_combination(phi, a, b, 1.0, R)


@compiled("f2~ f3!", allocates=False)
def fill_exponentials(phi: Array, R: Array) -> None:
    """Rotation matrices into R (n, 3, 3), of rotation vectors (n, 3) in rad."""
    for n in range(len(phi)):
        _exp(phi[n], R[n])


@compiled("f1 f2! f1!", allocates=False)
def fill_pose(twist: Array, R: Array, t: Array) -> None:
    """Rotation into R (3, 3) and translation into t (3,), of a twist (6,): the exponential of SE(3)."""
    phi = twist[3:6]
    angle = _length(phi)
    if angle < 1e-5:
        _fill_combination(phi, 0.5, 1.0, 6.0, R)
    else:
        a = (1 - math.cos(angle)) / (angle * angle)
        _fill_combination(phi, a, (angle - math.sin(angle)) / (angle * angle * angle), 1.0, R)
    for i in range(3):
        t[i] = 0.0 + R[i, 0] * twist[0] + R[i, 2] * twist[2] + R[i, 1] * twist[1]
    _exp(phi, R)


@compiled("f2~ f1 f1! f2!", allocates=False)
def fill_twist(R: Array, t: Array, twist: Array, spare: Array) -> None:
    """Twist into twist (6,), of a rotation (3, 3) and a translation (3,): the logarithm of SE(3); spare: (3, 3)."""
    _log(R, twist[2:6])
    twist[5], twist[4], twist[3] = twist[4], twist[3], twist[2]
    phi = twist[3:6]
    angle = _length(phi)
    if angle < 1e-5:
        _fill_combination(phi, -0.5, 1.0, 12.0, spare)
    else:
        c = (1 - 0.5 * angle * math.sin(angle) / (1 - math.cos(angle))) / (angle * angle)
        _fill_combination(phi, -0.5, c, 1.0, spare)
    for i in range(3):
        twist[i] = 0.0 + spare[i, 0] * t[0] + spare[i, 2] * t[2] + spare[i, 1] * t[1]
