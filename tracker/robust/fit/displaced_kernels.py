"""Compiled covariance of a fit to a model that is not exact, whose members were built beside where it has them."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.tracker.robust.solver.bias_state import EDGE_OFFSETS, FRAME_SUMS, EdgeOffsets, FrameSums
from uavbench.tracker.robust.solver.sum_kernels import EFFICIENT
from uavbench.trajectories.kernels.compiled import compiled
from uavbench.trajectories.pose import Array

Indices = NDArray[np.int64]
SCALE_STEPS = 30
"""Steps of expectation maximization to the scale of residuals, which has converged to a part of 10^-3 then."""
MOST_EXPONENT = 700.0
"""Largest exponent that floating point numbers hold."""
DEVIATIONS, LESS = 12, 0.5**0.5
"""Standard deviations of edges that are compared, each so many times the one before: any is as likely. Not tuned."""
LEAST_LEFT = 0.01
"""Least part of an edge's variance that a fit is taken to leave in its residual: it only keeps it positive. By eye."""


@compiled("f1", inner=True)
def displaced_alike(residual: Array) -> float:
    """Probability that residuals (k,), each by what a fit leaves of it, are of one variance.

    The other half of the prior probability has that each edge has a variance of its own, of any size: with one degree
    of freedom, so that the residuals are of a Cauchy distribution (Andrews & Mallows 1974). The scales of both are
    those of most likelihood.
    """
    n, squares = float(len(residual)), 0.0
    for r in residual:
        squares += r * r
    if not squares > 0.0:
        return 0.0
    one = -0.5 * n * (math.log(2.0 * math.pi * squares / n) + 1.0)
    scale2 = squares / n
    for _ in range(SCALE_STEPS):
        weighed = 0.0
        for r in residual:
            weighed += 2.0 * r * r / (1.0 + r * r / scale2)
        scale2 = weighed / n
    own = -n * math.log(math.pi * math.sqrt(scale2))
    for r in residual:
        own -= math.log(1.0 + r * r / scale2)
    return 1.0 / (1.0 + math.exp(min(MOST_EXPONENT, own - one)))


@compiled("f1 f1 f0", inner=True)
def displaced_px2(residual: Array, believed_px: Array, most_px: float) -> float:
    """Variance, px^2, of edges that are displaced alike, by their mean residuals (k,).

    It is the mean over deviations of which any up to most_px is as likely. Where an edge is found is cut off at most_px
    or, if less, at believed_px (k,), so that small residuals say little of edges that are believed to be exact. How
    many are cut off there is told by how many lie within.
    """
    n, squares, within, believed, px = len(residual), 0.0, 0.0, 0.0, most_px
    told = np.empty(DEVIATIONS)
    for k in range(n):
        squares += residual[k] * residual[k]
        if believed_px[k] < most_px:
            believed += 1.0
            within += 1.0 if abs(residual[k]) <= believed_px[k] else 0.0
    part = within / max(1.0, believed)
    for i in range(DEVIATIONS):
        told[i], per_px = -n * math.log(px) - 0.5 * squares / (px * px), 1.0 / (math.sqrt(2.0) * px)
        most = math.erf(most_px * per_px)
        for k in range(n):
            off = abs(residual[k])
            found = 1.0 / (most if off <= most_px else math.erf(off * per_px))
            if believed_px[k] < most_px:
                found *= 1.0 - part
                found += part / math.erf(believed_px[k] * per_px) if off <= believed_px[k] else 0.0
            told[i] += math.log(found)
        px *= LESS
    weights, mean, best, px = 0.0, 0.0, told.max(), most_px
    for i in range(DEVIATIONS):
        weight = math.exp(told[i] - best)
        weights += weight
        mean += weight * px * px
        px *= LESS
    return mean / weights


class ByMembers(NamedTuple):
    """Covariance (6, 6) of a fit by members that are displaced by 1 px each, and the part of the squares of what that
    moves edges by which a fit leaves in their residuals.
    """

    covariance: Array
    left: float


@compiled("f2 f2 i1", inner=True)
def by_members(jacobian: Array, moved: Array, members: Indices) -> ByMembers:
    """What displacements of members do to a fit, by the Jacobians (k, 6) of edges, how a displacement of each by 1 px
    moves the fit (k, 6), and the member (k,) that each is of.

    A member's displacement moves its edges as a translation of the camera does, each along its own normal.
    """
    n, count, first, along = len(members), 0, np.empty(len(members), np.int64), np.empty(3)
    of_fit, of_edges, squares = np.zeros((n, 6, 3)), np.zeros((n, 6, 3)), np.zeros((6, 6))
    for k in range(n):
        m = 0
        while m < count and members[first[m]] != members[k]:
            m += 1
        if m == count:
            first[m], count = k, count + 1
        px_per_m = math.sqrt(jacobian[k, 0] ** 2 + jacobian[k, 1] ** 2 + jacobian[k, 2] ** 2)
        for c in range(3):
            along[c] = jacobian[k, c] / px_per_m
        for i in range(6):
            for c in range(3):
                of_fit[m, i, c] += moved[k, i] * along[c]
                of_edges[m, i, c] += jacobian[k, i] * along[c]
            for j in range(6):
                squares[i, j] += jacobian[k, i] * jacobian[k, j]
    covariance, left = np.zeros((6, 6)), float(n)
    for m in range(count):
        for c in range(3):
            for i in range(6):
                left -= 2.0 * of_fit[m, i, c] * of_edges[m, i, c]
                for j in range(6):
                    both = of_fit[m, i, c] * of_fit[m, j, c]
                    covariance[i, j] += both
                    left += squares[i, j] * both
    return ByMembers(covariance, min(1.0, max(0.0, left / n)))


@compiled("sums edges f1 i1 f2 f0 f0", sums=FRAME_SUMS, edges=EDGE_OFFSETS)
def left_by_displaced(
    sums: FrameSums,
    edges: EdgeOffsets,
    residual: Array,
    members: Indices,
    covariance: Array,
    unit_variance: float,
    most_px: float,
) -> Array:
    """What a covariance (6, 6) with a variance of unit weight lacks, expected over whether edges are displaced alike.

    If they are, those that a fit follows are no better than the others, and the fit stays the one that it is (sandwich:
    White 1980). All edges of a member are displaced together; what that leaves in no residual, as where all are of one
    member, is of each edge alone, with one variance where that is more than what was assumed of it. residual (g,): see
    `mean_residuals`; members (g,): the member of each edge in view; most_px: where an edge may be found at most.
    """
    S, s, seen = sums.offset_weight, sums.offset_jacobian, np.flatnonzero(~np.isnan(residual))
    n, more, of_edges = len(seen), np.zeros((6, 6)), np.zeros((6, 6))
    if n == 0:
        return more
    jacobian, moved, assumed_px2 = np.empty((n, 6)), np.zeros((n, 6)), np.empty(n)
    believed_px, follows, squares = np.empty(n), np.zeros(n), 0.0
    for k in range(n):
        g = seen[k]
        of_offset, off = edges.variance_px2[g] + edges.kind_px2[g], abs(residual[g])
        assumed_px2[k] = of_offset + 1.0 / S[g]
        for i in range(6):
            jacobian[k, i] = s[g, i] / S[g]
        for i in range(6):
            for j in range(6):
                moved[k, i] += covariance[i, j] * jacobian[k, j] / assumed_px2[k]
            follows[k] += jacobian[k, i] * moved[k, i]
        for i in range(6):
            for j in range(6):
                of_edges[i, j] += moved[k, i] * moved[k, j]
        believed_px[k] = EFFICIENT * math.sqrt(2.0 * of_offset)  # of its points, by the M-estimator
        squares += off * off
    together, left = by_members(jacobian, moved, members[seen]), residual[seen]
    of_members = together.left * displaced_px2(left, believed_px, most_px)
    own_px2 = squares / max(1.0, n - follows.sum())
    for k in range(n):
        of_fit = 1.0 - 2.0 * follows[k]
        for i in range(6):
            for j in range(6):
                of_fit += jacobian[k, i] * of_edges[i, j] * jacobian[k, j]
        left[k] /= math.sqrt(1.0 - together.left + together.left * max(LEAST_LEFT, of_fit))
    alike = displaced_alike(left)
    for i in range(6):
        for j in range(6):
            more[i, j] = alike * of_members * together.covariance[i, j]
    for k in range(n):
        own = alike * (1.0 - together.left) * max(0.0, own_px2 - unit_variance * assumed_px2[k])
        for i in range(6):
            for j in range(6):
                more[i, j] += own * (moved[k, i] * moved[k, j])
    return more
