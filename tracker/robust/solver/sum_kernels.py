"""Compiled sums over the control points and patches of an image, weighted by Tukey's biweight.

Poses are cam_from_world; twists are in the camera frame, translation first, in m and rad.
"""

from typing import NamedTuple

import numpy as np

from uavbench.tracker.geometry_kernels import normal_row
from uavbench.tracker.robust.edges.columns import NORMAL_U, NORMAL_V, U, V
from uavbench.tracker.robust.edges.measurements import EdgeMeasurements
from uavbench.tracker.robust.patches.matches import PatchMatches
from uavbench.tracker.robust.solver.bias_state import FrameSums, LocalBiases
from uavbench.tracker.robust.solver.number_state import KnownNumbers
from uavbench.tracker.robust.view import View, pixel_of
from uavbench.trajectories.kernels.argument_types import named_tuple
from uavbench.trajectories.kernels.compiled import compiled, inlined
from uavbench.trajectories.pose import Array

EFFICIENT = 4.685
"""Cutoff of the biweight in standard deviations, of 95 % efficiency for normal errors (Holland & Welsch 1977)."""


class Weighting(NamedTuple):
    """Residuals and weights of the M-estimator.

    residual (n,) signed, px, infinite for points that are skipped; weight (n,) in [0, weight of the measurement];
    patch_weight (m,) in [0, 1]; edge_weight (g,) in [0, 1], a factor of the weights of an edge's points.
    """

    residual: Array
    weight: Array
    patch_weight: Array
    edge_weight: Array


class Iterate(NamedTuple):
    """Where a fit is `at` as an iteration begins, the numbers as known, and the biweight's cutoff width_px.

    row (6 + r,): room for an equation, made once.
    """

    at: View
    known: KnownNumbers
    width_px: float
    row: Array


WEIGHTING = named_tuple(Weighting, "f1! f1! f1! f1!")


@inlined(allocates=False)
def add_row(A: Array, b: Array, row: Array, d: float, w: float) -> None:
    """Add the equation row (n,) . x = d of weight w to the normal equations A (n, n), its lower half, and b (n,)."""
    for i in range(len(b)):
        wi = w * row[i]
        b[i] += wi * d
        for j in range(i + 1):
            A[i, j] += wi * row[j]


@inlined(allocates=False)
def add_row_of_pose(A: Array, b: Array, row: Array, d: float, w: float) -> None:
    """As `add_row` of the 6 unknowns of a pose, the first of more, whose known number makes it take less time."""
    for i in range(6):
        wi = w * row[i]
        b[i] += wi * d
        for j in range(i + 1):
            A[i, j] += wi * row[j]


@compiled("f2!", inner=True, allocates=False)
def mirror(A: Array) -> None:
    """Copy the lower half of a matrix (n, n) to the upper one."""
    for i in range(len(A)):
        for j in range(i):
            A[j, i] = A[i, j]


@inlined(allocates=False)
def add_points(
    measured: EdgeMeasurements, biases: LocalBiases, now: Iterate, weighting: Weighting, sums: FrameSums
) -> None:
    """Weigh the control points at an iterate's pose by their edges and by the biweight, and sum them up, in place.

    Its cutoff is that of the iterate; for points located by a single candidate it is EFFICIENT standard deviations of
    their distance from the offset that their edge and the numbers are known to have, if that is less.
    """
    points, lines, first = measured.points.points, measured.lines.lines, measured.points.first
    distance = measured.candidates.distance
    view, known, row = now.at, now.known, now.row
    S, s, d = sums.offset_weight, sums.offset_jacobian, sums.offset_residual
    E, e, R, t, lens = sums.edge_information, sums.edge_vector, view.R, view.t, view.lens
    weight, variance_px2 = measured.weight, measured.variance_px2
    weights, residual = weighting.weight, weighting.residual
    for matrix in (E, s):
        matrix[:] = 0.0
    for column in (S, d, e):
        column[:] = 0.0
    by, numbers = measured.by_numbers, len(known.mean)
    located = distance.shape[1] == 1
    for g in range(len(first) - 1):
        for p in range(first[g], first[g + 1]):
            weights[p], residual[p] = 0.0, np.inf
            if weight[p] <= 0.0:
                continue
            x = R[0, 0] * points[p, 0] + R[0, 1] * points[p, 1] + R[0, 2] * points[p, 2] + t[0]
            y = R[1, 0] * points[p, 0] + R[1, 1] * points[p, 1] + R[1, 2] * points[p, 2] + t[1]
            z = R[2, 0] * points[p, 0] + R[2, 1] * points[p, 1] + R[2, 2] * points[p, 2] + t[2]
            if z < view.near:
                continue
            u, v = pixel_of(x, y, z, view)
            nu, nv = lines[p, NORMAL_U], lines[p, NORMAL_V]
            moved = (u - lines[p, U]) * nu + (v - lines[p, V]) * nv
            best, r_best = np.inf, np.inf
            square_px2 = now.width_px * now.width_px
            expected = 0.0
            if located:
                expected, variance = biases.expected.px[g], variance_px2[p] + biases.expected.variance_px2[g]
                for i in range(numbers):
                    for j in range(numbers):
                        variance += by[p, i] * known.covariance[i, j] * by[p, j]
                square_px2 = min(square_px2, EFFICIENT**2 * variance)
            for candidate in range(distance.shape[1]):
                r = distance[p, candidate] - moved
                cost = (r - expected) ** 2 / square_px2
                if cost < best:
                    best, r_best = cost, r
            residual[p] = r_best
            if best < 1.0:
                weights[p] = weighting.edge_weight[g] * weight[p] * (1.0 - best) * (1.0 - best)
                normal_row(x, y, z, nu, nv, lens, row)
                for i in range(numbers):
                    row[6 + i] = by[p, i]
                w = weights[p] / variance_px2[p]
                S[g] += w
                d[g] += w * r_best
                for i in range(6):
                    s[g, i] += w * row[i]
                add_row_of_pose(E, e, row, r_best, w)
                for i in range(6, 6 + numbers):
                    s[g, i] += w * row[i]
                    e[i] += w * row[i] * r_best
                    for j in range(i + 1):
                        E[i, j] += w * row[i] * row[j]
    mirror(E)


@inlined(allocates=False)
def add_patches(matches: PatchMatches, now: Iterate, most_sigmas: float, weighting: Weighting, sums: FrameSums) -> None:
    """Weigh the patches at an iterate's pose by the biweight, and sum them up, in place.

    Its cutoff is that of the iterate, and no more than so many standard deviations of a patch.
    """
    view, row, places = now.at, now.row, matches.places
    R, t, lens = view.R, view.t, view.lens
    P, q, weights = sums.patch_information, sums.patch_vector, weighting.patch_weight
    correlation, observed, variance_px2 = matches.correlation, matches.observed, matches.variance_px2
    P[:] = 0.0
    q[:] = 0.0
    for p in range(len(places)):
        weights[p] = 0.0
        if correlation[p] <= 0.0:
            continue
        x = R[0, 0] * places[p, 0] + R[0, 1] * places[p, 1] + R[0, 2] * places[p, 2] + t[0]
        y = R[1, 0] * places[p, 0] + R[1, 1] * places[p, 1] + R[1, 2] * places[p, 2] + t[1]
        z = R[2, 0] * places[p, 0] + R[2, 1] * places[p, 1] + R[2, 2] * places[p, 2] + t[2]
        if z < view.near:
            continue
        u, v = pixel_of(x, y, z, view)
        ru, rv = observed[p, 0] - u, observed[p, 1] - v
        cost = (ru * ru + rv * rv) / min(now.width_px * now.width_px, most_sigmas**2 * variance_px2[p])
        if cost < 1.0:
            w = (1.0 - cost) * (1.0 - cost)
            weights[p] = w
            normal_row(x, y, z, 1.0, 0.0, lens, row)
            add_row_of_pose(P, q, row, ru, w / variance_px2[p])
            normal_row(x, y, z, 0.0, 1.0, lens, row)
            add_row_of_pose(P, q, row, rv, w / variance_px2[p])
    mirror(P)
