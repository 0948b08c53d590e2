"""Compiled spread of the edges of a frame about its fit, and about what all else tells of each, by the variances that
were assumed of them.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.tracker.robust.solver.bias_state import (
    BIAS_STATE,
    EDGE_OFFSETS,
    FRAME_SUMS,
    BiasState,
    EdgeOffsets,
    FrameSums,
    KindSums,
    LocalBiases,
)
from uavbench.tracker.robust.solver.sum_kernels import EFFICIENT
from uavbench.trajectories.kernels.compiled import compiled, inlined
from uavbench.trajectories.pose import Array

Indices = NDArray[np.int64]
LEAST_LEFT = 1e-6
"""Least part of the variance of an edge's mean residual that a fit leaves of it: it is positive but for rounding."""


class Joint(NamedTuple):
    """What a fit tells of the pose, the patches' pose error and the numbers that all edges share, in this order.

    value (12 + r,); covariance (12, 12) of the first two if the numbers were known.
    """

    value: Array
    covariance: Array


@inlined(allocates=False)
def weigh_edges(
    sums: FrameSums, biases: LocalBiases, of_kinds: KindSums, joint: Joint, row: Array, edge_weight: Array
) -> None:
    """Write the weights (g,) of the edges: the biweight of their deletion residuals, cut off at EFFICIENT.

    Such a residual is the distance of an edge's points from where all else that the frame shows, and what earlier
    frames told of the edge's offset, expect their mean, in standard deviations (Cook & Weisberg 1982). What else comes
    to lie where an edge was found may draw the fit along, and leaves no residual there.

    of_kinds: of `marginalize_offsets`; row (12 + r,): room for an edge. Edges keep their weights where they have no
    point in the fit, or where rounding left it without a covariance.
    """
    S, s, d, cross = sums.offset_weight, sums.offset_jacobian, sums.offset_residual, biases.cross
    value, covariance = joint.value, joint.covariance
    for g in range(len(S)):
        if not S[g] > 0.0:
            continue
        left_px2 = 1.0 / (biases.offset_information[g] + S[g])  # of the offset, if all else was known
        k, residual, known_px2 = biases.kinds[g], d[g] / S[g] - left_px2 * (biases.offset_vector[g] + d[g]), left_px2
        part = biases.ties[g] * left_px2 / of_kinds.information[k] if k >= 0 else 0.0
        residual -= part * of_kinds.vector[k] if k >= 0 else 0.0
        known_px2 += part * part * of_kinds.information[k] if k >= 0 else 0.0
        for i in range(len(row)):
            seen = s[g, i] if i < 6 else s[g, i - 6] if i >= 12 else 0.0
            known = cross[g, i - 6] if i >= 6 else 0.0
            row[i] = seen / S[g] - left_px2 * (seen + known) - (part * of_kinds.cross[k, i] if k >= 0 else 0.0)
            residual -= row[i] * value[i]
        for i in range(12):
            for j in range(12):
                known_px2 += row[i] * covariance[i, j] * row[j]
        if math.isnan(known_px2):
            continue
        left = max(LEAST_LEFT / S[g], 1.0 / S[g] - known_px2)
        cost = residual * residual / (EFFICIENT * EFFICIENT * left)
        edge_weight[g] = (1.0 - cost) * (1.0 - cost) if cost < 1.0 else 0.0


class Spread(NamedTuple):
    """Sum of squares of the mean residuals of edges, by their covariance, and its degrees of freedom."""

    chi2: float
    freedom: float


class MeansOfEdges(NamedTuple):
    """What mean residuals of edges tell by their covariance: information (6, 6), vector (6,) and sum of squares."""

    information: Array
    vector: Array
    squares: float


@compiled("sums edges state f1", inner=True, sums=FRAME_SUMS, edges=EDGE_OFFSETS, state=BIAS_STATE)
def means_of_edges(sums: FrameSums, edges: EdgeOffsets, state: BiasState, residual: Array) -> MeansOfEdges:
    """What mean residuals (g,) of the edges in view tell, those that are not NaN.

    That of an edge has the variance of its own offset, of what it shares with its kind, and of its points.
    """
    count, squares = len(state.kind_prior), 0.0
    weight, vector, rows, shared_px2 = np.zeros(count), np.zeros(count), np.zeros((count, 6)), np.zeros(count)
    information, pull = np.zeros((6, 6)), np.zeros(6)
    S, s = sums.offset_weight, sums.offset_jacobian
    for g in range(len(S)):
        if S[g] <= 0.0 or math.isnan(residual[g]):
            continue
        a, k = 1.0 / (edges.variance_px2[g] + 1.0 / S[g]), state.kinds[edges.rows[g]]
        squares += a * residual[g] * residual[g]
        for i in range(6):
            pull[i] += a * s[g, i] / S[g] * residual[g]
            for j in range(6):
                information[i, j] += a * s[g, i] * s[g, j] / (S[g] * S[g])
        if k >= 0:
            signed = a * state.signs[edges.rows[g]]
            weight[k] += a
            vector[k] += signed * residual[g]
            shared_px2[k] = edges.kind_px2[g]
            for i in range(6):
                rows[k, i] += signed * s[g, i] / S[g]
    for k in range(count):
        if weight[k] > 0.0:  # Sherman & Morrison (1950): what a kind shares is of rank one
            part = shared_px2[k] / (1.0 + shared_px2[k] * weight[k])
            squares -= part * vector[k] * vector[k]
            for i in range(6):
                pull[i] -= part * rows[k, i] * vector[k]
                for j in range(6):
                    information[i, j] -= part * rows[k, i] * rows[k, j]
    return MeansOfEdges(information, pull, squares)


@compiled("sums i1 i1 f1", sums=FRAME_SUMS)
def mean_residuals(sums: FrameSums, first: Indices, steps: Indices, to_numbers: Array) -> Array:
    """Mean residuals (g,) of the edges in view, px, NaN where no control point is located. Arguments as below."""
    S, s, d = sums.offset_weight, sums.offset_jacobian, sums.offset_residual
    residual = np.full(len(S), np.nan)
    for g in range(len(S)):
        located = False
        for p in range(first[g], first[g + 1]):
            located = located or steps[p] > 0
        if S[g] <= 0.0 or not located:
            continue
        residual[g] = d[g] / S[g]
        for i in range(len(to_numbers)):
            residual[g] -= s[g, 6 + i] / S[g] * to_numbers[i]
    return residual


@compiled("sums edges state i1 i1 f1 f2", sums=FRAME_SUMS, edges=EDGE_OFFSETS, state=BIAS_STATE)
def edge_spread(
    sums: FrameSums,
    edges: EdgeOffsets,
    state: BiasState,
    first: Indices,
    steps: Indices,
    to_numbers: Array,
    covariance: Array,
) -> Spread:
    """Spread of the edges in view of which a control point is located between the pixels (steps > 0, of first[g] on).

    to_numbers (r,): last step of the numbers; covariance (6, 6) of the pose, which takes degrees of freedom.
    """
    residual, freedom = mean_residuals(sums, first, steps, to_numbers), 0.0
    for g in range(len(residual)):
        freedom += 0.0 if math.isnan(residual[g]) else 1.0
    means = means_of_edges(sums, edges, state, residual)
    for i in range(6):
        for j in range(6):
            freedom -= means.information[i, j] * covariance[i, j]
    return Spread(means.squares, freedom)


@compiled("sums edges state f1 f2", inner=True, sums=FRAME_SUMS, edges=EDGE_OFFSETS, state=BIAS_STATE)
def moved_by(sums: FrameSums, edges: EdgeOffsets, state: BiasState, displaced_px: Array, covariance: Array) -> Array:
    """Twist (6,) by which displacements (g,) of the edges in view move a fit with a covariance (6, 6)."""
    means, twist = means_of_edges(sums, edges, state, displaced_px), np.zeros(6)
    for i in range(6):
        for j in range(6):
            twist[i] += covariance[i, j] * means.vector[j]
    return twist
