"""What a fit found: its pose, its support, and how likely a random pose finds as much."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.tracker.geometry_kernels import inverse6
from uavbench.tracker.protocol import Image
from uavbench.tracker.robust.edges.measurements import EDGE_MEASUREMENTS, EdgeMeasurements
from uavbench.tracker.robust.edges.steps.optics_kernels import OPTICS, Optics
from uavbench.tracker.robust.edges.weight_kernels import found_parts, support
from uavbench.tracker.robust.fit.false_alarms import Chance, Found, chance, evidence, lines_of_edges, ratios_of_edges
from uavbench.tracker.robust.fit.kernel_config import KERNEL_CONFIG, WIDTHS, KernelConfig, Widths
from uavbench.tracker.robust.fit.pose_fit import SEARCHED, Fit, FitResiduals, Searched
from uavbench.tracker.robust.fit.stage_kernels import EDGE_MODEL, LOCATED, EdgeModel, Located, locate
from uavbench.tracker.robust.solver.bias_state import BIASES_IN_VIEW, BiasesInView
from uavbench.tracker.robust.solver.sum_kernels import WEIGHTING, Weighting
from uavbench.tracker.robust.view import VIEW, View, placed
from uavbench.trajectories.kernels.compiled import compiled, unchecked
from uavbench.trajectories.pose import Array, Pose

Indices = NDArray[np.int64]


class Judged(NamedTuple):
    """Covariance (6, 6) of a fit and its depth, NaN without control points; its support, that of its edges alone,
    numbers of candidates and inliers, the weight of all that a search found, and what chance finds.
    """

    covariance: Array
    range_m: float
    support: float
    edge_support: float
    candidates: int
    inliers: int
    found: float
    chance: Chance


class Concluded(NamedTuple):
    """The estimate from the matches of a search, and what is found there."""

    at: Located
    judged: Judged


@compiled("searched located f2 values", searched=SEARCHED, located=LOCATED, values=KERNEL_CONFIG)
def judge(searched: Searched, at: Located, appearance: Array, values: KernelConfig) -> Judged:
    """What the matches of a search support, and the last fit finds; appearance: of the edges."""
    problem, aligned, estimate = searched.problem, searched.aligned, searched.found.estimate
    measured, matched, last = searched.found.measured, estimate.weighting, at.estimate.weighting
    correlation, candidates = aligned.matches.correlation, numbers_of_candidates(measured)
    weak_step, inliers, found = values.appearance.weak_step_grey, 0, 0.0
    share = support(measured, problem.counts, matched.weight, matched.patch_weight, correlation, appearance, weak_step)
    for p in range(len(last.weight)):
        inliers += int(last.weight[p] != 0.0)
    for p in range(len(last.patch_weight)):
        inliers += int(last.patch_weight[p] != 0.0)
    for p in range(len(matched.weight)):
        found += matched.weight[p]
    for p in range(len(matched.patch_weight)):
        found += 1.0 if matched.patch_weight[p] != 0.0 else 0.0
    view = placed(aligned.at, estimate.R, estimate.t)
    by_chance = chance_of_matches(measured, candidates, matched, correlation, view, values.widths)
    return Judged(
        inverse6(at.estimate.step.information),
        middle_depth(problem.points.points, at.estimate.R, at.estimate.t),
        share.whole,
        share.edges,
        int(candidates.sum()),
        inliers,
        found,
        by_chance,
    )


@compiled("measured", inner=True, measured=EDGE_MEASUREMENTS)
def numbers_of_candidates(measured: EdgeMeasurements) -> Indices:
    """Number (n,) of the candidates on each search line."""
    distance = measured.candidates.distance
    numbers = np.zeros(len(distance), np.int64)
    for p in range(distance.shape[0]):
        for k in range(distance.shape[1]):
            numbers[p] += int(distance[p, k] < np.inf)
    return numbers


@compiled("f2 f2 f1", inner=True, allocates=False)
def middle_depth(points: Array, R: Array, t: Array) -> float:
    """Depth of the middle one of points (n, 3) at cam_from_world (R, t); NaN without any."""
    if len(points) == 0:
        return math.nan
    middle = points[len(points) // 2]
    return float(R[2, 0] * middle[0] + R[2, 1] * middle[1] + R[2, 2] * middle[2] + t[2])


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
    return chance(found, lines_of_edges(view.R, view.t, points.points, points.first, apart_rad(view, widths)))


@compiled("view widths", inner=True, allocates=False, view=VIEW, widths=WIDTHS)
def apart_rad(view: View, widths: Widths) -> float:
    """Angle between two edges, each within the cutoff of one line of the image."""
    return float(2.0 * widths.last_px / view.lens[0])


@compiled("searched i1! widths", searched=SEARCHED, widths=WIDTHS)
def ratios_of_points(searched: Searched, chosen: Indices, widths: Widths) -> Array:
    """Logarithm (k,) of the likelihood ratio of chosen (m,) control points, ascending, by the part that is hidden."""
    measured, estimate = searched.found.measured, searched.found.estimate
    points, first = measured.points, np.empty(len(chosen) + 1, np.int64)
    variance_px2, edges, before = np.empty(len(chosen)), 0, -1
    for i in range(len(chosen)):
        variance_px2[i] = max(measured.variance_px2[chosen[i]], widths.trusted_px**2)
        edge = np.searchsorted(points.first, chosen[i], side="right")
        if edge != before:
            first[edges], edges, before = i, edges + 1, edge
    first[edges] = len(chosen)
    found = Found(
        points.rows[chosen],
        first[: edges + 1],
        numbers_of_candidates(measured)[chosen],
        estimate.weighting.residual[chosen],
        variance_px2,
        np.zeros(0),
        np.zeros(0),
        widths.fine_half_px,
        widths.last_px,
    )
    view = placed(searched.aligned.at, estimate.R, estimate.t)
    lines = lines_of_edges(view.R, view.t, points.points[chosen], found.first, apart_rad(view, widths))
    return ratios_of_edges(found, lines)


@compiled(
    "u3 searched biases optics model values",
    searched=SEARCHED,
    biases=BIASES_IN_VIEW,
    optics=OPTICS,
    model=EDGE_MODEL,
    values=KERNEL_CONFIG,
)
def conclude(
    image: Image, searched: Searched, biases: BiasesInView, optics: Optics, model: EdgeModel, values: KernelConfig
) -> Concluded:
    """The matches of a search, its edges located in an image; the edges in view of `biases` are not used."""
    at = locate(image, searched, biases, optics, model, values)
    return Concluded(at, judge(searched, at, model.appearance, values))


def fit_of(searched: Searched, at: Located, judged: Judged) -> Fit:
    """The fit to the matches of a search, at an estimate from them, with the support that they have."""
    problem, estimate = searched.problem, at.estimate
    return Fit(
        Pose.owning(estimate.R, estimate.t),
        judged.covariance,
        judged.support,
        len(problem.points.points),
        judged.candidates,
        judged.inliers,
        judged.range_m,
        judged.edge_support,
        judged.found,
        judged.chance,
        FitResiduals(
            problem.points,
            searched.patches,
            searched.aligned.matches.correlation,
            estimate.weighting,
            searched.found.edges,
            estimate.sums,
            estimate.step,
            problem.prior.information,
            at.steps,
            at.by_numbers,
        ),
        searched,
    )


def evidence_of_some(searched: Searched, some: NDArray[np.bool_], values: KernelConfig) -> float:
    """Powers of ten by which what is found of some (n,) control points, beside the others, is likelier than chance."""
    ratios = [unchecked(ratios_of_points)(searched, np.flatnonzero(each), values.widths) for each in (some, ~some)]
    return evidence(*ratios)


def parts_found(searched: Searched, appearance: Array, values: KernelConfig) -> Array:
    """Part (n,) of each control point that a search found; appearance: of the edges."""
    found = searched.found
    return found_parts(found.measured, found.estimate.weighting.weight, appearance, values.appearance.weak_step_grey)
