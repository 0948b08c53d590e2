"""Compiled weights: how far each control point is to be trusted, and how much it errs."""

import numpy as np
from numpy.typing import NDArray

from uavbench.tracker.robust.edges.profile_kernels import FIRST_ERROR
from uavbench.trajectories.kernels.compiled import compiled
from uavbench.trajectories.pose import Array

CROWD_PX, TOUCHING_PX = 8.0, 2.0
"""Edges farther apart than the one do not disturb each other, nearer than the other they cannot be told apart."""
WEAK_STEP = 15.0
"""Grey levels: an edge with this contrast weighs half of one with much."""
MISSED_TRUST = 0.5
"""A patch that is not found counts for less than one that is: noise alone hides many."""
OWN_VARIANCE = 0.08**2
SILHOUETTE_VARIANCE, CREASE_VARIANCE, CONTACT_VARIANCE = 0.05**2, 0.25**2, 0.2**2
COMMON_PART = 0.05
"""Variance of a control point in px^2: its own, and that of the offset which all points of its edge share.

The latter takes a part of what was learned of the edge too. Measured at true poses, on average over an edge:
silhouettes lie 0.01 to 0.1 px from the model's edge; creases 0.1 to 0.9 px, by worn borders and by what is set into a
face; an edge that stands on the ground 0.05 to 0.4 px, by its shadow.
"""

Indices = NDArray[np.int64]


@compiled("f2 i2 i1")
def crowding(lines: Array, keys: Indices, side: Indices) -> Array:
    """Distance in px (n,) along each normal to the nearest control point of another, nearly parallel edge."""
    n = len(lines)
    gap = np.full(n, CROWD_PX)
    for p in range(n):
        if side[p] == 9:
            continue
        for q in range(p + 1, n):
            if keys[q, 0] == keys[p, 0] or side[q] == 9:
                continue
            du, dv = lines[q, 0] - lines[p, 0], lines[q, 1] - lines[p, 1]
            if abs(du) > CROWD_PX or abs(dv) > CROWD_PX:
                continue
            if abs(lines[p, 2] * lines[q, 2] + lines[p, 3] * lines[q, 3]) < 0.85:
                continue
            across = abs(du * lines[p, 2] + dv * lines[p, 3])
            gap[p] = min(gap[p], across)
            gap[q] = min(gap[q], across)
    return gap


@compiled("f1 i1 f2")
def trust(gap: Array, rows: Indices, appearance: Array) -> Array:
    """Weight (n,) of each control point: less where edges crowd, contrast is low or appearance is not learned yet.

    gap (n,) is the distance in px to another edge, as of `crowding`.
    """
    out = gap.copy()
    for p in range(len(out)):
        r = rows[p]
        apart = min(1.0, max(0.02, (out[p] - TOUCHING_PX) / (CROWD_PX - TOUCHING_PX)))
        known = min(1.0, appearance[r, 6] / 3.0)
        step = 0.0
        for c in range(3):
            step += (appearance[r, 3 + c] - appearance[r, c]) ** 2
        out[p] = apart * (0.25 * (1.0 - known) + known * step / (step + WEAK_STEP * WEAK_STEP))
    return out


@compiled("i2 i1 i1 i1 b1 f2 f2 f1 f2")
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
) -> tuple[Array, Array]:
    """Variance in px^2 of each control point by itself (n,), and of the offset that all those of an edge share (g,).

    distance, contrast (n, k) are of the candidates, inf where nothing was found; the control points of an edge, keys
    (n, 3), start at rows first (g + 1,). An edge that is trusted (n,) less may lie farther off.
    """
    own, shared = np.empty(len(keys)), np.empty(len(first) - 1)
    for g in range(len(shared)):
        p = first[g]
        shared[g] = CREASE_VARIANCE if side[p] == 0 else SILHOUETTE_VARIANCE
        if stands[keys[p, 0]]:
            shared[g] = CONTACT_VARIANCE
        mean, weight, found = 0.0, 0.0, 0
        for p in range(first[g], first[g + 1]):
            if appearance[rows[p], 6] > 0.0:
                own[p] = OWN_VARIANCE + appearance[rows[p], 7]
            else:
                own[p] = OWN_VARIANCE + (FIRST_ERROR / max(FIRST_ERROR, contrast[p].max())) ** 2
            if distance[p, 0] < np.inf:
                mean, weight, found = mean + own[p], weight + trusted[p], found + 1
        if found > 0:
            shared[g] = (shared[g] + COMMON_PART * mean / found) * found / max(weight, 0.02 * found)
    return own, shared


@compiled("f1 f1 i1 f2 f2 f1 f1 f0")
def support(
    weights: Array,
    trusted: Array,
    rows: Indices,
    appearance: Array,
    contrast: Array,
    patches: Array,
    tried: Array,
    patch_trust: float,
) -> tuple[float, float]:
    """Weighted share of control points and patches that were found, and that of the control points alone.

    weights, trusted (n,) are of the control points; patches (m,) > 0 where a patch took part, tried (m,) < 0 where it
    was not looked for.
    """
    have, want = 0.0, 0.0
    for p in range(len(weights)):
        want += trusted[p]
        if appearance[rows[p], 6] > 0.0:
            have += weights[p]
        else:  # an edge not known yet that is found by a weak step may be anything
            step = contrast[p].max()
            have += weights[p] * step * step / (step * step + WEAK_STEP * WEAK_STEP)
    edges = have / max(1.0, want)
    for p in range(len(patches)):
        if patches[p] > 0.0:
            have, want = have + patch_trust, want + patch_trust
        elif tried[p] >= 0.0:
            want += MISSED_TRUST * patch_trust
    return have / max(1.0, want), edges
