"""Compiled weights: how far each control point is to be trusted, and how much it errs."""

import numpy as np
from numpy.typing import NDArray

from uavbench.tracker.robust.config.edges import WeightConfig
from uavbench.tracker.robust.edges.columns import CREASE, EDGE, MEAN_SQUARE, OUTSIDE, TIMES_SEEN
from uavbench.tracker.robust.kernel_values import kernel_type
from uavbench.trajectories.kernels.compiled import compiled
from uavbench.trajectories.pose import Array

WEIGHTS = kernel_type(WeightConfig)

Indices = NDArray[np.int64]


@compiled("f2 i2 i1 weights", weights=WEIGHTS)
def crowding(lines: Array, keys: Indices, side: Indices, config: WeightConfig) -> Array:
    """Distance in px (n,) along each normal to the nearest control point of another, nearly parallel edge."""
    n = len(lines)
    gap = np.full(n, config.separate_px)
    for p in range(n):
        if side[p] == OUTSIDE:
            continue
        for q in range(p + 1, n):
            if keys[q, EDGE] == keys[p, EDGE] or side[q] == OUTSIDE:
                continue
            du, dv = lines[q, 0] - lines[p, 0], lines[q, 1] - lines[p, 1]
            if abs(du) > config.separate_px or abs(dv) > config.separate_px:
                continue
            if abs(lines[p, 2] * lines[q, 2] + lines[p, 3] * lines[q, 3]) < config.parallel_cosine:
                continue
            across = abs(du * lines[p, 2] + dv * lines[p, 3])
            gap[p] = min(gap[p], across)
            gap[q] = min(gap[q], across)
    return gap


@compiled("f1 i1 f2 weights", weights=WEIGHTS)
def trust(gap: Array, rows: Indices, appearance: Array, config: WeightConfig) -> Array:
    """Weight (n,) of each control point: less where edges crowd, contrast is low or appearance is not learned yet.

    gap (n,) is the distance in px to another edge, as of `crowding`.
    """
    out = gap.copy()
    touching_px, least = config.touching_px, config.min_spacing_weight
    for p in range(len(out)):
        r = rows[p]
        apart = min(1.0, max(least, (out[p] - touching_px) / (config.separate_px - touching_px)))
        known = min(1.0, appearance[r, TIMES_SEEN] / config.known_frames)
        step = 0.0
        for c in range(3):
            step += (appearance[r, 3 + c] - appearance[r, c]) ** 2
        out[p] = apart * (
            config.unknown_weight * (1.0 - known)
            + known * step / (step + config.weak_step_grey * config.weak_step_grey)
        )
    return out


@compiled("i2 i1 i1 i1 b1 f2 f2 f1 f2 weights f0", weights=WEIGHTS)
def variances(
    keys: Indices,
    side: Indices,
    rows: Indices,
    first: Indices,
    stands: NDArray[np.bool_],
    distance: Array,
    contrast: Array,
    trusted: Array,
    appearance: Array,
    config: WeightConfig,
    initial_error: float,
) -> tuple[Array, Array]:
    """Variance in px^2 of each control point by itself (n,), and of the offset that all those of an edge share (g,).

    distance, contrast (n, k) are of the candidates, inf where nothing was found; the control points of an edge, keys
    (n, 3), start at rows first (g + 1,). An edge that is trusted (n,) less may lie farther off.
    initial_error is the error in px of an edge not seen yet times its step in grey levels.
    """
    own, shared = np.empty(len(keys)), np.empty(len(first) - 1)
    for g in range(len(shared)):
        p = first[g]
        shared[g] = config.crease_variance_px2 if side[p] == CREASE else config.silhouette_variance_px2
        if stands[keys[p, EDGE]]:
            shared[g] = config.contact_variance_px2
        mean, weight, found = 0.0, 0.0, 0
        for p in range(first[g], first[g + 1]):
            if appearance[rows[p], TIMES_SEEN] > 0.0:
                own[p] = config.point_variance_px2 + appearance[rows[p], MEAN_SQUARE]
            else:
                own[p] = config.point_variance_px2 + (initial_error / max(initial_error, contrast[p].max())) ** 2
            if distance[p, 0] < np.inf:
                mean, weight, found = mean + own[p], weight + trusted[p], found + 1
        if found > 0:
            shared[g] = (
                (shared[g] + config.shared_part * mean / found) * found / max(weight, config.min_spacing_weight * found)
            )
    return own, shared


@compiled("f1 f1 i1 f2 f2 f1 f1 weights", weights=WEIGHTS)
def support(
    weights: Array,
    trusted: Array,
    rows: Indices,
    appearance: Array,
    contrast: Array,
    patches: Array,
    tried: Array,
    config: WeightConfig,
) -> tuple[float, float]:
    """Weighted share of control points and patches that were found, and that of the control points alone.

    weights, trusted (n,) are of the control points; patches (m,) > 0 where a patch took part, tried (m,) < 0 where it
    was not looked for.
    """
    have, want, patch_weight = 0.0, 0.0, config.patch_weight
    for p in range(len(weights)):
        want += trusted[p]
        if appearance[rows[p], TIMES_SEEN] > 0.0:
            have += weights[p]
        else:  # an edge not known yet that is found by a weak step may be anything
            step = contrast[p].max()
            have += weights[p] * step * step / (step * step + config.weak_step_grey * config.weak_step_grey)
    edges = have / max(1.0, want)
    for p in range(len(patches)):
        if patches[p] > 0.0:
            have, want = have + patch_weight, want + patch_weight
        elif tried[p] >= 0.0:
            want += config.missed_weight * patch_weight
    return have / max(1.0, want), edges
