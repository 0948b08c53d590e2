"""Compiled matrices of twists."""

import numpy as np

from uavbench.trajectories.kernels.compiled import compiled
from uavbench.trajectories.pose import Array


@compiled("f2 f1")
def adjoint(R: Array, t: Array) -> Array:
    """Adjoint (6, 6) that maps a twist in the world to one of the camera, for cam_from_world (R, t)."""
    X = np.zeros((6, 6))
    for i in range(3):
        for j in range(3):
            X[i, j] = X[3 + i, 3 + j] = R[i, j]
    for j in range(3):
        X[0, 3 + j] = t[1] * R[2, j] - t[2] * R[1, j]
        X[1, 3 + j] = t[2] * R[0, j] - t[0] * R[2, j]
        X[2, 3 + j] = t[0] * R[1, j] - t[1] * R[0, j]
    return X


@compiled("f2 f1", inner=True)
def product(X: Array, v: Array) -> Array:
    """X v of a square matrix."""
    out = np.zeros(len(v))
    for i in range(len(v)):
        for j in range(len(v)):
            out[i] += X[i, j] * v[j]
    return out


@compiled("f2", inner=True)
def transposed(X: Array) -> Array:
    """X^T of a square matrix."""
    out = np.empty(X.shape)
    for i in range(len(X)):
        for j in range(len(X)):
            out[i, j] = X[j, i]
    return out


@compiled("f2 f2")
def congruence(X: Array, C: Array) -> Array:
    """X C X^T of matrices (n, n)."""
    n, half, out = len(X), np.zeros(X.shape), np.zeros(X.shape)
    for i in range(n):
        for j in range(n):
            for h in range(n):
                half[i, j] += X[i, h] * C[h, j]
    for i in range(n):
        for j in range(n):
            for h in range(n):
                out[i, j] += half[i, h] * X[j, h]
    return out
