"""Compiled pose update: Gauss-Newton with Tukey's biweight over candidates of control points and patches.

Poses are cam_from_world; twists are in the camera frame, translation first, in m and rad.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.tracker.geometry_kernels import eliminate, normal_row, se3_exp_left, se3_log_left, solve6
from uavbench.tracker.robust.config.solver import EstimatorConfig
from uavbench.tracker.robust.edges.columns import NORMAL_U, NORMAL_V, U, V
from uavbench.tracker.robust.edges.measurements import EDGE_MEASUREMENTS, EdgeMeasurements
from uavbench.tracker.robust.kernel_values import kernel_type
from uavbench.tracker.robust.patches.matches import PATCH_MATCHES, PatchMatches
from uavbench.tracker.robust.solver.bias_state import FRAME_SUMS, LOCAL_BIASES, FrameSums, LocalBiases
from uavbench.tracker.robust.view import VIEW, View
from uavbench.trajectories.kernels.argument_types import named_tuple
from uavbench.trajectories.kernels.compiled import compiled
from uavbench.trajectories.kernels.lens import project
from uavbench.trajectories.pose import Array

EFFICIENT = 4.685
"""Cutoff of the biweight in standard deviations, of 95 % efficiency for normal errors (Holland & Welsch 1977)."""
ESTIMATOR = kernel_type(EstimatorConfig)

Indices = NDArray[np.int64]


class PosePrior(NamedTuple):
    """Predicted pose R (3, 3), t (3,) in m and its information (6, 6) in m^-2 and rad^-2."""

    information: Array
    R: Array
    t: Array


class Weighting(NamedTuple):
    """Residuals and weights of the M-estimator.

    residual (n,) signed, px, infinite for points that are skipped; weight (n,) in [0, weight of the measurement];
    patch_weight (m,) in [0, 1].
    """

    residual: Array
    weight: Array
    patch_weight: Array


class Step(NamedTuple):
    """Solution of the normal equations: information (6, 6) of the pose, and the twists (6,) to the pose of the patches
    alone and to that of all measurements.
    """

    information: Array
    to_patches: Array
    to_fit: Array


class Estimate(NamedTuple):
    """A pose R (3, 3), t (3,), the last step, and the terms of the normal equations and the weights at that step."""

    R: Array
    t: Array
    step: Step
    sums: FrameSums
    weighting: Weighting


POSE_PRIOR = named_tuple(PosePrior, "f2! f2! f1!")
WEIGHTING = named_tuple(Weighting, "f1! f1! f1!")
STEP = named_tuple(Step, "f2! f1! f1!")


@compiled("f2! f1! f1 f0 f0", inner=True)
def add_row(A: Array, b: Array, row: Array, d: float, w: float) -> None:
    """Add the equation row (6,) . x = d of weight w to the normal equations A (6, 6), its lower half, and b (6,)."""
    for i in range(6):
        wi = w * row[i]
        b[i] += wi * d
        for j in range(i + 1):
            A[i, j] += wi * row[j]


@compiled("f2!", inner=True)
def mirror(A: Array) -> None:
    """Copy the lower half of a matrix (6, 6) to the upper one."""
    for i in range(6):
        for j in range(i):
            A[j, i] = A[i, j]


@compiled(
    "measured biases view f0 weighting sums",
    inner=True,
    measured=EDGE_MEASUREMENTS,
    biases=LOCAL_BIASES,
    view=VIEW,
    weighting=WEIGHTING,
    sums=FRAME_SUMS,
)
def add_points(
    measured: EdgeMeasurements,
    biases: LocalBiases,
    view: View,
    width_px: float,
    weighting: Weighting,
    sums: FrameSums,
) -> None:
    """Weigh the control points at the view's pose by the biweight, and sum them up, in place.

    Its cutoff is width_px; for points located by a single candidate it is EFFICIENT standard deviations of their
    distance from the offset that their edge is known to have, if that is less.
    """
    points, lines, first = measured.points.points, measured.lines.lines, measured.points.first
    distance = measured.candidates.distance
    S, s, d = sums.offset_weight, sums.offset_jacobian, sums.offset_residual
    E, e, R, t, lens = sums.edge_information, sums.edge_vector, view.R, view.t, view.lens
    weight, variance_px2 = measured.weight, measured.variance_px2
    weights, residual = weighting.weight, weighting.residual
    for matrix in (E, s):
        matrix[:] = 0.0
    for column in (S, d, e):
        column[:] = 0.0
    row, c = np.empty(6), np.empty(3)
    located = distance.shape[1] == 1
    for g in range(len(first) - 1):
        expected = biases.expected.px[g] if located else 0.0
        for p in range(first[g], first[g + 1]):
            weights[p], residual[p] = 0.0, np.inf
            if weight[p] <= 0.0:
                continue
            for i in range(3):
                c[i] = R[i, 0] * points[p, 0] + R[i, 1] * points[p, 1] + R[i, 2] * points[p, 2] + t[i]
            if c[2] < view.near:
                continue
            u, v = project(c[0], c[1], c[2], lens)
            nu, nv = lines[p, NORMAL_U], lines[p, NORMAL_V]
            moved = (u - lines[p, U]) * nu + (v - lines[p, V]) * nv
            best, r_best = np.inf, np.inf
            square_px2 = width_px * width_px
            if located:
                square_px2 = min(square_px2, EFFICIENT**2 * (variance_px2[p] + biases.expected.variance_px2[g]))
            for candidate in range(distance.shape[1]):
                r = distance[p, candidate] - moved
                cost = (r - expected) ** 2 / square_px2
                if cost < best:
                    best, r_best = cost, r
            residual[p] = r_best
            if best < 1.0:
                weights[p] = weight[p] * (1.0 - best) * (1.0 - best)
                normal_row(c[0], c[1], c[2], nu, nv, lens, row)
                w = weights[p] / variance_px2[p]
                add_row(E, e, row, r_best, w)
                S[g] += w
                d[g] += w * r_best
                for i in range(6):
                    s[g, i] += w * row[i]
    mirror(E)


@compiled(
    "matches view f0 f0 weighting sums",
    inner=True,
    matches=PATCH_MATCHES,
    view=VIEW,
    weighting=WEIGHTING,
    sums=FRAME_SUMS,
)
def add_patches(
    matches: PatchMatches, view: View, width_px: float, most_sigmas: float, weighting: Weighting, sums: FrameSums
) -> None:
    """Weigh the patches at the view's pose by the biweight, and sum them up, in place.

    Its cutoff is width_px, and no more than so many standard deviations of a patch.
    """
    places, R, t, lens = matches.places, view.R, view.t, view.lens
    P, q, weights = sums.patch_information, sums.patch_vector, weighting.patch_weight
    correlation, observed, variance_px2 = matches.correlation, matches.observed, matches.variance_px2
    P[:] = 0.0
    q[:] = 0.0
    row, c = np.empty(6), np.empty(3)
    for p in range(len(places)):
        weights[p] = 0.0
        if correlation[p] <= 0.0:
            continue
        for i in range(3):
            c[i] = R[i, 0] * places[p, 0] + R[i, 1] * places[p, 1] + R[i, 2] * places[p, 2] + t[i]
        if c[2] < view.near:
            continue
        u, v = project(c[0], c[1], c[2], lens)
        ru, rv = observed[p, 0] - u, observed[p, 1] - v
        cost = (ru * ru + rv * rv) / min(width_px * width_px, most_sigmas**2 * variance_px2[p])
        if cost < 1.0:
            w = (1.0 - cost) * (1.0 - cost)
            weights[p] = w
            normal_row(c[0], c[1], c[2], 1.0, 0.0, lens, row)
            add_row(P, q, row, ru, w / variance_px2[p])
            normal_row(c[0], c[1], c[2], 0.0, 1.0, lens, row)
            add_row(P, q, row, rv, w / variance_px2[p])
    mirror(P)


@compiled(
    "sums biases prior view step estimator",
    inner=True,
    sums=FRAME_SUMS,
    biases=LOCAL_BIASES,
    prior=POSE_PRIOR,
    view=VIEW,
    step=STEP,
    estimator=ESTIMATOR,
)
def solve_step(
    sums: FrameSums, biases: LocalBiases, prior: PosePrior, view: View, step: Step, config: EstimatorConfig
) -> bool:
    """Solve the normal equations of pose and biases, the biases marginalized, into `step`; False where singular.

    (H, h) are those of the pose and of the patches' pose error, in this order.
    """
    E, e, P, q = sums.edge_information, sums.edge_vector, sums.patch_information, sums.patch_vector
    H, h = np.zeros((12, 12)), np.zeros(12)
    to_prior = se3_log_left(view.R, view.t, prior.R, prior.t)
    for i in range(6):
        h[i], h[6 + i] = e[i] + q[i], biases.vector[i] - q[i]
        for j in range(6):
            h[i] += prior.information[i, j] * to_prior[j]
            H[i, j] = E[i, j] + P[i, j] + prior.information[i, j]
            H[6 + i, 6 + j], H[6 + i, j] = P[i, j] + biases.information[i, j], -P[i, j]
    marginalize_offsets(sums, biases, H, h)
    A, b, row, held = step.information, np.empty(6), np.empty(6), np.empty((6, 6))
    M, N = np.empty((6, 6)), np.empty((6, 7))
    part = config.patches_prior_part  # a small part of the other information regularizes the pose of the patches alone
    for i in range(6):
        b[i], N[i, 6] = h[i], h[6 + i]
        row[i] = q[i] + part * b[i]
        for j in range(6):
            A[i, j] = H[max(i, j), min(i, j)]
            M[i, j], N[i, j] = H[6 + max(i, j), 6 + min(i, j)], H[6 + i, j]
            held[i, j] = P[i, j] + part * A[i, j]
    if not solve6(held, row, step.to_patches):
        return False
    eliminate(M, N)
    for i in range(6):
        for k in range(6):
            b[i] -= H[6 + k, i] * N[k, 6]
            for j in range(6):
                A[i, j] -= H[6 + k, i] * N[k, j]
    return solve6(A, b, step.to_fit)


@compiled("sums biases f2! f1!", inner=True, sums=FRAME_SUMS, biases=LOCAL_BIASES)
def marginalize_offsets(sums: FrameSums, biases: LocalBiases, H: Array, h: Array) -> None:
    """Marginalize the offset of each edge, then what the edges of each kind share, from H (12, 12), its lower half, and
    h (12,), in place.
    """
    S, s, d = sums.offset_weight, sums.offset_jacobian, sums.offset_residual
    cross, kinds, ties, of_kinds = biases.cross, biases.kinds, biases.ties, biases.of_kinds
    row, count = np.empty(12), len(of_kinds.information)
    rows, shared, vector = np.zeros((count, 12)), of_kinds.information.copy(), of_kinds.vector.copy()
    for k in range(count):
        for i in range(6):
            rows[k, 6 + i] = of_kinds.cross[k, i]
    for g in range(len(S)):
        if S[g] <= 0.0 and cross[g, 0] == 0.0:
            continue
        for i in range(6):
            row[i], row[6 + i] = s[g, i], cross[g, i]
        scale = 1.0 / (biases.offset_information[g] + S[g])
        offset = (biases.offset_vector[g] + d[g]) * scale
        marginalize(H, h, row, offset, scale)
        k, tie = kinds[g], ties[g]
        if k >= 0:
            shared[k] += abs(tie) - tie * tie * scale
            vector[k] += tie * offset
            for i in range(12):
                rows[k, i] += tie * scale * row[i]
    for k in range(count):
        scale = 1.0 / shared[k]
        marginalize(H, h, rows[k], vector[k] * scale, scale)


@compiled("f2! f1! f1 f0 f0", inner=True)
def marginalize(H: Array, h: Array, row: Array, value: float, variance: float) -> None:
    """Marginalize an unknown of this value and variance from H (n, n), its lower half, and h (n,), in place.

    row (n,): information between it and the others (Schur complement).
    """
    for i in range(len(h)):
        h[i] -= row[i] * value
        for j in range(i + 1):
            H[i, j] -= row[i] * row[j] * variance


@compiled(
    "measured matches biases prior view f1 estimator",
    measured=EDGE_MEASUREMENTS,
    matches=PATCH_MATCHES,
    biases=LOCAL_BIASES,
    prior=POSE_PRIOR,
    view=VIEW,
    estimator=ESTIMATOR,
)
def refine(
    measured: EdgeMeasurements,
    matches: PatchMatches,
    biases: LocalBiases,
    prior: PosePrior,
    view: View,
    widths_px: Array,
    config: EstimatorConfig,
) -> Estimate:
    """The pose of least robust distances of control points to their candidates and of patches to their matches.

    Gauss-Newton from the view's pose, one iteration for each biweight cutoff of widths_px (k,), with residuals weighted
    by their inverse variances. It stops before a step with singular equations.
    """
    n, m, edges = len(measured.weight), len(matches.places), len(measured.points.first) - 1
    R, t = view.R.copy(), view.t.copy()
    weighting = Weighting(np.zeros(n), np.zeros(n), np.zeros(m))
    step = Step(np.zeros((6, 6)), np.zeros(6), np.zeros(6))
    sums = FrameSums(
        *(np.zeros(edges), np.zeros((edges, 6)), np.zeros(edges)),
        *(np.zeros((6, 6)), np.zeros(6), np.zeros((6, 6)), np.zeros(6)),
    )
    for width_px in widths_px:
        now = View(R, t, view.lens, view.size_px, view.bounds_px, view.near)
        add_points(measured, biases, now, width_px, weighting, sums)
        # Once edges have told the pose, a patch that does not move with them is none of the structure's.
        most_sigmas = EFFICIENT if n > 0 and width_px == widths_px[-1] else np.inf
        add_patches(matches, now, width_px, most_sigmas, weighting, sums)
        if not solve_step(sums, biases, prior, now, step, config):
            break
        moved = se3_exp_left(R, t, step.to_fit)
        R, t = moved.R, moved.t
    return Estimate(R, t, step, sums, weighting)
