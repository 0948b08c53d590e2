"""Compiled pose update: Gauss-Newton over the sums of control points and patches, the biases marginalized.

Poses are cam_from_world; twists are in the camera frame, translation first, in m and rad.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.tracker.geometry_kernels import eliminate, se3_exp_left, se3_log_left, solve6
from uavbench.tracker.robust.config.solver import EstimatorConfig
from uavbench.tracker.robust.edges.measurements import EDGE_MEASUREMENTS, EdgeMeasurements
from uavbench.tracker.robust.kernel_values import kernel_type
from uavbench.tracker.robust.patches.matches import PATCH_MATCHES, PatchMatches
from uavbench.tracker.robust.solver.bias_kernels import linearize
from uavbench.tracker.robust.solver.bias_state import (
    BIASES_IN_VIEW,
    FRAME_SUMS,
    LOCAL_BIASES,
    BiasesInView,
    FrameSums,
    LocalBiases,
)
from uavbench.tracker.robust.solver.sum_kernels import EFFICIENT, Weighting, add_patches, add_points
from uavbench.tracker.robust.view import VIEW, View
from uavbench.trajectories.kernels.argument_types import named_tuple
from uavbench.trajectories.kernels.compiled import compiled, inlined
from uavbench.trajectories.pose import Array

ESTIMATOR = kernel_type(EstimatorConfig)
UNKNOWNS = 6
"""Unknowns of a pose, of which a control point tells one; the expectation of its squared Mahalanobis distance."""

Indices = NDArray[np.int64]


class PosePrior(NamedTuple):
    """Predicted pose R (3, 3), t (3,) in m and its information (6, 6) in m^-2 and rad^-2."""

    information: Array
    R: Array
    t: Array


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
STEP = named_tuple(Step, "f2! f1! f1!")


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


@inlined
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


@inlined
def marginalize(H: Array, h: Array, row: Array, value: float, variance: float) -> None:
    """Marginalize an unknown of this value and variance from H (n, n), its lower half, and h (n,), in place.

    row (n,): information between it and the others (Schur complement).
    """
    for i in range(len(h)):
        part = row[i] * variance
        h[i] -= row[i] * value
        for j in range(i + 1):
            H[i, j] -= part * row[j]


@compiled(
    "measured matches biases prior view f1 estimator",
    measured=EDGE_MEASUREMENTS,
    matches=PATCH_MATCHES,
    biases=BIASES_IN_VIEW,
    prior=POSE_PRIOR,
    view=VIEW,
    estimator=ESTIMATOR,
)
def refine(
    measured: EdgeMeasurements,
    matches: PatchMatches,
    biases: BiasesInView,
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
    R, t, local = view.R.copy(), view.t.copy(), linearize(biases, view.R, view.t)
    weighting = Weighting(np.zeros(n), np.zeros(n), np.zeros(m))
    step = Step(np.zeros((6, 6)), np.zeros(6), np.zeros(6))
    sums = FrameSums(
        *(np.zeros(edges), np.zeros((edges, 6)), np.zeros(edges)),
        *(np.zeros((6, 6)), np.zeros(6), np.zeros((6, 6)), np.zeros(6)),
    )
    for width_px in widths_px:
        now = View(R, t, view.lens, view.size_px, view.bounds_px, view.near)
        add_points(measured, local, now, width_px, weighting, sums)
        # Once edges have told the pose, a patch that does not move with them is none of the structure's.
        told = np.count_nonzero(weighting.weight) >= UNKNOWNS and width_px == widths_px[-1]
        most_sigmas = EFFICIENT if told else np.inf
        add_patches(matches, now, width_px, most_sigmas, weighting, sums)
        if not solve_step(sums, local, prior, now, step, config):
            break
        moved = se3_exp_left(R, t, step.to_fit)
        R, t = moved.R, moved.t
    return Estimate(R, t, step, sums, weighting)
