"""Compiled filter of the common error of all patches: six unknowns that the edges of each frame observe."""

import numpy as np

from tracker.compiled import compiled
from tracker.geometry_kernels import eliminate
from trajectories.pose import Array


@compiled
def update_map(C: Array, E: Array, pull: Array, alike: float, forget: float) -> tuple[Array, Array]:
    """Twist (6,) by which the patches' places err as one, and the covariance (6, 6) that is left of C.

    E (6, 6) is what a frame's edges say, pull (6,) = E times the twist that they say; frames err alike for so many in a
    row. C grows by the part `forget` first: what was learned long ago counts less.
    """
    M, N = np.eye(6), (1.0 + forget) * C
    for i in range(6):
        for j in range(6):
            for h in range(6):
                M[i, j] += (1.0 + forget) * C[i, h] * E[h, j] / alike
    eliminate(M, N)
    left = 0.5 * (N + N.T)
    twist = np.zeros(6)
    for i in range(6):
        for j in range(6):
            twist[i] += left[i, j] * pull[j] / alike
    return twist, left


@compiled
def carried(C: Array, R_from: Array, t_from: Array, R_to: Array, t_to: Array) -> Array:
    """Covariance (6, 6) of a twist at one pose (R_from, t_from) as one at another: Ad C Ad^T."""
    R, t = np.zeros((3, 3)), t_to.copy()
    for i in range(3):
        for j in range(3):
            for k in range(3):
                R[i, j] += R_to[i, k] * R_from[j, k]
    for i in range(3):
        for j in range(3):
            t[i] -= R[i, j] * t_from[j]
    X = np.zeros((6, 6))
    for i in range(3):
        for j in range(3):
            X[i, j] = X[3 + i, 3 + j] = R[i, j]
    for j in range(3):
        X[0, 3 + j] = t[1] * R[2, j] - t[2] * R[1, j]
        X[1, 3 + j] = t[2] * R[0, j] - t[0] * R[2, j]
        X[2, 3 + j] = t[0] * R[1, j] - t[1] * R[0, j]
    out, half = np.zeros((6, 6)), np.zeros((6, 6))
    for i in range(6):
        for j in range(6):
            for h in range(6):
                half[i, j] += X[i, h] * C[h, j]
    for i in range(6):
        for j in range(6):
            for h in range(6):
                out[i, j] += half[i, h] * X[j, h]
    return out
