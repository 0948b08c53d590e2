"""Compiled fit of the steps of light in a strip of pixels: a control point's own edge, and those that blur into it.

Across an edge light is a + b H(s) with s the distance and H a step blurred by pixel and lens; beside other edges it is
a + sum b_i H(s_i). With edge i shifted by d_i it is a + sum b_i H(s_i) - b_i d_i H'(s_i): linear in the level a, the
steps b_i and the products b_i d_i. All is summed once; the shifts come of it by Gauss-Newton steps, which see no pixel.
How far a neighbour may be shifted beside the edge itself is a prior: close edges tell where they both are, not each.
H has to be as wide as the image's: an edge alone tells that, by the light's change with the width of H.
"""

import math
from typing import NamedTuple

import numpy as np

from uavbench.tracker.robust.edges.columns import NORMAL_U, NORMAL_V, U, V
from uavbench.tracker.robust.edges.profile_kernels import Image
from uavbench.trajectories.kernels.argument_types import named_tuple
from uavbench.trajectories.kernels.compiled import compiled
from uavbench.trajectories.pose import Array

CODES = np.arange(256) / 255
LIGHT = np.where(CODES <= 0.04045, CODES / 12.92, ((CODES + 0.055) / 1.055) ** 2.4)
"""Linear light of sRGB codes (IEC 61966-2-1): pixels mix light, not codes."""
LEAST_STEP = float(LIGHT[1])
"""A step of light below that of one code is none."""
LEAST_NOISE = LEAST_STEP**2 / 12
"""Variance of light by rounding to codes, at the least."""
INITIAL_BLUR_PX = 0.5
"""Standard deviation of H': 0.29 px of a pixel's area, whatever its direction, and 0.4 px of a sharp lens."""
LEAST_BLUR_PX = 12**-0.5
"""That of a pixel's area alone."""
REACH_PX = 3
"""Pixels to either side of the edge on a scan line: more add little to a step and its two levels."""
WIDTH = 2 * REACH_PX + 1
MOST_BLUR_PX = REACH_PX / 3
"""Three standard deviations are seen on either side."""
TABLE_SIGMAS, STEPS_PER_SIGMA = 4, 128
AT = np.arange(-TABLE_SIGMAS * STEPS_PER_SIGMA, TABLE_SIGMAS * STEPS_PER_SIGMA + 1) / STEPS_PER_SIGMA
STEP = np.array([0.5 * (1 + math.erf(z / math.sqrt(2))) for z in AT])
SLOPE = np.exp(-0.5 * np.square(AT)) / math.sqrt(2 * math.pi)
SPREAD = -AT * SLOPE
"""H, and its derivatives by the distance and by the standard deviation, at standard deviations of 1 px."""
LAST = float(len(AT) - 1)
MOST_STEPS = (WIDTH - 1) // 2
"""A level, and a step and a shift of each edge, are no more than the pixels across them."""
LEAST_LINES = 3
"""Scan lines in the image, fewer of which tell no variance of the fit."""
NEWTON_STEPS = 2
"""From the given places on: the shifts are products divided by steps, and the second changes them by a hundredth."""
RIDGE = 1e-9
"""Share of a pixel's weight that keeps the steps of edges on one line from being undetermined."""


class Workspace(NamedTuple):
    """Arrays of a fit, allocated once.

    lines (s, 4) of the steps, the first one's own, normals to the same side; apart_px2 (s,) prior variance of the shift
    of each beside that of the first; blur (3,): that of the image in px, and, added to by fits of edges alone, the
    information on how much wider it is and that times the difference. Written by the fit: information (m, m) and
    vector (m,) of level, steps and products; factor (m, m) and right (m,) of level, steps and shifts; columns
    (m, WIDTH), 1 in the first, and light (WIDTH,) of a scan line; step (s,) and shift (s,).
    """

    lines: Array
    apart_px2: Array
    blur: Array
    information: Array
    vector: Array
    factor: Array
    right: Array
    columns: Array
    light: Array
    step: Array
    shift: Array


WORKSPACE = named_tuple(Workspace, "f2! f1! f1! f2! f1! f2! f1! f2! f1! f1! f1!")


class Step(NamedTuple):
    """Distance of a step in px along a normal, and its variance in px^2."""

    distance: float
    variance_px2: float


NO_STEP = Step(np.inf, np.inf)


@compiled("i0 f0")
def workspace(steps: int, blur_px: float) -> Workspace:
    """Arrays for fits of up to so many steps, two or more, of an image with a blur."""
    m = 1 + 2 * steps
    return Workspace(
        *(np.zeros((steps, 4)), np.zeros(steps), np.array([blur_px, 0.0, 0.0])),
        *(np.zeros((m, m)), np.zeros(m), np.zeros((m, m)), np.zeros(m)),
        *(np.ones((m, WIDTH)), np.zeros(WIDTH), np.zeros(steps), np.zeros(steps)),
    )


@compiled("u3 i0 i0 f1 work", inner=True, work=WORKSPACE)
def add_strip(image: Image, steps: int, along: int, colour: Array, work: Workspace) -> tuple[int, float]:
    """Make the sums over the pixels of a strip anew, in place; their number, and the sum of squared light."""
    h, w, channels = image.shape
    lines, G, t, c, light = work.lines, work.information, work.vector, work.columns, work.light
    by_rows = abs(lines[0, NORMAL_U]) >= abs(lines[0, NORMAL_V])
    cross, down, cross_normal, down_normal = (U, V, NORMAL_U, NORMAL_V) if by_rows else (V, U, NORMAL_V, NORMAL_U)
    width, height = (w, h) if by_rows else (h, w)
    free, m = 1 + steps, 1 + 2 * steps + (steps == 1)  # an edge alone tells the blur, too
    for i in range(m):
        t[i] = 0.0
        for j in range(i + 1):
            G[i, j] = 0.0
    n, square, blur_px = 0, 0.0, work.blur[0]
    per_px = STEPS_PER_SIGMA / blur_px
    x0, y0, nx, ny = lines[0, cross], lines[0, down], lines[0, cross_normal], lines[0, down_normal]
    middle = int(y0 + 0.5)
    for y in range(max(0, middle - along), min(height, middle + along + 1)):
        low = int(x0 - (y - y0) * ny / nx + 0.5) - REACH_PX
        if low < 0 or low + WIDTH > width:
            continue
        for k in range(WIDTH):
            x, f = low + k, 0.0
            for channel in range(channels):
                f += colour[channel] * LIGHT[image[y, x, channel] if by_rows else image[x, y, channel]]
            light[k] = f
            square += f * f
        for i in range(steps):
            s = (low - lines[i, cross]) * lines[i, cross_normal] + (y - lines[i, down]) * lines[i, down_normal]
            at = s * per_px + TABLE_SIGMAS * STEPS_PER_SIGMA + 0.5
            for k in range(WIDTH):
                entry = int(min(LAST, max(0.0, at + k * lines[i, cross_normal] * per_px)))
                c[1 + i, k], c[free + i, k] = STEP[entry], SLOPE[entry] / blur_px
                if steps == 1:
                    c[free + 1, k] = SPREAD[entry] / blur_px
        for i in range(m):  # a line at once: sums in registers
            total = 0.0
            for k in range(WIDTH):
                total += c[i, k] * light[k]
            t[i] += total
            for j in range(i + 1):
                total = 0.0
                for k in range(WIDTH):
                    total += c[i, k] * c[j, k]
                G[i, j] += total
        n += WIDTH
    for i in range(m):
        for j in range(i):
            G[j, i] = G[i, j]
    return n, square


@compiled("f2 f1 f0 f1 f1 i0 f0 f1!", inner=True)
def residual(G: Array, t: Array, level: float, b: Array, d: Array, steps: int, square: float, gradient: Array) -> float:
    """Sum of squared residuals of a model, from the sums; t - G p of its products p into gradient (m,)."""
    m, left = 1 + 2 * steps, square
    for i in range(m):
        gradient[i] = t[i] - G[i, 0] * level
        for j in range(steps):
            gradient[i] -= G[i, 1 + j] * b[j] - G[i, 1 + steps + j] * b[j] * d[j]
    left -= level * (t[0] + gradient[0])
    for j in range(steps):
        left -= b[j] * (t[1 + j] + gradient[1 + j]) - b[j] * d[j] * (t[1 + steps + j] + gradient[1 + steps + j])
    return float(left)


@compiled("f2 f1 f1 i0 f2! f1!", inner=True)
def linearize(G: Array, b: Array, d: Array, steps: int, A: Array, right: Array) -> None:
    """Information of level, steps and shifts into A (m, m), from that of the products; right (m,) turned likewise."""
    m, free = 1 + 2 * steps, 1 + steps
    for i in range(m):
        A[i, 0] = G[i, 0]
        for j in range(steps):
            A[i, 1 + j] = G[i, 1 + j] - d[j] * G[i, free + j]
            A[i, free + j] = -b[j] * G[i, free + j]
    for j in range(steps):
        for i in range(m):
            A[1 + j, i] -= d[j] * A[free + j, i]
            A[free + j, i] *= -b[j]
        right[1 + j] -= d[j] * right[free + j]
        right[free + j] *= -b[j]


@compiled("f1 f1 f0 i0 f2! f1!", inner=True)
def add_prior(apart_px2: Array, d: Array, noise: float, steps: int, A: Array, right: Array) -> float:
    """Add what is known of the shifts of neighbours beside that of the first edge; the information that this has."""
    own, total = 1 + steps, 0.0
    for i in range(1, steps):
        weight = noise / apart_px2[i]
        total += weight
        A[own, own] += weight
        A[own + i, own + i] += weight
        A[own + i, own] -= weight
        right[own + i] -= weight * (d[i] - d[0])
        right[own] += weight * (d[i] - d[0])
    return total


@compiled("f2! f1! i0", inner=True)
def solve_positive(A: Array, x: Array, n: int) -> bool:
    """Put A^-1 x into x (n,), and the Cholesky factor of A (n, n) into its lower half; False where there is none."""
    for i in range(n):
        for j in range(i + 1):
            s = A[i, j]
            for k in range(j):
                s -= A[i, k] * A[j, k]
            if i == j:
                if not s > 0.0:
                    return False
                A[i, i] = math.sqrt(s)
            else:
                A[i, j] = s / A[j, j]
    for i in range(n):
        for k in range(i):
            x[i] -= A[i, k] * x[k]
        x[i] /= A[i, i]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            x[i] -= A[k, i] * x[k]
        x[i] /= A[i, i]
    return True


@compiled("f2 f1! i0 i0", inner=True)
def inverse_at(factor: Array, column: Array, i: int, n: int) -> float:
    """Element (i, i) of the inverse of a matrix (n, n) with this Cholesky factor; column (n,) is used up."""
    total = 0.0
    for j in range(i, n):
        s = 1.0 if j == i else 0.0
        for k in range(i, j):
            s -= factor[j, k] * column[k]
        column[j] = s / factor[j, j]
        total += column[j] * column[j]
    return total


@compiled("f0 i0 work", inner=True, work=WORKSPACE)
def add_blur(noise: float, n: int, work: Workspace) -> None:
    """Add what the sums over n pixels about an edge alone tell of the blur, in place."""
    G, t, A, x = work.information, work.vector, work.factor, work.right
    for i in range(4):
        x[i] = t[i]
        for j in range(i + 1):
            A[i, j] = G[i, j]
        A[i, i] += RIDGE * n
    if solve_positive(A, x, 4):
        weight = np.square(x[1] * A[3, 3]) / noise
        work.blur[1] += weight
        work.blur[2] += weight * x[3] / x[1]


@compiled("u3 i0 i0 f1 work", work=WORKSPACE)
def fit_steps(image: Image, steps: int, along: int, colour: Array, work: Workspace) -> Step:
    """How far the first of the steps on the lines of `work` is from its line; inf where there is none.

    Pixels of `along` rows, or columns, to either side that cross the edge most steeply, REACH_PX of each to either side
    of the edge; of an edge alone a step in the direction `colour` (3,), beside others in either.
    """
    n, square = add_strip(image, steps, along, colour, work)
    free, m = 1 + steps, 1 + 2 * steps
    if n < LEAST_LINES * WIDTH:
        return NO_STEP
    G, t, A, x, b, d = work.information, work.vector, work.factor, work.right, work.step, work.shift
    for i in range(free):
        x[i] = t[i]
        for j in range(i + 1):
            A[i, j] = G[i, j]
        A[i, i] += RIDGE * n
    if not solve_positive(A, x, free):
        return NO_STEP
    level, noise, prior = x[0], 0.0, 0.0
    for i in range(steps):
        b[i], d[i] = x[1 + i], 0.0
    for _ in range(NEWTON_STEPS):
        noise = max(LEAST_NOISE, residual(G, t, level, b, d, steps, square, x) / (n - m))
        linearize(G, b, d, steps, A, x)
        prior = add_prior(work.apart_px2, d, noise, steps, A, x)
        for i in range(m):
            A[i, i] += RIDGE * n
        if not solve_positive(A, x, m):
            return NO_STEP
        level += x[0]
        for i in range(steps):
            b[i], d[i] = b[i] + x[1 + i], d[i] + x[free + i]
    if not (b[0] if steps == 1 else abs(b[0])) > LEAST_STEP:
        return NO_STEP
    by_itself = A[free, free] * A[free, free] - prior  # what neighbours tell, they tell at their own points
    variance_px2 = noise * max(inverse_at(A, x, free, m), 1.0 / max(by_itself, RIDGE))
    if steps == 1 and abs(d[0]) < work.blur[0]:
        add_blur(noise, n, work)
    return Step(d[0], variance_px2)
