"""Compiled search: candidates on the search line of each control point, by gradient and by learned appearance.

The appearance of a part of an edge is a row of the columns in `columns`; colours are b g r, or grey alone.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.tracker.robust.config.edges import AppearanceConfig, SearchConfig
from uavbench.tracker.robust.edges.columns import (
    BESIDE,
    MEAN_SQUARE,
    NEGATIVE_COLOUR,
    NORMAL_U,
    NORMAL_V,
    OUTSIDE,
    POSITIVE_COLOUR,
    SILHOUETTE_NEGATIVE,
    SILHOUETTE_POSITIVE,
    TIMES_SEEN,
    U,
    V,
)
from uavbench.tracker.robust.edges.measurements import SEARCH_LINES, Candidates, SearchLines
from uavbench.tracker.robust.kernel_values import kernel_type
from uavbench.trajectories.kernels.compiled import compiled, inlined
from uavbench.trajectories.pose import Array

REACH = 4
"""Margin of a profile beyond the search range, px, for the filter and the colours beside a candidate."""
MAX_HALF_PX = 48
"""Largest half length of a search line, the size of the profile buffers."""
CANDIDATES = 4
"""Most candidates on a search line: limits the time of hypotheses, which sample among them."""
SIGMAS = 3.0
"""Half length of search lines in standard deviations: contains 99.7 % of a normal distribution."""
MOST_SQUARE_PX2 = 1.0
"""Largest mean square of an edge's distance that is assumed without being observed: beyond it lie other steps."""
ONE = np.uint32(1)
"""The next row or column of an image, as numbers that are not negative: no kernel needs to check that they are not."""
GREY = (0.114, 0.587, 0.299)
"""Weights of b, g, r in grey (ITU-R BT.601)."""
SEARCH, APPEARANCE = kernel_type(SearchConfig), kernel_type(AppearanceConfig)

Image = NDArray[np.uint8]
Indices = NDArray[np.int64]


@compiled("u3 f1 i0 f2!", inner=True, allocates=False)
def sample_profile(image: Image, line: Array, m: int, out: Array) -> bool:
    """Colours (2 m + 1, 3) at steps of 1 px along a search line (4,), bilinear; False when it leaves the image.

    A grey image (h, w, 1) fills only the first column.
    """
    h, w, channels = image.shape
    u, v, nu, nv = line[U], line[V], line[NORMAL_U], line[NORMAL_V]
    for end in (-m, m):
        x, y = u + end * nu, v + end * nv
        if not (0.0 <= x < w - 1.0 and 0.0 <= y < h - 1.0):
            return False
    if channels == 1:
        for k in range(2 * m + 1):
            x, y = u + (k - m) * nu, v + (k - m) * nv
            i, j = np.uint32(y), np.uint32(x)
            b, a = y - i, x - j
            w00, w01, w10, w11 = (1 - a) * (1 - b), a * (1 - b), (1 - a) * b, a * b
            upper, lower = image[i], image[i + ONE]
            out[k, 0] = w00 * upper[j, 0] + w01 * upper[j + ONE, 0] + w10 * lower[j, 0] + w11 * lower[j + ONE, 0]
        return True
    for k in range(2 * m + 1):
        x, y = u + (k - m) * nu, v + (k - m) * nv
        i, j = np.uint32(y), np.uint32(x)
        b, a = y - i, x - j
        w00, w01, w10, w11 = (1 - a) * (1 - b), a * (1 - b), (1 - a) * b, a * b
        upper, lower = image[i], image[i + ONE]
        out[k, 0] = w00 * upper[j, 0] + w01 * upper[j + ONE, 0] + w10 * lower[j, 0] + w11 * lower[j + ONE, 0]
        out[k, 1] = w00 * upper[j, 1] + w01 * upper[j + ONE, 1] + w10 * lower[j, 1] + w11 * lower[j + ONE, 1]
        out[k, 2] = w00 * upper[j, 2] + w01 * upper[j + ONE, 2] + w10 * lower[j, 2] + w11 * lower[j + ONE, 2]
    return True


@inlined(allocates=False)
def linear_slope(colours: Array, k: int, w0: float, w1: float, w2: float, grey: bool) -> float:
    """Absolute slope at row k of a profile, by the two rows to either side; grey: all but its first column are 0.

    Values are squared first (a gamma of about two), since pixels integrate linear intensity, not coded values.
    """
    total = 0.0
    for j in range(1, 3):
        a, b = k - j, k + j
        total += w0 * (colours[b, 0] ** 2 - colours[a, 0] ** 2)
        if not grey:
            total += w1 * (colours[b, 1] ** 2 - colours[a, 1] ** 2)
            total += w2 * (colours[b, 2] ** 2 - colours[a, 2] ** 2)
    return abs(total)


@inlined(allocates=False)
def peak_offset(colours: Array, k: int, w0: float, w1: float, w2: float, grey: bool) -> float:
    """Sub-pixel position of the maximum slope, in px from row k of a profile, by a parabola through three slopes."""
    before, here, after = (
        linear_slope(colours, k - 1, w0, w1, w2, grey),
        linear_slope(colours, k, w0, w1, w2, grey),
        linear_slope(colours, k + 1, w0, w1, w2, grey),
    )
    bend = before - 2.0 * here + after
    return max(-1.0, min(1.0, 0.5 * (before - after) / bend)) if bend < 0.0 else 0.0


class Scan(NamedTuple):
    """Room for what is read along a search line, made once: colours (m, 3), values (m,) along the learned step, slopes
    (m,), and the rank of each candidate. appearance, weak_step, config: as of `search`.
    """

    colours: Array
    values: Array
    slopes: Array
    rank: Array
    appearance: Array
    weak_step: float
    config: SearchConfig


@compiled("u3 lines i1 f2 f1 f0 search", lines=SEARCH_LINES, search=SEARCH)
def search(
    image: Image,
    at: SearchLines,
    rows: Indices,
    appearance: Array,
    half: Array,
    weak_step: float,
    config: SearchConfig,
) -> Candidates:
    """Candidates of each control point on its search line.

    rows (n,): rows of `appearance`; half (n,): half lengths of the search lines in px. Candidates are ranked by
    contrast, less a penalty for colours beside them that differ from the learned ones by more than weak_step, in grey
    levels. Contrast is signed along the learned step, in grey levels; without learned appearance it is that of the grey
    image, unsigned.
    """
    n, side = len(at.lines), at.side
    found = Candidates(np.full((n, CANDIDATES), np.inf), np.zeros((n, CANDIDATES)))
    longest = 2 * (MAX_HALF_PX + REACH) + 1
    scan = Scan(
        *(np.zeros((longest, 3)), np.empty(longest), np.empty(longest), np.empty(CANDIDATES)),
        *(appearance, weak_step, config),
    )
    for p in range(n):
        if side[p] != OUTSIDE:
            search_line(image, at, p, rows[p], half[p], scan, found)
    return found


@inlined(allocates=False)
def search_line(image: Image, at: SearchLines, p: int, row: int, half_px: float, scan: Scan, found: Candidates) -> None:
    """Write the candidates on the search line of a control point p, with a row of the appearance."""
    line, learned_row, side, config, weak_step = (
        at.lines[p],
        scan.appearance[row],
        at.side[p],
        scan.config,
        scan.weak_step,
    )
    colours, f, g, rank, grey = scan.colours, scan.values, scan.slopes, scan.rank, image.shape[2] == 1
    m = min(MAX_HALF_PX, int(half_px + 1.0)) + REACH
    while not sample_profile(image, line, m, colours):
        m -= 2
        if m <= REACH:
            break
    if m <= REACH:
        return
    learned = learned_row[TIMES_SEEN] > 0.0
    w0, w1, w2, step = GREY[0], GREY[1], GREY[2], 0.0
    if grey:
        w0, w1, w2 = 1.0, 0.0, 0.0
    if learned:
        d0 = learned_row[POSITIVE_COLOUR] - learned_row[NEGATIVE_COLOUR]
        d1 = learned_row[POSITIVE_COLOUR + 1] - learned_row[NEGATIVE_COLOUR + 1]
        d2 = learned_row[POSITIVE_COLOUR + 2] - learned_row[NEGATIVE_COLOUR + 2]
        step = math.sqrt(d0 * d0 + d1 * d1 + d2 * d2)
        if step > config.min_contrast_grey:
            w0, w1, w2 = d0 / step, d1 / step, d2 / step
        else:
            learned = False
    least = config.min_contrast_grey
    if learned:
        least = max(config.min_contrast_grey, config.learned_step_part * step)
    if grey:
        for k in range(2 * m + 1):
            f[k] = w0 * colours[k, 0]
    else:
        for k in range(2 * m + 1):
            f[k] = w0 * colours[k, 0] + w1 * colours[k, 1] + w2 * colours[k, 2]
    for k in range(2, 2 * m - 1):
        slope = 0.5 * (f[k + 1] + f[k + 2] - f[k - 1] - f[k - 2])
        g[k] = slope if learned else abs(slope)
    for s in range(CANDIDATES):
        rank[s] = -np.inf
    for k in range(REACH, 2 * m + 1 - REACH):
        if not (g[k] >= least and g[k] >= g[k - 1] and g[k] > g[k + 1]):
            continue
        d = k - m + peak_offset(colours, k, w0, w1, w2, grey)
        cost = 0.0
        if learned:
            low, high = 0.0, 0.0
            for c in range(image.shape[2]):
                before = 0.5 * (colours[k - 2, c] + colours[k - 3, c])
                after = 0.5 * (colours[k + 2, c] + colours[k + 3, c])
                low += (before - learned_row[NEGATIVE_COLOUR + c]) ** 2
                high += (after - learned_row[POSITIVE_COLOUR + c]) ** 2
            if side == SILHOUETTE_POSITIVE:  # the background of a silhouette edge varies
                low = 0.0
            elif side == SILHOUETTE_NEGATIVE:
                high = 0.0
            cost = 0.5 * (low + high) / (weak_step * weak_step)
            cost = min(SIGMAS * SIGMAS, cost)
        value = g[k] / (step + weak_step) - 0.5 * cost  # exponent of a normal density
        slot = 0
        for s in range(1, CANDIDATES):
            if rank[s] < rank[slot]:
                slot = s
        if value > rank[slot]:
            rank[slot] = value
            found.distance[p, slot], found.contrast[p, slot] = d, g[k]


@compiled("u3 lines i1 f1 f2! appearance", inner=True, lines=SEARCH_LINES, appearance=APPEARANCE)
def learn(
    image: Image, at: SearchLines, rows: Indices, found: Array, appearance: Array, config: AppearanceConfig
) -> None:
    """Update `appearance` in place with the colours beside each control point that was found (n,) > 0 near its edge."""
    lines, side = at.lines, at.side
    colours = np.zeros((2 * BESIDE + 1, 3))
    for p in range(len(lines)):
        r = rows[p]
        if side[p] == OUTSIDE or not found[p] > 0.0:
            continue
        if not sample_profile(image, lines[p], BESIDE, colours):
            continue
        gain = max(config.learning_rate, 1.0 / (1.0 + appearance[r, TIMES_SEEN]))
        step = 0.0
        for c in range(3):
            before = 0.5 * (colours[BESIDE - 2, c] + colours[BESIDE - 3, c])
            after = 0.5 * (colours[BESIDE + 2, c] + colours[BESIDE + 3, c])
            step += (after - before) ** 2
            appearance[r, NEGATIVE_COLOUR + c] += gain * (before - appearance[r, NEGATIVE_COLOUR + c])
            appearance[r, POSITIVE_COLOUR + c] += gain * (after - appearance[r, POSITIVE_COLOUR + c])
        if appearance[r, TIMES_SEEN] == 0.0:
            appearance[r, MEAN_SQUARE] = first_square(math.sqrt(step), config.weak_step_grey)
        appearance[r, TIMES_SEEN] += 1.0


@compiled("f0 f0", inner=True, allocates=False)
def first_square(step: float, weak_step: float) -> float:
    """Expected mean square residual in px^2 of an edge with a step in grey levels, before any observation."""
    return min(MOST_SQUARE_PX2, 0.01 + (weak_step / max(step, 1.0)) ** 2)


@compiled("lines i1 f1 f2 f2! appearance", inner=True, allocates=False, lines=SEARCH_LINES, appearance=APPEARANCE)
def learn_squares(
    at: SearchLines, rows: Indices, residual: Array, covariance: Array, appearance: Array, config: AppearanceConfig
) -> None:
    """Update the mean squares of `appearance` in place with the expected squares of the distances at the true pose.

    residual (n,): distance in px at a fitted pose, inf for none; covariance (6, 6) of that pose, which may have
    followed the very offsets that are learned (an expectation step: Dempster, Laird & Rubin 1977).
    """
    J = at.jacobian
    for p in range(len(rows)):
        row = appearance[rows[p]]
        if at.side[p] == OUTSIDE or residual[p] == np.inf or not row[TIMES_SEEN] > 0.0:
            continue
        left_open = 0.0
        for i in range(6):
            for j in range(6):
                left_open += J[p, i] * covariance[i, j] * J[p, j]
        gain = max(config.learning_rate, 1.0 / row[TIMES_SEEN])  # the first one takes the place of what was assumed
        row[MEAN_SQUARE] += gain * (residual[p] ** 2 + min(MOST_SQUARE_PX2, left_open) - row[MEAN_SQUARE])


@compiled("f2 f2 f0 f0")
def search_range(J: Array, P: Array, least: float, most: float) -> Array:
    """Half length (n,) of each search line: a multiple of the predicted standard deviation along its normal."""
    out = np.empty(len(J))
    for p in range(len(J)):
        s = 0.0
        for i in range(6):
            for j in range(6):
                s += J[p, i] * P[i, j] * J[p, j]
        out[p] = min(most, max(least, SIGMAS * math.sqrt(s) + 1.0))
    return out
