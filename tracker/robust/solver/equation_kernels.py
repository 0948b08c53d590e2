"""Compiled normal equations of a pose, the patches' pose error and the numbers, and marginalization of the offsets.

Unknowns come in this order: 6, 6 and r. Of a matrix H only its lower half is kept.
"""

from typing import NamedTuple

import numpy as np

from uavbench.tracker.robust.solver.bias_state import FrameSums, KindSums, LocalBiases
from uavbench.tracker.robust.solver.number_state import KNOWN_NUMBERS, KnownNumbers
from uavbench.trajectories.kernels.argument_types import named_tuple
from uavbench.trajectories.kernels.compiled import compiled, inlined
from uavbench.trajectories.pose import Array


class PosePrior(NamedTuple):
    """Predicted pose R (3, 3), t (3,) in m, its information (6, 6) in m^-2 and rad^-2, and the numbers as known."""

    information: Array
    R: Array
    t: Array
    known: KnownNumbers


POSE_PRIOR = named_tuple(PosePrior, "f2! f2! f1! known", known=KNOWN_NUMBERS)


@inlined(allocates=False)
def add_edges(sums: FrameSums, biases: LocalBiases, prior: PosePrior, to_prior: Array, H: Array, h: Array) -> None:
    """Add what edges and priors say of the pose, the patches' pose error and the numbers to H (12 + r, 12 + r), its
    lower half, and h (12 + r,), in place, without the offsets.

    to_prior (6,): twist to the predicted pose.
    """
    E, e, n = sums.edge_information, sums.edge_vector, len(h)
    for i in range(6):
        h[i], h[6 + i] = h[i] + e[i], h[6 + i] + biases.vector[i]
        for j in range(6):
            h[i] += prior.information[i, j] * to_prior[j]
            H[i, j] += E[i, j] + prior.information[i, j]
            H[6 + i, 6 + j] += biases.information[i, j]
    for k in range(12, n):
        h[k] += e[k - 6] + biases.vector[k - 6]
        for i in range(6):
            H[k, i] += E[k - 6, i]
            H[k, 6 + i] += biases.information[k - 6, i]
        for j in range(12, n):
            H[k, j] += E[k - 6, j - 6] + biases.information[k - 6, j - 6]


@compiled
def room_for_kinds(biases: LocalBiases, unknowns: int) -> KindSums:
    """Room for what is known of the kinds beside so many unknowns."""
    count = len(biases.of_kinds.information)
    return KindSums(np.zeros(count), np.zeros((count, unknowns)), np.zeros(count))


@inlined(allocates=False)
def marginalize_offsets(
    sums: FrameSums, biases: LocalBiases, kinds_out: KindSums, row: Array, H: Array, h: Array
) -> None:
    """Marginalize the offset of each edge, then what the edges of each kind share, from H (12 + r, 12 + r), its lower
    half, and h (12 + r,), in place.

    What is known of the kinds is written into kinds_out, with cross (k, 12 + r); row (12 + r,) is room for an edge.
    """
    n = len(h)
    S, s, d = sums.offset_weight, sums.offset_jacobian, sums.offset_residual
    cross, kinds, ties, of_kinds = biases.cross, biases.kinds, biases.ties, biases.of_kinds
    shared, rows, vector, count = kinds_out.information, kinds_out.cross, kinds_out.vector, len(of_kinds.information)
    for k in range(count):
        shared[k], vector[k] = of_kinds.information[k], of_kinds.vector[k]
    for k in range(count):
        for i in range(n - 6):
            rows[k, 6 + i] = of_kinds.cross[k, i]
    for g in range(len(S)):
        for i in range(6):
            row[i], row[6 + i] = s[g, i], cross[g, i]
        for i in range(12, n):
            row[i] = s[g, i - 6] + cross[g, i - 6]
        scale = 1.0 / (biases.offset_information[g] + S[g])
        offset = (biases.offset_vector[g] + d[g]) * scale
        marginalize(H, h, row, offset, scale)
        k, tie = kinds[g], ties[g]
        if k >= 0:
            shared[k] += abs(tie) - tie * tie * scale
            vector[k] += tie * offset
            for i in range(n):
                rows[k, i] += tie * scale * row[i]
    for k in range(count):
        scale = 1.0 / shared[k]
        marginalize(H, h, rows[k], vector[k] * scale, scale)


@inlined(allocates=False)
def marginalize(H: Array, h: Array, row: Array, value: float, variance: float) -> None:
    """Marginalize an unknown of this value and variance from H (n, n), its lower half, and h (n,), in place.

    row (n,): information between it and the others (Schur complement).
    """
    for i in range(len(h)):
        part = row[i] * variance
        h[i] -= row[i] * value
        for j in range(i + 1):
            H[i, j] -= part * row[j]
