"""Compiled pose update: Gauss-Newton over the sums of control points and patches, the biases marginalized.

Poses are cam_from_world; twists are in the camera frame, translation first, in m and rad.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.tracker.geometry_kernels import eliminate, inverse6, se3_exp_left, se3_log_left, solve6
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
from uavbench.tracker.robust.solver.equation_kernels import (
    POSE_PRIOR,
    PosePrior,
    add_edges,
    marginalize,
    marginalize_offsets,
    room_for_kinds,
)
from uavbench.tracker.robust.solver.number_kernels import with_prior
from uavbench.tracker.robust.solver.spread_kernels import Joint, weigh_edges
from uavbench.tracker.robust.solver.sum_kernels import EFFICIENT, WEIGHTING, Iterate, Weighting, add_patches, add_points
from uavbench.tracker.robust.view import VIEW, View, placed
from uavbench.trajectories.kernels.argument_types import named_tuple
from uavbench.trajectories.kernels.compiled import compiled, inlined
from uavbench.trajectories.pose import Array

ESTIMATOR = kernel_type(EstimatorConfig)
UNKNOWNS = 6
"""Unknowns of a pose, of which a control point tells one; the expectation of its squared Mahalanobis distance."""

Indices = NDArray[np.int64]


class Step(NamedTuple):
    """Solution of the normal equations: information (6, 6) of the pose, and the twists (6,) to the pose of the patches
    alone and to that of all measurements.

    told (6, 6): information of the pose if the numbers were known; to_numbers (r,): from that by which edges were
    located to the most likely one.
    """

    information: Array
    to_patches: Array
    to_fit: Array
    told: Array
    to_numbers: Array


class Estimate(NamedTuple):
    """A pose R (3, 3), t (3,), the last step, and the terms of the normal equations and the weights at that step."""

    R: Array
    t: Array
    step: Step
    sums: FrameSums
    weighting: Weighting


STEP = named_tuple(Step, "f2! f1! f1! f2! f1!")
ESTIMATE = named_tuple(Estimate, "f2! f1! step sums weighting", step=STEP, sums=FRAME_SUMS, weighting=WEIGHTING)


@inlined
def joint_of(step: Step, of_patches: Array, by_pose: Array) -> Joint:
    """What a step tells of the pose, the patches' pose error D and the numbers.

    of_patches (6, 6): covariance of D if the rest was known; by_pose (6, 7 + r): how D falls with the pose, its value
    where that and the numbers are 0, and how it falls with the numbers.
    """
    x, numbers, pose = step.to_fit, step.to_numbers, inverse6(step.told)
    value, C = np.empty(12 + len(numbers)), np.empty((12, 12))
    for k in range(len(numbers)):
        value[12 + k] = numbers[k]
    for i in range(6):
        value[i], value[6 + i] = x[i], by_pose[i, 6]
        for k in range(len(numbers)):
            value[6 + i] -= by_pose[i, 7 + k] * numbers[k]
        for j in range(6):
            value[6 + i] -= by_pose[i, j] * x[j]
            C[i, j], C[6 + i, j] = pose[i, j], 0.0
            for k in range(6):
                C[6 + i, j] -= by_pose[i, k] * pose[k, j]
            C[j, 6 + i] = C[6 + i, j]
    for i in range(6):
        for j in range(6):
            C[6 + i, 6 + j] = of_patches[i, j]
            for k in range(6):
                C[6 + i, 6 + j] -= C[6 + i, k] * by_pose[j, k]
    return Joint(value, C)


@compiled(
    "sums biases prior view step f1! estimator",
    inner=True,
    sums=FRAME_SUMS,
    biases=LOCAL_BIASES,
    prior=POSE_PRIOR,
    view=VIEW,
    step=STEP,
    estimator=ESTIMATOR,
)
def solve_step(
    sums: FrameSums,
    biases: LocalBiases,
    prior: PosePrior,
    view: View,
    step: Step,
    edge_weight: Array,
    config: EstimatorConfig,
) -> bool:
    """Solve the normal equations of pose and biases, the biases marginalized, into `step`; False where singular.

    The edges are weighed by what is left of them, into edge_weight (g,), unless that is (0,).

    (H, h) are those of the pose, of the patches' pose error and of the numbers, in this order.
    """
    P, q, numbers = sums.patch_information, sums.patch_vector, len(prior.known.mean)
    n = 12 + numbers
    H, h = np.zeros((n, n)), np.zeros(n)
    add_edges(sums, biases, prior, se3_log_left(view.R, view.t, prior.R, prior.t), H, h)
    for i in range(6):
        h[i], h[6 + i] = h[i] + q[i], h[6 + i] - q[i]
        for j in range(6):
            H[i, j], H[6 + i, 6 + j], H[6 + i, j] = H[i, j] + P[i, j], H[6 + i, 6 + j] + P[i, j], -P[i, j]
    of_kinds, of_edge = room_for_kinds(biases, n), np.empty(n)
    marginalize_offsets(sums, biases, of_kinds, of_edge, H, h)
    A, b, row, held = step.information, np.empty(6), np.empty(6), np.empty((6, 6))
    M, N = np.empty((6, 6)), np.empty((6, 7 + numbers))
    part = config.patches_prior_part  # a small part of the other information regularizes the pose of the patches alone
    for i in range(6):
        b[i], N[i, 6] = h[i], h[6 + i]
        row[i] = q[i] + part * b[i]
        for j in range(6):
            A[i, j] = H[max(i, j), min(i, j)]
            M[i, j], N[i, j] = H[6 + max(i, j), 6 + min(i, j)], H[6 + i, j]
            held[i, j] = P[i, j] + part * A[i, j]
        for k in range(numbers):
            N[i, 7 + k] = H[12 + k, 6 + i]
    if not solve6(held, row, step.to_patches):
        return False
    of_patches = inverse6(M) if edge_weight.size else M
    eliminate(M, N)
    F, f = np.zeros((6 + numbers, 6 + numbers)), np.empty(6 + numbers)  # of pose and numbers
    for i in range(6 + numbers):
        at = i if i < 6 else 6 + i
        f[i] = h[at]
        for j in range(i + 1):
            F[i, j] = H[at, j if j < 6 else 6 + j]
        for k in range(6):
            cross = H[6 + k, i] if i < 6 else H[at, 6 + k]
            f[i] -= cross * N[k, 6]
            for j in range(i + 1):
                F[i, j] -= cross * N[k, j if j < 6 else 1 + j]
    for i in range(6):
        for j in range(6):
            step.told[i, j] = F[max(i, j), min(i, j)]
    known = prior.known
    root = with_prior(F, f, known)
    for k in range(6 + numbers - 1, 5, -1):
        variance = 1.0 / F[k, k]
        marginalize(F[:k, :k], f[:k], F[k, :k], f[k] * variance, variance)
    for i in range(6):
        b[i] = f[i]
        for j in range(6):
            A[i, j] = F[max(i, j), min(i, j)]
    if not solve6(A, b, step.to_fit):
        return False
    for k in range(numbers):
        step.to_numbers[k] = known.mean[k]
    for k in range(numbers):  # by the pose, and by the numbers before it
        for i in range(6 + k):
            f[6 + k] -= F[6 + k, i] * (step.to_fit[i] if i < 6 else f[i])
        f[6 + k] /= F[6 + k, 6 + k]
        for i in range(k, numbers):
            step.to_numbers[i] += root[i, k] * f[6 + k]
    if edge_weight.size:
        weigh_edges(sums, biases, of_kinds, joint_of(step, of_patches, N), of_edge, edge_weight)
    return True


@compiled(
    "measured matches biases prior view f1 estimator",
    inner=True,
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
    by their inverse variances. It stops before a step with singular equations. Before the last iteration, edges that
    are located between the pixels are weighed each by all else.
    """
    n, m, edges = len(measured.weight), len(matches.places), len(measured.points.first) - 1
    iterations, distances = len(widths_px), measured.candidates.distance.shape[1]
    R, t, local = view.R.copy(), view.t.copy(), linearize(biases, view.R, view.t)
    weighting, located = Weighting(np.zeros(n), np.zeros(n), np.zeros(m), np.ones(edges)), distances == 1
    numbers = len(prior.known.mean)
    row = np.empty(6 + numbers)
    step = Step(np.zeros((6, 6)), np.zeros(6), np.zeros(6), np.zeros((6, 6)), np.zeros(numbers))
    sums = FrameSums(
        *(np.zeros(edges), np.zeros((edges, 6 + numbers)), np.zeros(edges)),
        *(np.zeros((6 + numbers, 6 + numbers)), np.zeros(6 + numbers), np.zeros((6, 6)), np.zeros(6)),
    )
    for iteration, width_px in enumerate(widths_px):
        here = placed(view, R, t)
        now = Iterate(here, prior.known, width_px, row)
        add_points(measured, local, now, weighting, sums)
        # Once edges have told the pose, a patch that does not move with them is none of the structure's.
        told = np.count_nonzero(weighting.weight) >= UNKNOWNS and width_px == widths_px[-1]
        most_sigmas = EFFICIENT if told else np.inf
        add_patches(matches, now, most_sigmas, weighting, sums)
        weighed = weighting.edge_weight if located and iteration == iterations - 2 else weighting.edge_weight[:0]
        if not solve_step(sums, local, prior, here, step, weighed, config):
            break
        moved = se3_exp_left(R, t, step.to_fit)
        R, t = moved.R, moved.t
    return Estimate(R, t, step, sums, weighting)
