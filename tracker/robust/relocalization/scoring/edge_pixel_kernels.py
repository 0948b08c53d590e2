"""Compiled edge detection: gradient maxima of a small image, binned by direction."""

import math

import numpy as np
from numpy.typing import NDArray

from uavbench.trajectories.kernels.compiled import compiled

ORIENTATIONS = 8
"""Number of direction bins of edge pixels over half a turn."""
DIAGONAL = 2.4
"""Ratio of a gradient's components above which it counts as axis-aligned: tan(67.5 degrees)."""


@compiled("u3 f0")
def edge_channels(image: NDArray[np.uint8], least: float) -> NDArray[np.uint8]:
    """Maxima of the colour gradient by direction (ORIENTATIONS, h, w): 0 on an edge pixel, 1 elsewhere.

    An edge pixel enters its own bin and the nearer adjacent bin.
    """
    h, w = image.shape[0], image.shape[1]
    out = np.empty((ORIENTATIONS, h, w), np.uint8)
    out[:] = 1
    gx, gy, power = np.zeros((h, w)), np.zeros((h, w)), np.zeros((h, w))
    for i in range(1, h - 1):
        for j in range(1, w - 1):
            for c in range(image.shape[2]):
                x = float(image[i, j + 1, c]) - float(image[i, j - 1, c])
                y = float(image[i + 1, j, c]) - float(image[i - 1, j, c])
                p = x * x + y * y
                if p > power[i, j]:
                    power[i, j], gx[i, j], gy[i, j] = p, x, y
    for i in range(1, h - 1):
        for j in range(1, w - 1):
            p = power[i, j]
            if p < least * least:
                continue
            if abs(gx[i, j]) > DIAGONAL * abs(gy[i, j]):
                di, dj = 0, 1
            elif abs(gy[i, j]) > DIAGONAL * abs(gx[i, j]):
                di, dj = 1, 0
            elif gx[i, j] * gy[i, j] > 0:
                di, dj = 1, 1
            else:
                di, dj = 1, -1
            if p < power[i + di, j + dj] or p <= power[i - di, j - dj]:
                continue
            turn = math.atan2(gy[i, j], gx[i, j]) / math.pi * ORIENTATIONS
            bin_ = math.floor(turn) % ORIENTATIONS
            out[bin_, i, j] = 0
            near = bin_ + (1 if turn - math.floor(turn) > 0.5 else -1)
            out[near % ORIENTATIONS, i, j] = 0
    return out


@compiled("s2 s0 s0 u2!")
def truncate(distance: NDArray[np.float32], most: np.float32, scale: np.float32, out: NDArray[np.uint8]) -> None:
    """Distances (h, w) as parts of the largest one that counts, times a scale, into whole numbers (h, w)."""
    for i in range(distance.shape[0]):
        for j in range(distance.shape[1]):
            out[i, j] = np.uint8(np.int32(min(distance[i, j] / most, np.float32(1.0)) * scale))
