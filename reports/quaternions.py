"""Arithmetic on many unit quaternions wxyz (n, 4) at once."""

import numpy as np

from trajectories.pose import Array


def normalized(q: Array) -> Array:
    """Quaternions (n, 4) scaled to unit norm."""
    unit: Array = q / np.sqrt(np.einsum("ij,ij->i", q, q))[:, None]
    return unit


def conjugate(q: Array) -> Array:
    """Inverse rotations (n, 4)."""
    return q * [1.0, -1.0, -1.0, -1.0]


def multiply(a: Array, b: Array) -> Array:
    """Products a b (n, 4): the rotation b, then a."""
    aw, ax, ay, az = a.T
    bw, bx, by, bz = b.T
    out = np.empty(np.broadcast_shapes(a.shape, b.shape))
    out[:, 0] = aw * bw - ax * bx - ay * by - az * bz
    out[:, 1] = aw * bx + ax * bw + ay * bz - az * by
    out[:, 2] = aw * by - ax * bz + ay * bw + az * bx
    out[:, 3] = aw * bz + ax * by - ay * bx + az * bw
    return out


def between(a: Array, b: Array) -> Array:
    """a^-1 b (n, 4): the rotation that leads from a to b."""
    return multiply(conjugate(a), b)


def rotate(q: Array, v: Array) -> Array:
    """Vectors (n, 3) rotated by q (n, 4)."""
    u, w = q[:, 1:], q[:, :1]
    t = 2.0 * _cross(u, v)
    return v + w * t + _cross(u, t)


def angle(q: Array) -> Array:
    """Rotation angles (n,) in rad, 0 .. pi; exact for small angles too."""
    return 2.0 * np.arctan2(_vector_norm(q), np.abs(q[:, 0]))


def chord(q: Array) -> Array:
    """|R - I| in the Frobenius norm (n,): 2 sqrt(2) sin(angle / 2)."""
    norm: Array = 2.0**1.5 * _vector_norm(q)
    return norm


def slerp(a: Array, b: Array, w: Array) -> Array:
    """Rotations (n, 4) a share w (n,) of the shorter way from a to b (Shoemake 1985)."""
    q = between(a, b)
    q = np.where(q[:, :1] < 0, -q, q)
    norm = _vector_norm(q)
    half = np.arctan2(norm, q[:, 0]) * w
    axis = q[:, 1:] / np.where(norm > 0, norm, 1.0)[:, None]
    return multiply(a, np.column_stack([np.cos(half), np.sin(half)[:, None] * axis]))


def _vector_norm(q: Array) -> Array:
    norm: Array = np.sqrt(q[:, 1] ** 2 + q[:, 2] ** 2 + q[:, 3] ** 2)
    return norm


def _cross(a: Array, b: Array) -> Array:
    out = np.empty(np.broadcast_shapes(a.shape, b.shape))
    out[:, 0] = a[:, 1] * b[:, 2] - a[:, 2] * b[:, 1]
    out[:, 1] = a[:, 2] * b[:, 0] - a[:, 0] * b[:, 2]
    out[:, 2] = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    return out
