"""Compiled sums of what all edges share: what a frame says of it, and the equations of a pose with its prior."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.tracker.geometry_kernels import eliminate, se3_log_left
from uavbench.tracker.robust.solver.bias_kernels import linearize
from uavbench.tracker.robust.solver.bias_state import BIASES_IN_VIEW, FRAME_SUMS, BiasesInView, FrameSums
from uavbench.tracker.robust.solver.equation_kernels import (
    POSE_PRIOR,
    PosePrior,
    add_edges,
    marginalize,
    marginalize_offsets,
    room_for_kinds,
)
from uavbench.tracker.robust.solver.number_state import KnownNumbers
from uavbench.tracker.robust.view import VIEW, View
from uavbench.trajectories.kernels.compiled import compiled, inlined
from uavbench.trajectories.pose import Array

Indices = NDArray[np.int64]


class NumbersSeen(NamedTuple):
    """Information (r, r) of a frame on the numbers and vector (r,), relative to those by which edges are located."""

    information: Array
    vector: Array


@compiled(
    "sums biases prior view f0 i1",
    sums=FRAME_SUMS,
    biases=BIASES_IN_VIEW,
    prior=POSE_PRIOR,
    view=VIEW,
)
def numbers_seen(
    sums: FrameSums, biases: BiasesInView, prior: PosePrior, view: View, shared_px2: float, sides: Indices
) -> NumbersSeen:
    """What the edges of a frame say of the numbers, with pose and offsets marginalized.

    shared_px2: variance of each offset that all edges share, to the side to which a number of sides (k,) moves them.
    biases: from before all frames, with these offsets as numbers, so that offsets that frames have in common do not
    count as known.
    """
    local, numbers = linearize(biases, view.R, view.t), len(sums.edge_vector) - 6
    n = 12 + numbers + len(sides)
    H, h = np.zeros((n, n)), np.zeros(n)
    both = with_shared_offsets(sums, sides)
    add_edges(both, local, prior, se3_log_left(view.R, view.t, prior.R, prior.t), H, h)
    marginalize_offsets(both, local, room_for_kinds(local, n), np.empty(n), H, h)
    for last in range(n - 1, n - 1 - len(sides), -1):
        variance = 1.0 / (H[last, last] + 1.0 / shared_px2)
        marginalize(H[:last, :last], h[:last], H[last, :last], h[last] * variance, variance)
    M, N = np.empty((6, 6)), np.empty((6, 1 + numbers))
    information, vector = np.empty((numbers, numbers)), np.empty(numbers)
    for i in range(6):
        N[i, 0] = h[i]
        for j in range(6):
            M[i, j] = H[max(i, j), min(i, j)]
        for k in range(numbers):
            N[i, 1 + k] = H[12 + k, i]
    eliminate(M, N)
    for k in range(numbers):
        vector[k] = h[12 + k]
        for i in range(6):
            vector[k] -= H[12 + k, i] * N[i, 0]
        for m in range(numbers):
            information[k, m] = H[12 + max(k, m), 12 + min(k, m)]
            for i in range(6):
                information[k, m] -= H[12 + k, i] * N[i, 1 + m]
    return NumbersSeen(information, vector)


@inlined
def with_shared_offsets(sums: FrameSums, sides: Indices) -> FrameSums:
    """The sums with numbers more, an offset of all edges to the side to which each number of sides (k,) moves them."""
    n, edges, count = len(sums.edge_vector), len(sums.offset_weight), len(sides)
    J, A, v = np.empty((edges, n + count)), np.zeros((n + count, n + count)), np.zeros(n + count)
    A[:n, :n], v[:n] = sums.edge_information, sums.edge_vector
    for g in range(edges):
        for i in range(n):
            J[g, i] = sums.offset_jacobian[g, i]
        for k in range(count):
            side = np.sign(J[g, 6 + sides[k]])
            J[g, n + k] = side * sums.offset_weight[g]
            v[n + k] += side * sums.offset_residual[g]
            for i in range(n + k + 1):
                A[n + k, i] += side * J[g, i]
    for k in range(n, n + count):
        for i in range(k):
            A[i, k] = A[k, i]
    return FrameSums(
        *(sums.offset_weight, J, sums.offset_residual, A, v),
        *(sums.patch_information, sums.patch_vector),
    )


@inlined
def with_prior(F: Array, f: Array, known: KnownNumbers) -> Array:
    """Change the numbers in F (6 + r, 6 + r), its lower half, and f (6 + r,) to u, with its prior, in place.

    The numbers are the mean and S u, u of unit variance and S S^T the covariance, so that numbers known for certain
    have no infinite information. Returns S (r, r).
    """
    r, S = len(known.mean), lower_root(known.covariance)
    for i in range(6):
        for k in range(r):
            f[i] -= F[6 + k, i] * known.mean[k]
    for k in range(r):
        for m in range(r):
            f[6 + k] -= F[6 + max(k, m), 6 + min(k, m)] * known.mean[m]
    half = np.zeros((r, r))
    for i in range(r):
        for k in range(r):
            for m in range(k, r):
                half[i, k] += F[6 + max(i, m), 6 + min(i, m)] * S[m, k]
    for k in range(r):  # S is lower triangular: row k is needed by those before it alone
        for i in range(6):
            F[6 + k, i] *= S[k, k]
            for m in range(k + 1, r):
                F[6 + k, i] += S[m, k] * F[6 + m, i]
        f[6 + k] *= S[k, k]
        for m in range(k + 1, r):
            f[6 + k] += S[m, k] * f[6 + m]
        for j in range(k + 1):
            F[6 + k, 6 + j] = 1.0 if j == k else 0.0
            for m in range(k, r):
                F[6 + k, 6 + j] += S[m, k] * half[m, j]
    return S


@inlined
def lower_root(covariance: Array) -> Array:
    """Lower triangular S with S S^T = covariance (r, r), which may be singular."""
    S = np.zeros(covariance.shape)
    for i in range(len(S)):
        for j in range(i + 1):
            left = covariance[i, j]
            for k in range(j):
                left -= S[i, k] * S[j, k]
            if i == j:
                S[i, i] = math.sqrt(max(left, 0.0))
            elif S[j, j] > 0.0:
                S[i, j] = left / S[j, j]
    return S
