"""Compiled filter of the biases shared across frames: the pose error D of all patches (6), and one offset per edge (1).

See `bias_state`.
"""

from typing import NamedTuple

import numpy as np

from uavbench.tracker.geometry_kernels import eliminate
from uavbench.tracker.robust.solver.bias_state import (
    BIAS_STATE,
    EDGE_OFFSETS,
    FRAME_SUMS,
    BiasState,
    EdgeOffsets,
    FrameSums,
    LocalBiases,
)
from uavbench.tracker.robust.solver.twist_kernels import adjoint, congruence, product, transposed
from uavbench.trajectories.kernels.compiled import compiled
from uavbench.trajectories.pose import Array


class Marginal(NamedTuple):
    """Information (6, 6) and vector (6,) on D."""

    information: Array
    vector: Array


class PatchError(NamedTuple):
    """Error of the patches as a twist (6,) of the camera, and the remaining information (6, 6) on D."""

    twist: Array
    information: Array


@compiled("f2 f1 f1 f1")
def explained_by_offsets(cross: Array, information: Array, vector: Array, prior: Array) -> Marginal:
    """Information and vector on D that marginalizing the offsets (e,) removes."""
    A, v = np.zeros((6, 6)), np.zeros(6)
    for e in range(len(information)):
        if information[e] > 0.0:
            part = 1.0 / (information[e] + prior[e])
            for i in range(6):
                v[i] += cross[e, i] * vector[e] * part
                for j in range(6):
                    A[i, j] += cross[e, i] * cross[e, j] * part
    return Marginal(A, v)


@compiled("state f2 edges f2 f1", state=BIAS_STATE, edges=EDGE_OFFSETS)
def linearize(state: BiasState, known: Array, edges: EdgeOffsets, R: Array, t: Array) -> LocalBiases:
    """Information on the biases from the edges in view and all others, at the linearization point (R, t).

    known (6, 6) is the information on D with all offsets marginalized; D's expectation is 0.
    """
    n = len(edges.rows)
    cross, information, vector, prior = np.empty((n, 6)), np.empty(n), np.empty(n), np.empty(n)
    for g in range(n):
        k = edges.rows[g]
        information[g], vector[g] = state.offset_information[k], state.offset_vector[k]
        prior[g] = state.offset_prior[k]
        for i in range(6):
            cross[g, i] = state.cross[k, i]
    spared = explained_by_offsets(cross, information, vector, prior)
    A, back = spared.information, transposed(R)
    centre = product(back, t)
    for i in range(3):
        centre[i] = -centre[i]
    X = transposed(adjoint(back, centre))
    for i in range(6):
        for j in range(6):
            A[i, j] += known[i, j]
    for g in range(n):
        row = product(X, cross[g])
        information[g] += 1.0 / edges.variance_px2[g]
        for i in range(6):
            cross[g, i] = row[i]
    return LocalBiases(congruence(X, A), product(X, spared.vector), cross, information, vector)


@compiled("state edges sums f1 f2 f1 f0", state=BIAS_STATE, edges=EDGE_OFFSETS, sums=FRAME_SUMS)
def accumulate(
    state: BiasState, edges: EdgeOffsets, sums: FrameSums, to_patches: Array, R: Array, t: Array, part: float
) -> None:
    """Add a fraction `part` of a frame's sums over the edges in view to the state, in place.

    to_patches (6,): twist from the linearization point (R, t) of the sums to the pose by the patches.
    """
    X = transposed(adjoint(R, t))
    information, rest = congruence(X, sums.edge_information), product(sums.edge_information, to_patches)
    for i in range(6):
        rest[i] = sums.edge_vector[i] - rest[i]
    vector = product(X, rest)
    for i in range(6):
        state.vector[i] += part * vector[i]
        for j in range(6):
            state.information[i, j] += part * information[i, j]
    for g in range(len(edges.rows)):
        k, left = edges.rows[g], sums.offset_residual[g]
        for i in range(6):
            left -= sums.offset_jacobian[g, i] * to_patches[i]
        state.offset_prior[k] = 1.0 / edges.variance_px2[g]
        state.offset_information[k] += part * sums.offset_weight[g]
        state.offset_vector[k] += part * left
        row = product(X, sums.offset_jacobian[g])
        for i in range(6):
            state.cross[k, i] += part * row[i]


@compiled("state f2 f1", state=BIAS_STATE)
def centre(state: BiasState, R: Array, t: Array) -> PatchError:
    """The patches' error as a twist of the camera at (R, t), which is subtracted from the state's vectors in place."""
    spared = explained_by_offsets(state.cross, state.offset_information, state.offset_vector, state.offset_prior)
    known, used_up, column, D = np.empty((6, 6)), np.empty((6, 6)), np.empty((6, 1)), np.empty(6)
    for i in range(6):
        column[i, 0] = state.vector[i] - spared.vector[i]
        for j in range(6):
            known[i, j] = used_up[i, j] = state.information[i, j] - spared.information[i, j]
    eliminate(used_up, column)
    for i in range(6):
        D[i] = column[i, 0]
    explained = product(state.information, D)
    for i in range(6):
        state.vector[i] -= explained[i]
    for e in range(len(state.offset_vector)):
        for i in range(6):
            state.offset_vector[e] -= state.cross[e, i] * D[i]
    return PatchError(product(adjoint(R, t), D), known)


@compiled("f2 f2")
def observability(E: Array, P: Array) -> float:
    """Observability of the pose by patches of information P (6, 6) relative to edges of information E (6, 6), 0 to 1.

    The mean fraction of the information in each direction of a twist that is due to the patches.
    """
    M, N = np.empty((6, 6)), np.empty((6, 6))
    for i in range(6):
        for j in range(6):
            M[i, j], N[i, j] = E[i, j] + P[i, j], P[i, j]
    eliminate(M, N)
    return float(N[0, 0] + N[1, 1] + N[2, 2] + N[3, 3] + N[4, 4] + N[5, 5]) / 6.0
