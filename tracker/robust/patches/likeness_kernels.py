"""Compiled grey values about a patch in an image, and how much they are like its own."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.tracker.robust.edges.profile_kernels import ONE
from uavbench.tracker.robust.patches.matches import HALF, SIDE, WARP, Warp
from uavbench.trajectories.kernels.compiled import compiled, inlined
from uavbench.trajectories.pose import Array

Image = NDArray[np.uint8]


class Likeness(NamedTuple):
    """Correlation of grey values with the texels of a patch, their mean, and the scale that gives them norm 1.

    Correlation -1 and scale 0 where they are not all in the image, or have less than the required contrast.
    """

    correlation: float
    mean: float
    scale: float


@compiled("u3 warp f0 f0 f2!", inner=True, allocates=False, warp=WARP)
def sample(image: Image, at: Warp, a: float, b: float, out: Array) -> None:
    """Grey values (n, m) at steps of a texel from texel (a, b) of a patch, its centre at HALF; NaN outside the image.

    Uses the second channel of a colour image.
    """
    (h, w, channels), (n, m) = image.shape, out.shape
    channel = 1 if channels > 1 else 0
    x_right, x_down, y_right, y_down = at.x_right, at.x_down, at.y_right, at.y_down
    u0 = at.u + x_right * (a - HALF) + x_down * (b - HALF)
    v0 = at.v + y_right * (a - HALF) + y_down * (b - HALF)
    inside = True
    for i in (0, n - 1):  # where the corners are in the image all between them are
        for j in (0, m - 1):
            x, y = u0 + x_right * j + x_down * i, v0 + y_right * j + y_down * i
            inside &= 0.0 <= x < w - 1.0 and 0.0 <= y < h - 1.0
    for i in range(n):
        for j in range(m):
            x, y = u0 + x_right * j + x_down * i, v0 + y_right * j + y_down * i
            if inside or (0.0 <= x < w - 1.0 and 0.0 <= y < h - 1.0):
                out[i, j] = grey_at(image, x, y, channel)
            else:
                out[i, j] = math.nan


@inlined(allocates=False)
def grey_at(image: Image, x: float, y: float, channel: int) -> float:
    """Value of a channel between four pixels, bilinear."""
    r, c = np.uint32(y), np.uint32(x)
    below, right = y - r, x - c
    upper = (1 - right) * image[r, c, channel] + right * image[r, c + ONE, channel]
    lower = (1 - right) * image[r + ONE, c, channel] + right * image[r + ONE, c + ONE, channel]
    return float((1 - below) * upper + below * lower)


@compiled("f2 i0 i0 f2 f0", inner=True, allocates=False)
def likeness(grey: Array, row: int, column: int, ref: Array, least_grey: float) -> Likeness:
    """Likeness to the texels `ref` of the SIDE x SIDE grey values from a row and column on, of at least a contrast."""
    total, squares, product = 0.0, 0.0, 0.0
    for i in range(SIDE):
        for j in range(SIDE):
            value = grey[row + i, column + j]
            total, squares, product = total + value, squares + value * value, product + value * ref[i, j]
    mean = total / (SIDE * SIDE)
    power = squares - total * mean
    if not power >= least_grey * least_grey * SIDE * SIDE:
        return Likeness(-1.0, mean, 0.0)
    scale = 1.0 / math.sqrt(power)
    return Likeness(product * scale, mean, scale)
