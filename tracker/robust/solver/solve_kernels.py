"""Compiled pose update: Gauss-Newton over the sums of control points and patches, the biases marginalized.

Poses are cam_from_world; twists are in the camera frame, translation first, in m and rad.
"""

import math
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
from uavbench.tracker.robust.solver.response_state import KNOWN_RESPONSE, KnownResponse
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
    """Predicted pose R (3, 3), t (3,) in m, its information (6, 6) in m^-2 and rad^-2, and the response as known."""

    information: Array
    R: Array
    t: Array
    response: KnownResponse


class Step(NamedTuple):
    """Solution of the normal equations: information (6, 6) of the pose, and the twists (6,) to the pose of the patches
    alone and to that of all measurements.

    told (6, 6): information of the pose if the response was known; to_response (r,): from that by which edges were
    located to the most likely one.
    """

    information: Array
    to_patches: Array
    to_fit: Array
    told: Array
    to_response: Array


class ResponseSeen(NamedTuple):
    """What a frame says of the response: information (r, r) and vector (r,), relative to that which locates edges."""

    information: Array
    vector: Array


class Estimate(NamedTuple):
    """A pose R (3, 3), t (3,), the last step, and the terms of the normal equations and the weights at that step."""

    R: Array
    t: Array
    step: Step
    sums: FrameSums
    weighting: Weighting


POSE_PRIOR = named_tuple(PosePrior, "f2! f2! f1! response", response=KNOWN_RESPONSE)
STEP = named_tuple(Step, "f2! f1! f1! f2! f1!")


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

    (H, h) are those of the pose, of the patches' pose error and of the response, in this order.
    """
    P, q, numbers = sums.patch_information, sums.patch_vector, len(prior.response.mean)
    n = 12 + numbers
    H, h = np.zeros((n, n)), np.zeros(n)
    add_edges(sums, biases, prior, view, H, h)
    for i in range(6):
        h[i], h[6 + i] = h[i] + q[i], h[6 + i] - q[i]
        for j in range(6):
            H[i, j], H[6 + i, 6 + j], H[6 + i, j] = H[i, j] + P[i, j], H[6 + i, 6 + j] + P[i, j], -P[i, j]
    marginalize_offsets(sums, biases, H, h)
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
    eliminate(M, N)
    F, f = np.zeros((6 + numbers, 6 + numbers)), np.empty(6 + numbers)  # of pose and response
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
    known = prior.response
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
        step.to_response[k] = known.mean[k]
    for k in range(numbers):  # by the pose, and by the numbers before it
        for i in range(6 + k):
            f[6 + k] -= F[6 + k, i] * (step.to_fit[i] if i < 6 else f[i])
        f[6 + k] /= F[6 + k, 6 + k]
        for i in range(k, numbers):
            step.to_response[i] += root[i, k] * f[6 + k]
    return True


@inlined
def add_edges(sums: FrameSums, biases: LocalBiases, prior: PosePrior, view: View, H: Array, h: Array) -> None:
    """Add what edges and priors say of the pose, the patches' pose error and the response to H (12 + r, 12 + r), its
    lower half, and h (12 + r,), in place, without the offsets.
    """
    E, e, n = sums.edge_information, sums.edge_vector, len(h)
    to_prior = se3_log_left(view.R, view.t, prior.R, prior.t)
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


@inlined
def with_prior(F: Array, f: Array, known: KnownResponse) -> Array:
    """Change the response in F (6 + r, 6 + r), its lower half, and f (6 + r,) to u, with its prior, in place.

    The response is the mean and S u, u of unit variance and S S^T the covariance, so that one that is known for certain
    has no infinite information. Returns S (r, r).
    """
    r, S = len(known.mean), lower_root(known.covariance)
    for i in range(6):
        for k in range(r):
            f[i] -= F[6 + k, i] * known.mean[k]
    for k in range(r):
        for m in range(r):
            f[6 + k] -= F[6 + max(k, m), 6 + min(k, m)] * known.mean[m]
    half = np.zeros((r, r))
    for i in range(r):
        for k in range(r):
            for m in range(k, r):
                half[i, k] += F[6 + max(i, m), 6 + min(i, m)] * S[m, k]
    for k in range(r):  # S is lower triangular: row k is needed by those before it alone
        for i in range(6):
            F[6 + k, i] *= S[k, k]
            for m in range(k + 1, r):
                F[6 + k, i] += S[m, k] * F[6 + m, i]
        f[6 + k] *= S[k, k]
        for m in range(k + 1, r):
            f[6 + k] += S[m, k] * f[6 + m]
        for j in range(k + 1):
            F[6 + k, 6 + j] = 1.0 if j == k else 0.0
            for m in range(k, r):
                F[6 + k, 6 + j] += S[m, k] * half[m, j]
    return S


@inlined
def lower_root(covariance: Array) -> Array:
    """Lower triangular S with S S^T = covariance (r, r), which may be singular."""
    S = np.zeros(covariance.shape)
    for i in range(len(S)):
        for j in range(i + 1):
            left = covariance[i, j]
            for k in range(j):
                left -= S[i, k] * S[j, k]
            if i == j:
                S[i, i] = math.sqrt(max(left, 0.0))
            elif S[j, j] > 0.0:
                S[i, j] = left / S[j, j]
    return S


@compiled(
    "sums biases prior view f0",
    sums=FRAME_SUMS,
    biases=BIASES_IN_VIEW,
    prior=POSE_PRIOR,
    view=VIEW,
)
def response_seen(
    sums: FrameSums, biases: BiasesInView, prior: PosePrior, view: View, shared_px2: float
) -> ResponseSeen:
    """What the edges of a frame say of the response, with pose and offsets marginalized.

    shared_px2: variance of an offset towards their darker sides that all edges share. biases: from before all frames,
    with that offset as one number more, so that offsets that frames have in common do not count as known.
    """
    local, numbers = linearize(biases, view.R, view.t), len(sums.edge_vector) - 6
    n, last = 13 + numbers, 12 + numbers
    H, h = np.zeros((n, n)), np.zeros(n)
    both = with_shared_offset(sums)
    add_edges(both, local, prior, view, H, h)
    marginalize_offsets(both, local, H, h)
    variance = 1.0 / (H[last, last] + 1.0 / shared_px2)
    marginalize(H[:last, :last], h[:last], H[last, :last], h[last] * variance, variance)
    M, N = np.empty((6, 6)), np.empty((6, 1 + numbers))
    information, vector = np.empty((numbers, numbers)), np.empty(numbers)
    for i in range(6):
        N[i, 0] = h[i]
        for j in range(6):
            M[i, j] = H[max(i, j), min(i, j)]
        for k in range(numbers):
            N[i, 1 + k] = H[12 + k, i]
    eliminate(M, N)
    for k in range(numbers):
        vector[k] = h[12 + k]
        for i in range(6):
            vector[k] -= H[12 + k, i] * N[i, 0]
        for m in range(numbers):
            information[k, m] = H[12 + max(k, m), 12 + min(k, m)]
            for i in range(6):
                information[k, m] -= H[12 + k, i] * N[i, 1 + m]
    return ResponseSeen(information, vector)


@inlined
def with_shared_offset(sums: FrameSums) -> FrameSums:
    """The sums with one number more, an offset of all edges to the side to which the first number moves them."""
    n, edges = len(sums.edge_vector), len(sums.offset_weight)
    J, A, v = np.empty((edges, n + 1)), np.zeros((n + 1, n + 1)), np.zeros(n + 1)
    A[:n, :n], v[:n] = sums.edge_information, sums.edge_vector
    for g in range(edges):
        side = np.sign(sums.offset_jacobian[g, 6])
        J[g, n] = side * sums.offset_weight[g]
        v[n] += side * sums.offset_residual[g]
        A[n, n] += side * J[g, n]
        for i in range(n):
            J[g, i] = sums.offset_jacobian[g, i]
            A[n, i] += side * J[g, i]
    for i in range(n):
        A[i, n] = A[n, i]
    return FrameSums(
        *(sums.offset_weight, J, sums.offset_residual, A, v),
        *(sums.patch_information, sums.patch_vector),
    )


@inlined
def marginalize_offsets(sums: FrameSums, biases: LocalBiases, H: Array, h: Array) -> None:
    """Marginalize the offset of each edge, then what the edges of each kind share, from H (12 + r, 12 + r), its lower
    half, and h (12 + r,), in place.
    """
    n = len(h)
    S, s, d = sums.offset_weight, sums.offset_jacobian, sums.offset_residual
    cross, kinds, ties, of_kinds = biases.cross, biases.kinds, biases.ties, biases.of_kinds
    row, count = np.empty(n), len(of_kinds.information)
    rows, shared, vector = np.zeros((count, n)), of_kinds.information.copy(), of_kinds.vector.copy()
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
    numbers = len(prior.response.mean)
    step = Step(np.zeros((6, 6)), np.zeros(6), np.zeros(6), np.zeros((6, 6)), np.zeros(numbers))
    sums = FrameSums(
        *(np.zeros(edges), np.zeros((edges, 6 + numbers)), np.zeros(edges)),
        *(np.zeros((6 + numbers, 6 + numbers)), np.zeros(6 + numbers), np.zeros((6, 6)), np.zeros(6)),
    )
    for width_px in widths_px:
        now = View(R, t, view.lens, view.size_px, view.bounds_px, view.near)
        add_points(measured, local, prior.response, now, width_px, weighting, sums)
        # Once edges have told the pose, a patch that does not move with them is none of the structure's.
        told = np.count_nonzero(weighting.weight) >= UNKNOWNS and width_px == widths_px[-1]
        most_sigmas = EFFICIENT if told else np.inf
        add_patches(matches, now, width_px, most_sigmas, weighting, sums)
        if not solve_step(sums, local, prior, now, step, config):
            break
        moved = se3_exp_left(R, t, step.to_fit)
        R, t = moved.R, moved.t
    return Estimate(R, t, step, sums, weighting)
