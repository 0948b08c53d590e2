"""Compiled filter of the biases shared across frames: the pose error D of all patches (6), and one offset per edge (1).

With D the pose error of the patches as a twist in the world and b the offset of an edge in px, a frame whose pose is
determined by the patches observes the control points of that edge at J D + b. The information matrix is therefore an
arrowhead matrix: each offset is correlated with D alone, and can be marginalized separately.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.tracker.geometry_kernels import eliminate
from uavbench.trajectories.kernels.argument_types import named_tuple
from uavbench.trajectories.kernels.compiled import compiled
from uavbench.trajectories.pose import Array

Indices = NDArray[np.int64]


class FrameSums(NamedTuple):
    """Normal equations of a frame, before the biases and the prior.

    For each edge in view: offset_weight (g,) sum of weights, offset_jacobian (g, 6) of weight times Jacobian,
    offset_residual (g,) of weight times residual. Over all control points: edge_information (6, 6), edge_vector (6,);
    over the patches: patch_information (6, 6), patch_vector (6,).
    """

    offset_weight: Array
    offset_jacobian: Array
    offset_residual: Array
    edge_information: Array
    edge_vector: Array
    patch_information: Array
    patch_vector: Array


class BiasState(NamedTuple):
    """Information on D and on the offsets of all edges (e,).

    information (6, 6) and vector (6,) on D; cross (e, 6) information between D and an offset; offset_information (e,)
    and offset_vector (e,) on the offset itself, offset_prior (e,) its prior information.
    """

    information: Array
    vector: Array
    cross: Array
    offset_information: Array
    offset_vector: Array
    offset_prior: Array

    @classmethod
    def unknown(cls, edges: int) -> "BiasState":
        """Unit information on D, and none on the offsets of this many edges."""
        offsets = np.zeros((edges, 6)), np.zeros(edges), np.zeros(edges), np.ones(edges)
        return cls(np.eye(6), np.zeros(6), *offsets)


class EdgeOffsets(NamedTuple):
    """Edges in view: their rows (g,) in the state, and the prior variance_px2 (g,) of their offsets."""

    rows: Indices
    variance_px2: Array


class LocalBiases(NamedTuple):
    """Information on the biases at a linearization point, with D as a twist (6,) of the camera there.

    information (6, 6) and vector (6,) on D, with the offsets of the edges in view not marginalized; cross (g, 6),
    offset_information (g,) and offset_vector (g,) of those.
    """

    information: Array
    vector: Array
    cross: Array
    offset_information: Array
    offset_vector: Array


class Marginal(NamedTuple):
    """Information (6, 6) and vector (6,) on D."""

    information: Array
    vector: Array


class PatchError(NamedTuple):
    """Error of the patches as a twist (6,) of the camera, and the remaining information (6, 6) on D."""

    twist: Array
    information: Array


FRAME_SUMS = named_tuple(FrameSums, "f1! f2! f1! f2! f1! f2! f1!")
BIAS_STATE = named_tuple(BiasState, "f2! f1! f2! f1! f1! f1!")
EDGE_OFFSETS = named_tuple(EdgeOffsets, "i1! f1!")
LOCAL_BIASES = named_tuple(LocalBiases, "f2! f1! f2! f1! f1!")


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
