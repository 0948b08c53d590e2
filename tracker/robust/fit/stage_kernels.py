"""Compiled stages of a fit. Each calls several kernels: a call from Python takes as long as many of them."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.tracker.robust.edges.columns import BINS, BLOWN, ROUNDED
from uavbench.tracker.robust.edges.edge_graph import EDGE_MAP, EdgeMap
from uavbench.tracker.robust.edges.measurements import (
    CONTROL_POINTS,
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
    support,
    weights_in_view,
)
from uavbench.tracker.robust.fit.false_alarms import Chance, Found, chance, lines_of_edges
from uavbench.tracker.robust.fit.kernel_config import KERNEL_CONFIG, WIDTHS, KernelConfig, Widths
from uavbench.tracker.robust.patches.matches import PATCH_MATCHES, PatchMatches
from uavbench.tracker.robust.solver.bias_kernels import prior_offsets
from uavbench.tracker.robust.solver.bias_state import BIASES_IN_VIEW, BiasesInView, EdgeOffsets
from uavbench.tracker.robust.solver.equation_kernels import POSE_PRIOR, PosePrior
from uavbench.tracker.robust.solver.solve_kernels import Estimate, refine
from uavbench.tracker.robust.solver.sum_kernels import WEIGHTING, Weighting
from uavbench.tracker.robust.view import VIEW, View
from uavbench.trajectories.kernels.argument_types import named_tuple
from uavbench.trajectories.kernels.compiled import compiled
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
    """What a fit was made from, and the weighting that it ended with."""

    measured: EdgeMeasurements
    matches: PatchMatches
    biases: BiasesInView
    prior: PosePrior
    weighting: Weighting


class Weightings(NamedTuple):
    """Weightings of a fit to the matches of a search, and of the last fit."""

    matched: Weighting
    last: Weighting


class Judged(NamedTuple):
    """Support of a fit, that of its edges alone, numbers of candidates and inliers, the weight of all that a search
    found, and what chance finds.
    """

    support: float
    edge_support: float
    candidates: int
    inliers: int
    found: float
    chance: Chance


EDGE_MODEL = named_tuple(EdgeModel, "f3! f3! f2!")
FITTED = named_tuple(
    Fitted,
    "measured matches biases prior weighting",
    measured=EDGE_MEASUREMENTS,
    matches=PATCH_MATCHES,
    biases=BIASES_IN_VIEW,
    prior=POSE_PRIOR,
    weighting=WEIGHTING,
)
WEIGHTINGS = named_tuple(Weightings, "weighting weighting", weighting=WEIGHTING)


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


@compiled(
    "u3 points f1! f2! view model values", points=CONTROL_POINTS, view=VIEW, model=EDGE_MODEL, values=KERNEL_CONFIG
)
def measure_near(
    image: Image,
    points: ControlPoints,
    weight: Array,
    by_numbers: Array,
    view: View,
    model: EdgeModel,
    values: KernelConfig,
) -> EdgeMeasurements:
    """Candidates of a short search about the control points at a view, with the variances of the points."""
    lines, half_px = search_lines(points, model.ends, model.inward, view), np.empty(len(weight))
    half_px[:] = values.widths.fine_half_px
    weak_step = values.appearance.weak_step_grey
    found = search(image, lines, points.rows, model.appearance, half_px, weak_step, values.search)
    variance_px2 = point_variances(points, found, model.appearance, weak_step, values.weights)
    return EdgeMeasurements(points, lines, found, weight, variance_px2, by_numbers)


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

    The weighting and the edges in view that are given are not used.
    """
    looks = 1.0 / values.appearance.learning_rate  # in which a running mean forgets its first value
    variance_px2 = offset_variances(given.measured, appearance, looks, values.weights)
    offsets = prior_offsets(given.biases.state, edges, variance_px2, values.weights.shared_part)
    biases = BiasesInView(given.biases.state, given.biases.known, offsets)
    estimate = refine(given.measured, given.matches, biases, given.prior, view, widths_px, values.estimator)
    return Solved(estimate, offsets)


@compiled(
    "u3 fitted view optics model values",
    fitted=FITTED,
    view=VIEW,
    optics=OPTICS,
    model=EDGE_MODEL,
    values=KERNEL_CONFIG,
)
def locate(image: Image, fitted: Fitted, view: View, optics: Optics, model: EdgeModel, values: KernelConfig) -> Located:
    """Estimate from intensity steps fitted to the pixels around the control points, starting at a fit's view."""
    before, weighting = fitted.measured, fitted.weighting
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
    estimate = refine(measured, fitted.matches, fitted.biases, fitted.prior, view, last, values.estimator)
    return Located(estimate, steps.steps, by_numbers)


@compiled(
    "measured f1 weightings f1! view f2 values",
    measured=EDGE_MEASUREMENTS,
    weightings=WEIGHTINGS,
    view=VIEW,
    values=KERNEL_CONFIG,
)
def judge(
    measured: EdgeMeasurements,
    counts: Array,
    weightings: Weightings,
    correlation: Array,
    view: View,
    appearance: Array,
    values: KernelConfig,
) -> Judged:
    """What the matches of a search support, and the last fit finds.

    view: at the fit to the matches; other arguments as of `support`.
    """
    matched, last, distance = weightings.matched, weightings.last, measured.candidates.distance
    weak_step, inliers, found = values.appearance.weak_step_grey, 0, 0.0
    share = support(measured, counts, matched.weight, matched.patch_weight, correlation, appearance, weak_step)
    candidates = np.zeros(len(distance), np.int64)
    for p in range(distance.shape[0]):
        for k in range(distance.shape[1]):
            candidates[p] += int(distance[p, k] < np.inf)
    for p in range(len(last.weight)):
        inliers += int(last.weight[p] != 0.0)
    for p in range(len(last.patch_weight)):
        inliers += int(last.patch_weight[p] != 0.0)
    for p in range(len(matched.weight)):
        found += matched.weight[p]
    for p in range(len(matched.patch_weight)):
        found += 1.0 if matched.patch_weight[p] != 0.0 else 0.0
    by_chance = chance_of_matches(measured, candidates, matched, correlation, view, values.widths)
    return Judged(share.whole, share.edges, int(candidates.sum()), inliers, found, by_chance)


@compiled(
    "measured i1! weighting f1! view widths",
    inner=True,
    measured=EDGE_MEASUREMENTS,
    weighting=WEIGHTING,
    view=VIEW,
    widths=WIDTHS,
)
def chance_of_matches(
    measured: EdgeMeasurements,
    candidates: Indices,
    matched: Weighting,
    correlation: Array,
    view: View,
    widths: Widths,
) -> Chance:
    """How likely chance is to match as much as a search did; candidates (n,) on each search line.

    No point is expected nearer to its edge than the largest residual that is not doubted.
    """
    points, variance_px2 = measured.points, np.empty(len(candidates))
    for p in range(len(variance_px2)):
        variance_px2[p] = max(measured.variance_px2[p], widths.trusted_px**2)
    found = Found(
        points.rows,
        points.first,
        candidates,
        matched.residual,
        variance_px2,
        matched.patch_weight,
        correlation,
        widths.fine_half_px,
        widths.last_px,
    )
    apart_rad = 2.0 * widths.last_px / view.lens[0]  # two edges, each within the cutoff of one line
    return chance(found, lines_of_edges(view.R, view.t, points.points, points.first, apart_rad))
