"""Kernel of the contrast of edges in an image: grey levels on either side of their samples.

Grey as by OpenCV's `cvtColor`, and interpolated as by its `remap`, at the places beside edges alone.
"""

from typing import Any

import numpy as np

from uavbench.trajectories.kernels.compiled import compiled, inlined

SIDE_PX = 2.5
"""Distance on either side of an edge at which its contrast is measured, px."""
SHORTEST_PX = 1e-9
"""Distance of the samples before and after one, px, below which the edge has no direction in the image."""
BLUE, GREEN, RED, WHOLE_BITS = 3735, 19235, 9798, 15
"""Shares of colours in a grey level (ITU-R BT.601), in units of 2 ** -WHOLE_BITS."""


@compiled("f2 i1 b1 u3 f1!", allocates=False)
def find_contrasts(pixels: Any, which: Any, seen: Any, image: Any, out: Any) -> None:
    """Difference (n,) of grey levels of an image (h, w, 3) BGR across the edge at each sample, 0 where it is not seen.

    pixels (n, 2) and which (n,): the samples and their edges, whose direction is that of the samples before and after.
    """
    last = pixels.shape[0] - 1
    for i in range(last + 1):
        out[i] = 0.0
        if not seen[i]:
            continue
        x = y = 0.0
        if i < last and which[i + 1] == which[i]:
            x, y = pixels[i + 1, 0] - pixels[i, 0], pixels[i + 1, 1] - pixels[i, 1]
        if i > 0 and which[i] == which[i - 1]:
            x, y = x + (pixels[i, 0] - pixels[i - 1, 0]), y + (pixels[i, 1] - pixels[i - 1, 1])
        norm = np.sqrt(x * x + y * y)
        across_x, across_y = (-y / norm, x / norm) if norm > SHORTEST_PX else (0.0, 0.0)
        left = _level(image, pixels[i, 0] + SIDE_PX * across_x, pixels[i, 1] + SIDE_PX * across_y)
        right = _level(image, pixels[i, 0] - SIDE_PX * across_x, pixels[i, 1] - SIDE_PX * across_y)
        out[i] = abs(np.float32(left - right))


@compiled
def _level(image: Any, u: float, v: float) -> Any:
    """Grey level at a place, interpolated along rows, then between them; beyond the image that of its border."""
    h, w = image.shape[0], image.shape[1]
    across, down = np.float32(u), np.float32(v)
    column, row = int(np.floor(across)), int(np.floor(down))
    left, right = min(max(column, 0), w - 1), min(max(column + 1, 0), w - 1)
    top, bottom = min(max(row, 0), h - 1), min(max(row + 1, 0), h - 1)
    across, down = np.float32(across - np.float32(column)), np.float32(down - np.float32(row))
    upper = _between(_grey(image, top, left), _grey(image, top, right), across)
    lower = _between(_grey(image, bottom, left), _grey(image, bottom, right), across)
    return _between(upper, lower, down)


@compiled
def _between(one: Any, other: Any, share: Any) -> Any:
    """What is between two levels in 32 bits, rounded once, as by a fused multiplication and addition."""
    return np.float32(np.float64(share) * np.float64(np.float32(other - one)) + np.float64(one))


@inlined
def _grey(image: Any, row: int, column: int) -> Any:
    """Grey level of a pixel, rounded."""
    blue, green, red = int(image[row, column, 0]), int(image[row, column, 1]), int(image[row, column, 2])
    return np.float32((BLUE * blue + GREEN * green + RED * red + (1 << (WHOLE_BITS - 1))) >> WHOLE_BITS)
