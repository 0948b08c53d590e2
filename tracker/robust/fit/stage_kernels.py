"""Compiled stages of a fit. Each calls several kernels: a call from Python takes as long as many of them."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.tracker.robust.edges.columns import BINS, BLOWN, ROUNDED
from uavbench.tracker.robust.edges.edge_graph import EDGE_MAP, EdgeMap
from uavbench.tracker.robust.edges.measurements import (
    EDGE_MEASUREMENTS,
    Candidates,
    ControlPoints,
    EdgeMeasurements,
    SearchLines,
)
from uavbench.tracker.robust.edges.profile_kernels import Image, search
from uavbench.tracker.robust.edges.rounding_kernels import ROUNDING, Rounding, derivatives, motion_by_radius, move
from uavbench.tracker.robust.edges.sampling_kernels import sample_edges, search_lines
from uavbench.tracker.robust.edges.steps.optics_kernels import OPTICS, Optics, blown_side
from uavbench.tracker.robust.edges.subpixel_kernels import FittedPoints, refine_subpixel
from uavbench.tracker.robust.edges.weight_kernels import (
    contrast_weights,
    offset_variances,
    point_variances,
    weights_in_view,
)
from uavbench.tracker.robust.fit.kernel_config import KERNEL_CONFIG, KernelConfig
from uavbench.tracker.robust.fit.pose_fit import (
    ALIGNED,
    MIN_POINTS,
    PROBLEM,
    SEARCHED,
    Aligned,
    Problem,
    Searched,
    Solution,
)
from uavbench.tracker.robust.patches.matches import PATCH_MATCHES, PatchMatches
from uavbench.tracker.robust.patches.patch_kernels import PATCHES_IN_VIEW, PatchesInView, align
from uavbench.tracker.robust.solver.bias_kernels import prior_offsets
from uavbench.tracker.robust.solver.bias_state import BIASES_IN_VIEW, BiasesInView, EdgeOffsets
from uavbench.tracker.robust.solver.equation_kernels import POSE_PRIOR, PosePrior
from uavbench.tracker.robust.solver.solve_kernels import ESTIMATE, Estimate, refine
from uavbench.tracker.robust.view import VIEW, View, placed
from uavbench.trajectories.kernels.argument_types import named_tuple
from uavbench.trajectories.kernels.compiled import compiled, inlined
from uavbench.trajectories.pose import Array

Indices = NDArray[np.int64]


class EdgeModel(NamedTuple):
    """The edges of a structure, ends and inward as of `EdgeMap`, with their appearance."""

    ends: Array
    inward: Array
    appearance: Array


class Shared(NamedTuple):
    """What moves the edges of an image together: rounding, and the light (1 + r, 256) of the codes of its channels."""

    rounding: Rounding
    light: Array
    channels: int


SHARED = named_tuple(Shared, "rounding f2! i0", rounding=ROUNDING)


class EdgesInView(NamedTuple):
    """Control points in view with their search lines, weight (n,) in the pose and counts (n,) in the support.

    edges (g,): rows of the edges in view among the offsets. by_numbers (n, r): derivatives of the distances for the
    numbers that all edges share, px.
    """

    points: ControlPoints
    lines: SearchLines
    weight: Array
    counts: Array
    edges: Indices
    by_numbers: Array


class Solved(NamedTuple):
    """An estimate, and the offsets of the edges in view."""

    estimate: Estimate
    edges: EdgeOffsets


class Located(NamedTuple):
    """An estimate, by edges located between the pixels where steps (n,) of light locate a control point, 0 for none.

    by_numbers (n, r): derivatives of the distances for the numbers that all edges share.
    """

    estimate: Estimate
    steps: Indices
    by_numbers: Array


class Fitted(NamedTuple):
    """What a fit is made from."""

    measured: EdgeMeasurements
    matches: PatchMatches
    biases: BiasesInView
    prior: PosePrior


EDGE_MODEL = named_tuple(EdgeModel, "f3! f3! f2!")
FITTED = named_tuple(
    Fitted,
    "measured matches biases prior",
    measured=EDGE_MEASUREMENTS,
    matches=PATCH_MATCHES,
    biases=BIASES_IN_VIEW,
    prior=POSE_PRIOR,
)
LOCATED = named_tuple(Located, "estimate i1! f2!", estimate=ESTIMATE)


@compiled("edges view f2 i0 shared values", edges=EDGE_MAP, view=VIEW, shared=SHARED, values=KERNEL_CONFIG)
def edges_in_view(
    edges: EdgeMap, view: View, appearance: Array, most: int, shared: Shared, values: KernelConfig
) -> EdgesInView:
    """Control points on the visible edges, about `most` where there are many, rounded off, with their weights."""
    points, rounding = sample_edges(edges, view, values.spacing_px, most), shared.rounding
    motion = motion_by_radius(points, edges, view)
    move(points, motion, rounding.radius_m)
    lines = search_lines(points, edges.ends, edges.inward, view)
    by_numbers = np.zeros((len(motion), rounding.numbers))
    by_numbers[:, ROUNDED] = derivatives(lines, motion, rounding.unit_m, view)
    for p in range(len(motion)):
        by_numbers[p, BLOWN] = -blown_side(appearance[points.rows[p]], shared.channels, shared.light)
    separate_px, weak_step = values.widths.separate_px, values.appearance.weak_step_grey
    weights = weights_in_view(lines, points, appearance, separate_px, weak_step, values.weights)
    rows = np.empty(len(points.first) - 1, np.int64)
    for g in range(len(rows)):
        rows[g] = points.rows[points.first[g]] // BINS
    return EdgesInView(points, lines, weights.weight, weights.counts, rows, by_numbers)


class ByPatches(NamedTuple):
    """Matches of patches with the view at the pose that fits them; as it was where too few agree on one."""

    aligned: Aligned
    told: bool


@inlined
def nothing_measured() -> EdgeMeasurements:
    """Measurements of no edges."""
    none, rows = np.zeros(0), np.zeros(0, np.int64)
    points = ControlPoints(np.zeros((0, 3)), np.zeros((0, 3), np.int64), rows, np.zeros(1, np.int64))
    lines, candidates = SearchLines(np.zeros((0, 4)), np.zeros((0, 6)), rows), np.zeros((0, 1))
    return EdgeMeasurements(points, lines, Candidates(candidates, candidates), none, none, np.zeros((0, 0)))


@compiled(
    "problem patches biases values",
    problem=PROBLEM,
    patches=PATCHES_IN_VIEW,
    biases=BIASES_IN_VIEW,
    values=KERNEL_CONFIG,
)
def align_by_patches(problem: Problem, patches: PatchesInView, biases: BiasesInView, values: KernelConfig) -> ByPatches:
    """Align the patches of a view, and the view by them; `biases` have no edges in view."""
    view, found = problem.at, 0
    matches = align(problem.image, patches, view)
    for correlation in matches.correlation:
        found += int(correlation > 0.0)
    if found < MIN_POINTS:
        return ByPatches(Aligned(view, matches), False)
    coarse, nothing = values.widths.coarse, nothing_measured()
    estimate, agreeing = refine(nothing, matches, biases, problem.prior, view, coarse, values.estimator), 0
    for weight in estimate.weighting.patch_weight:
        agreeing += int(weight > 0.0)
    if agreeing < MIN_POINTS:
        return ByPatches(Aligned(view, matches), False)
    return ByPatches(Aligned(placed(view, estimate.R, estimate.t), matches), True)


@compiled(
    "fitted i1! f1 view f2 values",
    fitted=FITTED,
    view=VIEW,
    values=KERNEL_CONFIG,
)
def solve_anew(
    given: Fitted, edges: Indices, widths_px: Array, view: View, appearance: Array, values: KernelConfig
) -> Solved:
    """M-estimate from a view, with the prior offsets of the edges in view, rows (g,), by their measurements.

    The edges in view that are given are not used.
    """
    looks = 1.0 / values.appearance.learning_rate  # in which a running mean forgets its first value
    variance_px2 = offset_variances(given.measured, appearance, looks, values.weights)
    offsets = prior_offsets(given.biases.state, edges, variance_px2, values.weights.shared_part)
    biases = BiasesInView(given.biases.state, given.biases.known, offsets)
    estimate = refine(given.measured, given.matches, biases, given.prior, view, widths_px, values.estimator)
    return Solved(estimate, offsets)


@compiled(
    "problem aligned biases model values",
    problem=PROBLEM,
    aligned=ALIGNED,
    biases=BIASES_IN_VIEW,
    model=EDGE_MODEL,
    values=KERNEL_CONFIG,
)
def update(
    problem: Problem, aligned: Aligned, biases: BiasesInView, model: EdgeModel, values: KernelConfig
) -> Solution:
    """Estimate by a short search about the control points at a view; the edges in view of `biases` are not used."""
    points, looks, view = problem.points, model.appearance, aligned.at
    lines, half_px = search_lines(points, model.ends, model.inward, view), np.empty(len(problem.weight))
    half_px[:] = values.widths.fine_half_px
    weak_step = values.appearance.weak_step_grey
    found = search(problem.image, lines, points.rows, looks, half_px, weak_step, values.search)
    variance_px2 = point_variances(points, found, looks, weak_step, values.weights)
    measured = EdgeMeasurements(points, lines, found, problem.weight, variance_px2, problem.by_numbers)
    given = Fitted(measured, aligned.matches, biases, problem.prior)
    solved = solve_anew(given, problem.edges, values.widths.fine, view, looks, values)
    return Solution(solved.estimate, measured, solved.edges)


@compiled(
    "u3 searched biases optics model values",
    inner=True,
    searched=SEARCHED,
    biases=BIASES_IN_VIEW,
    optics=OPTICS,
    model=EDGE_MODEL,
    values=KERNEL_CONFIG,
)
def locate(
    image: Image, searched: Searched, biases: BiasesInView, optics: Optics, model: EdgeModel, values: KernelConfig
) -> Located:
    """Estimate from intensity steps fitted to the pixels around the control points, from that of a search on.

    The edges in view that are given are not used.
    """
    found, matches, prior = searched.found, searched.aligned.matches, searched.problem.prior
    before, weighting = found.measured, found.estimate.weighting
    view = placed(searched.aligned.at, found.estimate.R, found.estimate.t)
    points, lines = before.points, search_lines(before.points, model.ends, model.inward, view)
    points_before = FittedPoints(weighting.residual, weighting.weight, before.variance_px2, view)
    steps = refine_subpixel(image, lines, points, model.appearance, points_before, optics, values.weights)
    weak_step = values.appearance.weak_step_grey
    weight = contrast_weights(points.rows, model.appearance, weak_step, values.weights)
    by_numbers, of_light = before.by_numbers.copy(), steps.by_response.shape[1]
    for p in range(len(weight)):
        if steps.steps[p] == 0:
            weight[p] = before.weight[p]
        for k in range(of_light):
            by_numbers[p, k] = steps.by_response[p, k]
    candidates = Candidates(steps.distance, before.candidates.contrast)
    moved = ControlPoints(steps.points, points.keys, points.rows, points.first)
    lines = SearchLines(steps.lines, lines.jacobian, lines.side)
    measured = EdgeMeasurements(moved, lines, candidates, weight, steps.variance_px2, by_numbers)
    last = values.widths.last
    seen = BiasesInView(biases.state, biases.known, found.edges)
    estimate = refine(measured, matches, seen, prior, view, last, values.estimator)
    return Located(estimate, steps.steps, by_numbers)
