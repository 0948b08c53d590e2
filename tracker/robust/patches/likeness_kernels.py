"""Compiled grey values about a patch in an image, and how much they are like its own."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.tracker.robust.edges.profile_kernels import ONE
from uavbench.tracker.robust.patches.matches import HALF, SIDE, WARP, Warp
from uavbench.trajectories.kernels.argument_types import named_tuple
from uavbench.trajectories.kernels.compiled import compiled, inlined
from uavbench.trajectories.pose import Array

Image = NDArray[np.uint8]
ROWS, COLUMNS = np.repeat(np.arange(float(SIDE)), SIDE), np.tile(np.arange(float(SIDE)), SIDE)
"""Row and column of each texel of a patch."""


class Between(NamedTuple):
    """Room for n places between pixels, made once: the first of the four pixels about each (n,), how far to the right
    of it and below the place is (n,), and the codes (4, n) of these pixels.

    A processor finds eight places at once, and the values there, if codes are read by themselves.
    """

    first: NDArray[np.int32]
    right: Array
    below: Array
    codes: NDArray[np.uint8]


BETWEEN = named_tuple(Between, "j1! f1! f1! u2!")


@inlined
def room_between(n: int) -> Between:
    """Room for n places between pixels."""
    return Between(np.empty(n, np.int32), np.empty(n), np.empty(n), np.empty((4, n), np.uint8))


@inlined(allocates=False)
def place_between(x: float, y: float, width: float, k: int, between: Between) -> None:
    """Note that place k is at a pixel (x, y), both at least 0, of an image of this width."""
    column, row = np.floor(x), np.floor(y)
    between.right[k], between.below[k] = x - column, y - row
    between.first[k] = np.int32(row * width + column)


@inlined(allocates=False)
def read_codes(image: Image, channel: int, n: int, between: Between) -> None:
    """Read the codes of a channel in the pixels about the first n places."""
    h, w, channels = image.shape
    codes, read, first = image.reshape(h * w * channels), between.codes, between.first
    step, start = np.uint32(channels), np.uint32(channel)
    row = np.uint32(w) * step
    for k in range(n):
        p = np.uint32(first[k]) * step + start
        read[0, k], read[1, k] = codes[p], codes[p + step]
        read[2, k], read[3, k] = codes[p + row], codes[p + row + step]


class Texels(NamedTuple):
    """Room for the grey values of a patch, made once: grey (SIDE, SIDE), and the places of its texels."""

    grey: Array
    between: Between


TEXELS = named_tuple(Texels, "f2! between", between=BETWEEN)


class Likeness(NamedTuple):
    """Correlation of grey values with the texels of a patch, their mean, and the scale that gives them norm 1.

    Correlation -1 and scale 0 where they are not all in the image, or have less than the required contrast.
    """

    correlation: float
    mean: float
    scale: float


@inlined
def room_for_texels() -> Texels:
    """Room for the grey values of a patch."""
    return Texels(np.empty((SIDE, SIDE)), room_between(SIDE * SIDE))


@compiled("u3 warp f0 f0 texels", inner=True, allocates=False, warp=WARP, texels=TEXELS)
def sample_texels(image: Image, at: Warp, a: float, b: float, into: Texels) -> None:
    """Grey values of the texels of a patch from (a, b) on: as `sample`, all of them at once where they are inside."""
    h, w, channels = image.shape
    channel, width = 1 if channels > 1 else 0, float(w)
    x_right, x_down, y_right, y_down = at.x_right, at.x_down, at.y_right, at.y_down
    u0 = at.u + x_right * (a - HALF) + x_down * (b - HALF)
    v0 = at.v + y_right * (a - HALF) + y_down * (b - HALF)
    for i in (0, SIDE - 1):
        for j in (0, SIDE - 1):
            x, y = u0 + x_right * j + x_down * i, v0 + y_right * j + y_down * i
            if not (0.0 <= x < w - 1.0 and 0.0 <= y < h - 1.0):
                sample(image, at, a, b, into.grey)
                return
    between, codes, grey = into.between, into.between.codes, into.grey.reshape(SIDE * SIDE)
    for k in range(SIDE * SIDE):
        i, j = ROWS[k], COLUMNS[k]
        place_between(u0 + x_right * j + x_down * i, v0 + y_right * j + y_down * i, width, k, between)
    read_codes(image, channel, SIDE * SIDE, between)
    for k in range(SIDE * SIDE):
        right, below = between.right[k], between.below[k]
        upper, lower = (1 - right) * codes[0, k] + right * codes[1, k], (1 - right) * codes[2, k] + right * codes[3, k]
        grey[k] = (1 - below) * upper + below * lower


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
