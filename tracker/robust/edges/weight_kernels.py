"""Compiled weights and variances of control points, and the weighted inlier ratio."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.tracker.robust.config.edges import WeightConfig
from uavbench.tracker.robust.edges.columns import (
    BINS,
    MEAN_SQUARE,
    NEGATIVE_COLOUR,
    NORMAL_U,
    NORMAL_V,
    OUTSIDE,
    POSITIVE_COLOUR,
    TIMES_SEEN,
    U,
    V,
)
from uavbench.tracker.robust.edges.measurements import (
    CANDIDATES,
    CONTROL_POINTS,
    EDGE_MEASUREMENTS,
    SEARCH_LINES,
    Candidates,
    ControlPoints,
    EdgeMeasurements,
    SearchLines,
)
from uavbench.tracker.robust.kernel_values import kernel_type
from uavbench.trajectories.kernels.compiled import compiled
from uavbench.trajectories.pose import Array

WEIGHTS = kernel_type(WeightConfig)
LEAST_WEIGHT = 0.02
"""Weight of edges that touch; positive, since the offset of an edge without weight would be undetermined."""
PARALLEL_COSINE = 0.82
"""Cosine of 35 degrees, the angle up to which edges disturb each other: that of faces of one rounded surface."""

Indices = NDArray[np.int64]


@compiled("f2 i1 i0", inner=True, allocates=False)
def half_spacing(lines: Array, first: Indices, g: int) -> float:
    """Half the least distance in px between successive control points of an edge, 0 of a single one.

    Where something hides a part of the edge, the points to either side of it are farther apart.
    """
    least = math.inf
    for p in range(first[g], first[g + 1] - 1):
        least = min(least, math.hypot(lines[p + 1, U] - lines[p, U], lines[p + 1, V] - lines[p, V]))
    return 0.5 * least if least < math.inf else 0.0


@compiled("lines i1 f0", inner=True, lines=SEARCH_LINES)
def edge_spacing(at: SearchLines, first: Indices, separate_px: float) -> Array:
    """Distance in px (n,), at most separate_px, along each normal to the nearest other edge that is nearly parallel.

    first (g + 1,): see `ControlPoints`. An edge reaches beyond a control point by half the distance to the next one.
    """
    lines, side = at.lines, at.side
    n, groups = len(lines), len(first) - 1
    gap, reach, box = np.empty(n), np.empty(groups), np.empty((groups, 4))
    gap[:] = separate_px
    for g in range(groups):
        reach[g] = max(separate_px, half_spacing(lines, first, g) + 1.0)
        box[g] = np.array([np.inf, np.inf, -np.inf, -np.inf])
        for p in range(first[g], first[g + 1]):
            if side[p] != OUTSIDE:
                u, v = lines[p, U], lines[p, V]
                box[g, 0], box[g, 1] = min(box[g, 0], u), min(box[g, 1], v)
                box[g, 2], box[g, 3] = max(box[g, 2], u), max(box[g, 3], v)
    for g in range(groups):
        for h in range(g + 1, groups):
            far = max(reach[g], reach[h])
            if max(box[g, 0] - box[h, 2], box[h, 0] - box[g, 2]) > far + separate_px:
                continue
            if max(box[g, 1] - box[h, 3], box[h, 1] - box[g, 3]) > far + separate_px:
                continue
            for p in range(first[g], first[g + 1]):
                if side[p] == OUTSIDE:
                    continue
                u, v, nu, nv = lines[p, U], lines[p, V], lines[p, NORMAL_U], lines[p, NORMAL_V]
                for q in range(first[h], first[h + 1]):
                    du, dv = lines[q, U] - u, lines[q, V] - v
                    across = abs(du * nu + dv * nv)
                    if across > separate_px or side[q] == OUTSIDE:
                        continue
                    along = abs(dv * nu - du * nv)
                    if along > far or abs(nu * lines[q, NORMAL_U] + nv * lines[q, NORMAL_V]) < PARALLEL_COSINE:
                        continue
                    if along <= reach[h]:
                        gap[p] = min(gap[p], across)
                    if along <= reach[g]:
                        gap[q] = min(gap[q], across)
    return gap


@compiled("i1 f2", inner=True)
def known_rows(parts: Indices, appearance: Array) -> Indices:
    """Rows (n,) of appearance that tell what parts (n,) of edges look like: the own ones, or those of the nearest part
    of the same edge that was learned.
    """
    rows = parts.copy()
    for p in range(len(parts)):
        part = parts[p] % BINS
        for away in range(BINS):
            if part >= away and appearance[parts[p] - away, TIMES_SEEN] > 0.0:
                rows[p] = parts[p] - away
                break
            if part + away < BINS and appearance[parts[p] + away, TIMES_SEEN] > 0.0:
                rows[p] = parts[p] + away
                break
    return rows


@compiled("i1 f2 f0 weights", inner=True, weights=WEIGHTS)
def contrast_weights(rows: Indices, appearance: Array, weak_step: float, config: WeightConfig) -> Array:
    """Weight (n,) of each control point: less where contrast is low or appearance is not learned yet.

    weak_step is in grey levels.
    """
    out = np.empty(len(rows))
    for p in range(len(out)):
        r = rows[p]
        step = 0.0
        for c in range(3):
            step += (appearance[r, POSITIVE_COLOUR + c] - appearance[r, NEGATIVE_COLOUR + c]) ** 2
        known = step / (step + weak_step * weak_step)
        out[p] = known if appearance[r, TIMES_SEEN] > 0.0 else config.unknown_weight
    return out


@compiled("f1 i1 f2 f0 f0 weights", inner=True, weights=WEIGHTS)
def point_weights(
    spacing: Array, rows: Indices, appearance: Array, separate_px: float, weak_step: float, config: WeightConfig
) -> Array:
    """Weight (n,) of each control point: that of its contrast, and less where edges are close.

    spacing (n,) is the distance in px to another edge, of `edge_spacing`, at most separate_px; weak_step is in grey
    levels.
    """
    out = contrast_weights(rows, appearance, weak_step, config)
    for p in range(len(out)):
        out[p] *= min(1.0, max(LEAST_WEIGHT, spacing[p] / separate_px))
    return out


class PointWeights(NamedTuple):
    """Weights (n,) of control points: in the pose, and how much each counts in the support.

    They count also where their own part of an edge was not seen yet, as its nearest part that was.
    """

    weight: Array
    counts: Array


@compiled("lines points f2 f0 f0 weights", inner=True, lines=SEARCH_LINES, points=CONTROL_POINTS, weights=WEIGHTS)
def weights_in_view(
    at: SearchLines,
    points: ControlPoints,
    appearance: Array,
    separate_px: float,
    weak_step: float,
    config: WeightConfig,
) -> PointWeights:
    """Weights of control points, see `point_weights`; edges that are separate_px apart do not disturb each other."""
    rows, spacing_px = points.rows, edge_spacing(at, points.first, separate_px)
    seen = known_rows(rows, appearance)
    return PointWeights(
        point_weights(spacing_px, rows, appearance, separate_px, weak_step, config),
        point_weights(spacing_px, seen, appearance, separate_px, weak_step, config),
    )


@compiled("points candidates f2 f0 weights", points=CONTROL_POINTS, candidates=CANDIDATES, weights=WEIGHTS)
def point_variances(
    points: ControlPoints, found: Candidates, appearance: Array, weak_step: float, config: WeightConfig
) -> Array:
    """Variance (n,) in px^2 of each control point of a search: its mean square distance and that of the search.

    weak_step: step in grey levels of an edge with an assumed error of 1 px before it is learned.
    """
    rows, contrast, own = points.rows, found.contrast, np.empty(len(points.rows))
    for p in range(len(own)):
        if appearance[rows[p], TIMES_SEEN] > 0.0:
            own[p] = config.point_variance_px2 + appearance[rows[p], MEAN_SQUARE]
        else:
            step = weak_step
            for c in range(contrast.shape[1]):
                step = max(step, contrast[p, c])
            error = weak_step / step
            own[p] = config.point_variance_px2 + error**2
    return own


@compiled("measured f2 f0 weights", inner=True, measured=EDGE_MEASUREMENTS, weights=WEIGHTS)
def offset_variances(measured: EdgeMeasurements, appearance: Array, looks: float, config: WeightConfig) -> Array:
    """Prior variance (g,) in px^2 of the offset shared by all control points of an edge.

    measured: of a search, with the variances of `point_variances`. It is the shared part of the harmonic mean of what
    the points were found to err, since the best of them tell most of the offset. Before so many looks at the edge, in
    which that was learned, it is no more than that of any edge, which is larger for less weight.
    """
    first = measured.points.first
    shared = np.empty(len(first) - 1)
    for g in range(len(shared)):
        information, weight, found, seen = 0.0, 0.0, 0, 0.0
        for p in range(first[g], first[g + 1]):
            seen = max(seen, appearance[measured.points.rows[p], TIMES_SEEN])
            information += 1.0 / (measured.variance_px2[p] - config.point_variance_px2)
            if measured.candidates.distance[p, 0] < np.inf:
                weight, found = weight + measured.weight[p], found + 1
        shared[g] = config.shared_part * (first[g + 1] - first[g]) / information
        if seen < looks:
            part = weight / found if found > 0 else 1.0
            shared[g] = min(shared[g], config.offset_variance_px2 / max(part, LEAST_WEIGHT))
    return shared


class Support(NamedTuple):
    """Weighted inlier ratio in [0, 1]: of control points and patches together, and of the control points alone."""

    whole: float
    edges: float


@compiled("measured f1 f2 f0", measured=EDGE_MEASUREMENTS)
def found_parts(measured: EdgeMeasurements, weights: Array, appearance: Array, weak_step: float) -> Array:
    """Part (n,) of each control point that was found, by its weight (n,) in the M-estimator, > 0 for inliers."""
    parts = np.zeros(len(weights))
    for p in range(len(weights)):
        if not weights[p] > 0.0:
            continue
        parts[p] = weights[p] / measured.weight[p]
        if not appearance[measured.points.rows[p], TIMES_SEEN] > 0.0:
            # a match by a weak step of an edge without learned appearance is unreliable
            step = measured.candidates.contrast[p].max()
            parts[p] *= step * step / (step * step + weak_step * weak_step)
    return parts


@compiled("measured f1 f1 f1 f1 f2 f0", inner=True, measured=EDGE_MEASUREMENTS)
def support(
    measured: EdgeMeasurements,
    counts: Array,
    weights: Array,
    patch_weights: Array,
    correlation: Array,
    appearance: Array,
    weak_step: float,
) -> Support:
    """Weighted inlier ratio of the control points and patches.

    counts (n,): how much each control point counts; weights (n,), patch_weights (m,): weights of the M-estimator, > 0
    for inliers; correlation (m,): < 0 for patches that were not searched.
    """
    have, want, parts = 0.0, 0.0, found_parts(measured, weights, appearance, weak_step)
    for p in range(len(weights)):
        have, want = have + counts[p] * parts[p], want + counts[p]
    edges = have / max(1.0, want)
    for p in range(len(patch_weights)):
        if patch_weights[p] > 0.0:
            have, want = have + 1.0, want + 1.0
        elif correlation[p] >= 0.0:
            want += 1.0
    return Support(have / max(1.0, want), edges)
