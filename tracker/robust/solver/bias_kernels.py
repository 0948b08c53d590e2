"""Compiled filter of the biases shared across frames: the pose error of all patches, offsets of edges and of kinds.

What is a state, and what its information matrix looks like: `bias_state`.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.tracker.geometry_kernels import eliminate
from uavbench.tracker.robust.solver.bias_state import (
    BIAS_STATE,
    BIASES_IN_VIEW,
    EDGE_OFFSETS,
    FRAME_SUMS,
    KIND_SUMS,
    LOCAL_BIASES,
    TOGETHER,
    BiasesInView,
    BiasState,
    EdgeOffsets,
    ExpectedOffsets,
    FrameSums,
    KindSums,
    Known,
    LocalBiases,
    told_of,
)
from uavbench.tracker.robust.solver.twist_kernels import adjoint, congruence, product, transposed
from uavbench.trajectories.kernels.compiled import compiled
from uavbench.trajectories.pose import Array

Indices = NDArray[np.int64]
LEAST_OWN = 1e-3
"""Least part of the variance of an offset that is an edge's own, so that its information is finite."""


class Marginal(NamedTuple):
    """What marginalizing all offsets removes of what is common to all edges, and what is left of the kinds.

    information (6 + r, 6 + r), vector (6 + r,).
    """

    information: Array
    vector: Array
    of_kinds: KindSums


class Expected(NamedTuple):
    """Expectation of D and, by r numbers, how it falls with them (6, 1 + r); what is known."""

    D: Array
    known: Known


class PatchError(NamedTuple):
    """Error of the patches as a twist (6,) of the camera, and what remains known."""

    twist: Array
    known: Known


@compiled("f2! f1! f1 f0 f0", inner=True, allocates=False)
def add_outer(A: Array, v: Array, row: Array, vector: float, part: float) -> None:
    """Add part times row row^T to A (n, n) and part times vector times row to v (n,), in place."""
    for i in range(len(v)):
        v[i] += part * vector * row[i]
        for j in range(len(v)):
            A[i, j] += part * row[i] * row[j]


@compiled("state i0 i0 f0 kinds", inner=True, allocates=False, state=BIAS_STATE, kinds=KIND_SUMS)
def add_to_kind(state: BiasState, e: int, k: int, times: float, kinds: KindSums) -> None:
    """Add `times` what an edge of the state says of row k of the kinds, in place."""
    prior, information = state.offset_prior[e], state.offset_information[e]
    part = times * prior / (information + prior)
    kinds.information[k] += part * information
    kinds.vector[k] += state.signs[e] * part * state.offset_vector[e]
    for i in range(state.cross.shape[1]):
        kinds.cross[k, i] += state.signs[e] * part * state.cross[e, i]


@compiled("state i1! f1 f0", state=BIAS_STATE)
def prior_offsets(state: BiasState, rows: Indices, variance_px2: Array, shared_part: float) -> EdgeOffsets:
    """Offsets of edges in view, rows (g,) of the state, with prior variances (g,).

    shared_part: part of the variance that edges of a kind share; of a kind it is that of their mean.
    """
    own, shared = variance_px2.copy(), np.zeros(len(rows))
    number, total = np.zeros(len(state.kind_prior)), np.zeros(len(state.kind_prior))
    for g in range(len(rows)):
        k = state.kinds[rows[g]]
        if k >= 0:
            number[k] += 1.0
            total[k] += variance_px2[g]
    for g in range(len(rows)):
        k = state.kinds[rows[g]]
        if k >= 0:
            own[g] *= max(LEAST_OWN, 1.0 - shared_part)
            shared[g] = shared_part * total[k] / number[k]
    return EdgeOffsets(rows, own, shared)


@compiled("state", state=BIAS_STATE)
def explained_by_offsets(state: BiasState) -> Marginal:
    """Information and vector on what is common to all edges that marginalizing all offsets removes, the kinds' last."""
    n, count = len(state.vector), len(state.kind_prior)
    A, v, kinds = np.zeros((n, n)), np.zeros(n), KindSums(np.zeros(count), np.zeros((count, n)), np.zeros(count))
    for block in range(len(state.told)):
        for e in told_of(state, block):
            information = state.offset_information[e]
            if information > 0.0:
                add_outer(A, v, state.cross[e], state.offset_vector[e], 1.0 / (information + state.offset_prior[e]))
                if state.kinds[e] >= 0:
                    add_to_kind(state, e, state.kinds[e], 1.0, kinds)
    for k in range(count):
        if kinds.information[k] > 0.0:
            add_outer(A, v, kinds.cross[k], kinds.vector[k], 1.0 / (kinds.information[k] + state.kind_prior[k]))
    return Marginal(A, v, kinds)


@compiled("biases f2 f1", inner=True, biases=BIASES_IN_VIEW)
def linearize(biases: BiasesInView, R: Array, t: Array) -> LocalBiases:
    """Information on the biases from the edges in view and all others, at the linearization point (R, t).

    The expectation of D is 0 at the numbers by which edges are located, of which the state says nothing itself.
    """
    state, known, edges = biases.state, biases.known, biases.edges
    n, every = len(edges.rows), known.of_kinds
    common = len(state.vector)
    cross, information, vector = np.empty((n, common)), np.empty(n), np.empty(n)
    kinds, ties, local, count = np.full(n, -1), np.zeros(n), np.full(len(state.kind_prior), -1), 0
    of_kinds = KindSums(np.zeros(n), np.zeros((n, common)), np.zeros(n))
    A, v = known.information.copy(), np.zeros(common)
    for g in range(n):
        e, own = edges.rows[g], 1.0 / edges.variance_px2[g]
        k = state.kinds[e]
        information[g], vector[g] = state.offset_information[e] + own, state.offset_vector[e]
        for i in range(common):
            cross[g, i] = state.cross[e, i]
        if state.offset_information[e] > 0.0:
            part = 1.0 / (state.offset_information[e] + state.offset_prior[e])
            add_outer(A, v, state.cross[e], state.offset_vector[e], part)
        if k < 0:
            continue
        if local[k] < 0:  # the kind is in view: what all its edges say of it, and its new prior
            local[k], count = count, count + 1
            add_outer(A, v, every.cross[k], every.vector[k], 1.0 / (every.information[k] + state.kind_prior[k]))
            of_kinds.information[local[k]] = every.information[k] + 1.0 / edges.kind_px2[g]
            of_kinds.vector[local[k]] = every.vector[k]
            for i in range(common):
                of_kinds.cross[local[k], i] = every.cross[k, i]
        kinds[g], ties[g] = local[k], state.signs[e] * own
        if state.offset_information[e] > 0.0:  # less what this edge says itself
            add_to_kind(state, e, kinds[g], -1.0, of_kinds)
    back = transposed(R)
    centre = product(back, t)
    for i in range(3):
        centre[i] = -centre[i]
    X = beside_numbers(transposed(adjoint(back, centre)), common)
    cross, own, kind_vector = each_mapped(X, cross), of_kinds.information[:count].copy(), of_kinds.vector[:count].copy()
    of_kinds = KindSums(own, each_mapped(X, of_kinds.cross[:count]), kind_vector)
    expected = expected_offsets(information, vector, kinds, ties, of_kinds)
    A, v = congruence(X, A), product(X, v)
    biases_here = LocalBiases(A, v, cross, information, vector, kinds, ties, of_kinds, expected)
    if common > 6:
        leave_numbers_open(biases_here)
    return biases_here


@compiled("biases", inner=True, biases=LOCAL_BIASES)
def leave_numbers_open(biases: LocalBiases) -> None:
    """Change the information on the numbers, in place, so that with all else marginalized there is none.

    The offsets of edges by the numbers stay known. Frames that see the same offsets say no more of the numbers than
    one does, and the offsets' priors are not those that they had in earlier frames.
    """
    common, of_kinds = len(biases.vector), biases.of_kinds
    A, v, row = biases.information.copy(), biases.vector.copy(), np.empty(common)
    rows, shared, vector = of_kinds.cross.copy(), of_kinds.information.copy(), of_kinds.vector.copy()
    for g in range(len(biases.offset_information)):
        scale, k = 1.0 / biases.offset_information[g], biases.kinds[g]
        for i in range(common):
            row[i] = biases.cross[g, i]
        add_outer(A, v, row, biases.offset_vector[g], -scale)
        if k >= 0:
            tie = biases.ties[g]
            shared[k] += abs(tie) - tie * tie * scale
            vector[k] += tie * biases.offset_vector[g] * scale
            for i in range(common):
                rows[k, i] += tie * scale * row[i]
    for k in range(len(shared)):
        for i in range(common):
            row[i] = rows[k, i]
        add_outer(A, v, row, vector[k], -1.0 / shared[k])
    M, N = np.empty((6, 6)), np.empty((6, common - 5))
    for i in range(6):
        N[i, 0] = v[i]
        for j in range(6):
            M[i, j] = A[i, j]
        for j in range(6, common):
            N[i, j - 5] = A[i, j]
    eliminate(M, N)
    for i in range(6, common):
        left = v[i]
        for k in range(6):
            left -= A[i, k] * N[k, 0]
        biases.vector[i] -= left
        for j in range(6, common):
            left = A[i, j]
            for k in range(6):
                left -= A[i, k] * N[k, j - 5]
            biases.information[i, j] -= left


@compiled("f2 i0", inner=True)
def beside_numbers(X: Array, common: int) -> Array:
    """X (6, 6) of a twist, and the identity for the rest of so many unknowns."""
    out = np.eye(common)
    for i in range(6):
        for j in range(6):
            out[i, j] = X[i, j]
    return out


@compiled("f2 f2", inner=True)
def each_mapped(X: Array, rows: Array) -> Array:
    """X row of each row (g, n)."""
    out = np.empty(rows.shape)
    for g in range(len(rows)):
        for i in range(len(X)):
            total = 0.0
            for j in range(len(X)):
                total += X[i, j] * rows[g, j]
            out[g, i] = total
    return out


@compiled("f1 f1 i1 f1 kinds", inner=True, kinds=KIND_SUMS)
def expected_offsets(
    information: Array, vector: Array, kinds: Indices, ties: Array, of_kinds: KindSums
) -> ExpectedOffsets:
    """Offset of each edge in view and its variance where D is 0. Arguments as of `LocalBiases`."""
    shared, known = of_kinds.vector.copy(), of_kinds.information.copy()
    expected, variance = np.empty(len(kinds)), np.empty(len(kinds))
    for g in range(len(kinds)):
        if kinds[g] >= 0:
            known[kinds[g]] += abs(ties[g]) - ties[g] * ties[g] / information[g]
            shared[kinds[g]] += ties[g] * vector[g] / information[g]
    for g in range(len(kinds)):
        k, expected[g], variance[g] = kinds[g], vector[g] / information[g], 1.0 / information[g]
        if k >= 0:
            part = ties[g] / information[g]
            expected[g] += part * shared[k] / known[k]
            variance[g] += part * part / known[k]
    return ExpectedOffsets(expected, variance)


@compiled("state edges sums f1 f2 f1 f0", state=BIAS_STATE, edges=EDGE_OFFSETS, sums=FRAME_SUMS)
def accumulate(
    state: BiasState, edges: EdgeOffsets, sums: FrameSums, to_patches: Array, R: Array, t: Array, part: float
) -> None:
    """Add a fraction `part` of a frame's sums over the edges in view to the state, in place.

    to_patches (6,): twist from the linearization point (R, t) of the sums to the pose by the patches.
    """
    common = len(state.vector)
    X = beside_numbers(transposed(adjoint(R, t)), common)
    information, rest = congruence(X, sums.edge_information), np.empty(common)
    for i in range(common):
        rest[i] = sums.edge_vector[i]
        for j in range(6):
            rest[i] -= sums.edge_information[i, j] * to_patches[j]
    vector = product(X, rest)
    for i in range(common):
        state.vector[i] += part * vector[i]
        for j in range(common):
            state.information[i, j] += part * information[i, j]
    for g in range(len(edges.rows)):
        e, left = edges.rows[g], sums.offset_residual[g]
        for i in range(6):
            left -= sums.offset_jacobian[g, i] * to_patches[i]
        state.offset_prior[e] = 1.0 / edges.variance_px2[g]
        if state.kinds[e] >= 0:
            state.kind_prior[state.kinds[e]] = 1.0 / edges.kind_px2[g]
        state.told[e // TOGETHER] = 1
        state.offset_information[e] += part * sums.offset_weight[g]
        state.offset_vector[e] += part * left
        row = product(X, sums.offset_jacobian[g])
        for i in range(common):
            state.cross[e, i] += part * row[i]


@compiled("state", state=BIAS_STATE)
def known_of(state: BiasState) -> Expected:
    """What is known with all offsets marginalized, and D by the numbers."""
    spared, common = explained_by_offsets(state), len(state.vector)
    known, used_up, D = np.empty((common, common)), np.empty((6, 6)), np.empty((6, 1 + common - 6))
    for i in range(common):
        for j in range(common):
            known[i, j] = state.information[i, j] - spared.information[i, j]
    for i in range(6):
        D[i, 0] = state.vector[i] - spared.vector[i]
        for j in range(6):
            used_up[i, j] = known[i, j]
        for j in range(6, common):
            D[i, j - 5] = known[i, j]
    eliminate(used_up, D)
    return Expected(D, Known(known, spared.of_kinds))


@compiled("state f1 f2 f1", state=BIAS_STATE)
def centre(state: BiasState, moved: Array, R: Array, t: Array) -> PatchError:
    """The patches' error as a twist of the camera at (R, t), which is subtracted from the state's vectors in place.

    moved (r,): change of the numbers by which edges are located, which the state's vectors are relative to.
    """
    by_numbers, known = known_of(state)
    common, D = np.empty(len(state.vector)), np.empty(6)
    for k in range(len(moved)):
        common[6 + k] = moved[k]
    for i in range(6):
        D[i] = by_numbers[i, 0]
        for k in range(len(moved)):
            D[i] -= by_numbers[i, 1 + k] * moved[k]
        common[i] = D[i]
    explained = product(state.information, common)
    for i in range(len(common)):
        state.vector[i] -= explained[i]
    for block in range(len(state.told)):
        for e in told_of(state, block):
            if state.offset_information[e] > 0.0:
                for i in range(len(common)):
                    state.offset_vector[e] -= state.cross[e, i] * common[i]
    for k in range(len(state.kind_prior)):
        for i in range(len(common)):
            known.of_kinds.vector[k] -= known.of_kinds.cross[k, i] * common[i]
    return PatchError(product(adjoint(R, t), D), known)
