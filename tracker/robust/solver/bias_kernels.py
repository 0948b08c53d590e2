"""Compiled filter of what errs alike in all frames: the place of all patches (6), and each edge by an offset (1).

With D the common error of the patches' places as a twist in the world and b the offset of an edge in px, a frame whose
pose the patches tell finds the control points of that edge at J D + b. So the information on all of it is an arrow:
each offset is tied to D alone, and can be taken out by itself.
"""

import numpy as np
from numpy.typing import NDArray

from uavbench.tracker.geometry_kernels import eliminate
from uavbench.trajectories.kernels.compiled import compiled
from uavbench.trajectories.pose import Array

Indices = NDArray[np.int64]
Sums = tuple[Array, Array, Array, Array, Array, Array]
"""What the control points and the patches of a frame say.

Sums over the control points of each edge in view of weight (g,), weight times Jacobian (g, 6) and weight times residual
(g,); sums over all of them of weight times J J^T (6, 6) and weight times J times residual (6,); the former of the
patches.
"""


@compiled("f2 f1")
def adjoint(R: Array, t: Array) -> Array:
    """X (6, 6) that makes a twist of the camera of one in the world, for cam_from_world (R, t)."""
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
def times(X: Array, v: Array) -> Array:
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
def turned(X: Array, C: Array) -> Array:
    """X C X^T of matrices (6, 6)."""
    half, out = np.zeros((6, 6)), np.zeros((6, 6))
    for i in range(6):
        for j in range(6):
            for h in range(6):
                half[i, j] += X[i, h] * C[h, j]
    for i in range(6):
        for j in range(6):
            for h in range(6):
                out[i, j] += half[i, h] * X[j, h]
    return out


@compiled("f2 f1 f1 f1")
def explained(tie: Array, seen: Array, moment: Array, least: Array) -> tuple[Array, Array]:
    """Information (6, 6) and vector (6,) on D that the edges' offsets may explain instead.

    tie (e, 6) is the information between D and an offset, seen (e,) and moment (e,) information and vector of the
    offset itself, least (e,) its information beforehand.
    """
    A, v = np.zeros((6, 6)), np.zeros(6)
    for e in range(len(seen)):
        if seen[e] > 0.0:
            part = 1.0 / (seen[e] + least[e])
            for i in range(6):
                v[i] += tie[e, i] * moment[e] * part
                for j in range(6):
                    A[i, j] += tie[e, i] * tie[e, j] * part
    return A, v


@compiled("f2 f2 f1 f1 f1 i1 f1 f2 f1")
def shared_at(
    known: Array,
    tie: Array,
    seen: Array,
    moment: Array,
    least: Array,
    edges: Indices,
    spread: Array,
    R: Array,
    t: Array,
) -> tuple[Array, Array, Array, Array, Array]:
    """What is known of the common errors at a pose (R, t) by the edges (g,) in view and by all others.

    known (6, 6) is the information on D with all offsets taken out, of which nothing is expected. spread (g,) is the
    variance of each edge's offset in px^2 beforehand. Returns information (6, 6) and vector (6,) on D as a twist of the
    camera with the offsets of the edges in view left in, and the tie (g, 6), information (g,) and vector (g,) of those.
    """
    n = len(edges)
    ties, information, vector, lower = np.empty((n, 6)), np.empty(n), np.empty(n), np.empty(n)
    for g in range(n):
        k = edges[g]
        information[g], vector[g], lower[g] = seen[k], moment[k], least[k]
        for i in range(6):
            ties[g, i] = tie[k, i]
    A, v = explained(ties, information, vector, lower)
    back = transposed(R)
    centre = times(back, t)
    for i in range(3):
        centre[i] = -centre[i]
    X = transposed(adjoint(back, centre))
    for i in range(6):
        for j in range(6):
            A[i, j] += known[i, j]
    for g in range(n):
        row = times(X, ties[g])
        information[g] += 1.0 / spread[g]
        for i in range(6):
            ties[g, i] = row[i]
    return turned(X, A), times(X, v), ties, information, vector


@compiled("f2! f1! f2! f1! f1! f1! i1 f1 (f1 f2 f1 f2 f1 f2) f1 f2 f1 f0")
def take_up(
    whole: Array,
    vector: Array,
    tie: Array,
    seen: Array,
    moment: Array,
    least: Array,
    edges: Indices,
    spread: Array,
    sums: Sums,
    aside: Array,
    R: Array,
    t: Array,
    part: float,
) -> None:
    """Take up, in place, a part of what a frame's sums over the edges (g,) in view say.

    whole (6, 6) and vector (6,) are information and vector on D. aside (6,) is the twist from the pose (R, t) of the
    sums to that which the patches tell.
    """
    S, s, d, E, e, _ = sums
    X = transposed(adjoint(R, t))
    by_edges, rest = turned(X, E), times(E, aside)
    for i in range(6):
        rest[i] = e[i] - rest[i]
    rest = times(X, rest)
    for i in range(6):
        vector[i] += part * rest[i]
        for j in range(6):
            whole[i, j] += part * by_edges[i, j]
    for g in range(len(edges)):
        k, left = edges[g], d[g]
        for i in range(6):
            left -= s[g, i] * aside[i]
        least[k] = 1.0 / spread[g]
        seen[k] += part * S[g]
        moment[k] += part * left
        row = times(X, s[g])
        for i in range(6):
            tie[k, i] += part * row[i]


@compiled("f2 f1! f2 f1 f1! f1 f2 f1")
def centre(
    whole: Array, vector: Array, tie: Array, seen: Array, moment: Array, least: Array, R: Array, t: Array
) -> tuple[Array, Array]:
    """The twist (6,) of the camera at (R, t) by which the patches err, and the information (6, 6) left on D.

    Offsets are taken out; the twist is taken off vector and moment, in place.
    """
    A, v = explained(tie, seen, moment, least)
    known, used_up, column, D = np.empty((6, 6)), np.empty((6, 6)), np.empty((6, 1)), np.empty(6)
    for i in range(6):
        column[i, 0] = vector[i] - v[i]
        for j in range(6):
            known[i, j] = used_up[i, j] = whole[i, j] - A[i, j]
    eliminate(used_up, column)
    for i in range(6):
        D[i] = column[i, 0]
    taken = times(whole, D)
    for i in range(6):
        vector[i] -= taken[i]
    for e in range(len(seen)):
        for i in range(6):
            moment[e] -= tie[e, i] * D[i]
    return times(adjoint(R, t), D), known


@compiled("f2 f2")
def pinned(E: Array, P: Array) -> float:
    """How well patches of information P (6, 6) tell the pose against what edges of information E say of it, 0 to 1.

    The mean of the parts that the patches have in each direction of a twist.
    """
    M, N = np.empty((6, 6)), np.empty((6, 6))
    for i in range(6):
        for j in range(6):
            M[i, j], N[i, j] = E[i, j] + P[i, j], P[i, j]
    eliminate(M, N)
    return float(N[0, 0] + N[1, 1] + N[2, 2] + N[3, 3] + N[4, 4] + N[5, 5]) / 6.0


@compiled("f1 (f1 f2 f1 f2 f1 f2) f1 f2")
def surprise(spread: Array, sums: Sums, step: Array, covariance: Array) -> tuple[float, float]:
    """Squared offsets of a frame's edges (g,) over their variance, summed, and how large that sum should be.

    The sums are of a pose that a twist step (6,) brings to the fit, whose covariance (6, 6) says how much of an offset
    the pose takes up; spread (g,) is the variance of each edge's offset in px^2.
    """
    S, s, d = sums[0], sums[1], sums[2]
    squares, expected = 0.0, 0.0
    for g in range(len(S)):
        if S[g] <= 0.0:
            continue
        left, taken = d[g], 0.0
        for i in range(6):
            left -= s[g, i] * step[i]
            for j in range(6):
                taken += s[g, i] * covariance[i, j] * s[g, j]
        variance = spread[g] + 1.0 / S[g]
        squares += left * left / (S[g] * S[g] * variance)
        expected += max(0.0, 1.0 - taken / (S[g] * S[g] * variance))
    return squares, expected
