"""Compiled search: candidates on the search line of each control point, by gradient and by learned appearance.

The appearance of a part of an edge is a row (8,): mean colour on the negative and on the positive side of its normal
(b g r each, or grey alone), how often it was seen, and the mean square in px^2 by which it was found beside the pose.
"""

import math

import numpy as np
from numpy.typing import NDArray

from uavbench.trajectories.kernels.compiled import compiled
from uavbench.trajectories.pose import Array

CANDIDATES = 4
BESIDE = 3
"""The colours beside an edge are those 2 and 3 px away."""
REACH = 4
"""Px beyond the search range that a profile takes in, for the filter and the colours beside a candidate."""
MAX_HALF_PX = 48
GREY = (0.114, 0.587, 0.299)
"""Weights of b, g, r in grey (ITU-R BT.601)."""
FAR_PX = 1.5
"""Residuals are learned up to this size."""
FIRST_ERROR = 15.0
"""Error in px of an edge times its step in grey levels, before any was seen."""
SURE_PX = 0.7
"""Colours are learned of control points found no farther than this from the pose's edge."""
SLOWEST = 0.05
"""Share of the newest residual in the mean square that is learned."""
MIN_CONTRAST = 7.0
"""Weakest step of a candidate, grey levels, where nothing is learned."""
APPEARANCE_SIGMA = 14.0
"""Spread of the colour beside an edge from frame to frame, grey levels."""

Image = NDArray[np.uint8]
Indices = NDArray[np.int64]


@compiled("u3 f0 f0 f0 f0 i0 f2!")
def sample_profile(image: Image, u: float, v: float, nu: float, nv: float, m: int, out: Array) -> bool:
    """Colours (2 m + 1, 3) at steps of 1 px along the normal, bilinear; False when it leaves the image.

    A grey image (h, w, 1) fills the first column alone.
    """
    h, w, channels = image.shape
    for end in (-m, m):
        x, y = u + end * nu, v + end * nv
        if not (0.0 <= x < w - 1.0 and 0.0 <= y < h - 1.0):
            return False
    for k in range(2 * m + 1):
        x, y = u + (k - m) * nu, v + (k - m) * nv
        i, j = int(y), int(x)
        b, a = y - i, x - j
        w00, w01, w10, w11 = (1 - a) * (1 - b), a * (1 - b), (1 - a) * b, a * b
        for c in range(channels):
            out[k, c] = (
                w00 * image[i, j, c]
                + w01 * image[i, j + 1, c]
                + w10 * image[i + 1, j, c]
                + w11 * image[i + 1, j + 1, c]
            )
    return True


@compiled("f2 i0 f0 f0 f0")
def peak_offset(colours: Array, k: int, w0: float, w1: float, w2: float) -> float:
    """Where the step is steepest, in px from row k of a profile: the top of a parabola through three slopes.

    Pixels mix light, not its coded value, so that the values are squared first (a gamma of about two).
    """
    slope = np.empty(3)
    for s in range(3):
        total = 0.0
        for j in range(1, 3):
            a, b = k + s - 1 - j, k + s - 1 + j
            total += w0 * (colours[b, 0] ** 2 - colours[a, 0] ** 2)
            total += w1 * (colours[b, 1] ** 2 - colours[a, 1] ** 2)
            total += w2 * (colours[b, 2] ** 2 - colours[a, 2] ** 2)
        slope[s] = abs(total)
    bend = slope[0] - 2.0 * slope[1] + slope[2]
    return max(-1.0, min(1.0, 0.5 * (slope[0] - slope[2]) / bend)) if bend < 0.0 else 0.0


@compiled("u3 f2 i1 i1 f2 f1")
def search(
    image: Image, lines: Array, side: Indices, rows: Indices, appearance: Array, half: Array
) -> tuple[Array, Array, Array]:
    """Candidates of each control point: distance, penalty and contrast, each (n, CANDIDATES), inf where none.

    rows (n,) are those of `appearance`; half (n,) the half lengths of the search lines in px. The penalty grows with
    the squared distance between the colours beside a candidate and those learned. Contrast is signed along the learned
    step, in grey levels; where nothing is learned it is that of the grey image, without sign.
    """
    n = len(lines)
    distance = np.full((n, CANDIDATES), np.inf)
    penalty = np.full((n, CANDIDATES), np.inf)
    contrast = np.zeros((n, CANDIDATES))
    colours = np.zeros((2 * (MAX_HALF_PX + REACH) + 1, 3))
    grey = image.shape[2] == 1
    f = np.empty(len(colours))
    g = np.empty(len(colours))
    rank = np.empty(CANDIDATES)
    for p in range(n):
        if side[p] == 9:
            continue
        m = min(MAX_HALF_PX, int(half[p] + 1.0)) + REACH
        while not sample_profile(image, lines[p, 0], lines[p, 1], lines[p, 2], lines[p, 3], m, colours):
            m -= 2
            if m <= REACH:
                break
        if m <= REACH:
            continue
        learned = appearance[rows[p], 6] > 0.0
        w0, w1, w2, step = GREY[0], GREY[1], GREY[2], 0.0
        if grey:
            w0, w1, w2 = 1.0, 0.0, 0.0
        if learned:
            d0 = appearance[rows[p], 3] - appearance[rows[p], 0]
            d1 = appearance[rows[p], 4] - appearance[rows[p], 1]
            d2 = appearance[rows[p], 5] - appearance[rows[p], 2]
            step = math.sqrt(d0 * d0 + d1 * d1 + d2 * d2)
            if step > 4.0:
                w0, w1, w2 = d0 / step, d1 / step, d2 / step
            else:
                learned = False
        least = max(MIN_CONTRAST * 0.7, 0.2 * step) if learned else MIN_CONTRAST
        for k in range(2 * m + 1):
            f[k] = w0 * colours[k, 0] + w1 * colours[k, 1] + w2 * colours[k, 2]
        for k in range(2, 2 * m - 1):
            g[k] = 0.5 * (f[k + 1] + f[k + 2] - f[k - 1] - f[k - 2])
            if not learned and g[k] < 0:
                g[k] = -g[k]
        rank[:] = -np.inf
        for k in range(REACH, 2 * m + 1 - REACH):
            if not (g[k] >= least and g[k] >= g[k - 1] and g[k] > g[k + 1]):
                continue
            d = k - m + peak_offset(colours, k, w0, w1, w2)
            cost = 0.0
            if learned:
                low, high = 0.0, 0.0
                for c in range(3):
                    before = 0.5 * (colours[k - 2, c] + colours[k - 3, c])
                    after = 0.5 * (colours[k + 2, c] + colours[k + 3, c])
                    low += (before - appearance[rows[p], c]) ** 2
                    high += (after - appearance[rows[p], 3 + c]) ** 2
                if side[p] == 1:  # the background beside a silhouette edge changes: it counts for a quarter
                    low *= 0.25
                elif side[p] == -1:
                    high *= 0.25
                cost = min(9.0, 0.5 * (low + high) / (APPEARANCE_SIGMA * APPEARANCE_SIGMA))
            value = g[k] / (step + 10.0) - 0.5 * cost
            slot = 0
            for s in range(1, CANDIDATES):
                if rank[s] < rank[slot]:
                    slot = s
            if value > rank[slot]:
                rank[slot] = value
                distance[p, slot], penalty[p, slot], contrast[p, slot] = d, cost, g[k]
    return distance, penalty, contrast


@compiled("u3 f2 i1 i1 f1 f1 f2! f0")
def learn(
    image: Image,
    lines: Array,
    side: Indices,
    rows: Indices,
    found: Array,
    residual: Array,
    appearance: Array,
    rate: float,
) -> None:
    """Take up the colours beside each control point that was found (n,) > 0 near its edge into `appearance`, in place.

    residual (n,) in px is how far from the pose's edge each was found, inf where nothing was.
    """
    colours = np.zeros((2 * BESIDE + 1, 3))
    for p in range(len(lines)):
        r = rows[p]
        if side[p] == 9 or not abs(residual[p]) < FAR_PX:
            continue
        if appearance[r, 6] > 0.0:
            gain = max(SLOWEST, 1.0 / (2.0 + appearance[r, 6]))
            appearance[r, 7] += gain * (residual[p] * residual[p] - appearance[r, 7])
        if not found[p] > 0.0 or abs(residual[p]) > SURE_PX:
            continue
        if not sample_profile(image, lines[p, 0], lines[p, 1], lines[p, 2], lines[p, 3], BESIDE, colours):
            continue
        gain = max(rate, 1.0 / (1.0 + appearance[r, 6]))
        step = 0.0
        for c in range(3):
            before = 0.5 * (colours[BESIDE - 2, c] + colours[BESIDE - 3, c])
            after = 0.5 * (colours[BESIDE + 2, c] + colours[BESIDE + 3, c])
            step += (after - before) ** 2
            appearance[r, c] += gain * (before - appearance[r, c])
            appearance[r, 3 + c] += gain * (after - appearance[r, 3 + c])
        if appearance[r, 6] == 0.0:
            appearance[r, 7] = first_square(math.sqrt(step))
        appearance[r, 6] += 1.0


@compiled("f0")
def first_square(step: float) -> float:
    """Mean square error in px^2 to expect of an edge with a step in grey levels, before any was seen."""
    return min(1.0, 0.01 + (FIRST_ERROR / max(step, 1.0)) ** 2)


@compiled("f2 f2 f0 f0")
def search_range(J: Array, P: Array, least: float, most: float) -> Array:
    """Half length (n,) of each search line: three standard deviations of the predicted point along its normal."""
    out = np.empty(len(J))
    for p in range(len(J)):
        s = 0.0
        for i in range(6):
            for j in range(6):
                s += J[p, i] * P[i, j] * J[p, j]
        out[p] = min(most, max(least, 3.0 * math.sqrt(s) + 1.0))
    return out
