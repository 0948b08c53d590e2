"""Compiled row filters of PNG, which predict a pixel from its neighbours and keep the residual."""

from typing import Any

import numpy as np

from uavbench.trajectories.kernels.compiled import compiled

UP, AVERAGE = 2, 3
"""Filter types (PNG specification, third edition, section 9.2)."""


@compiled("u2 i0 i0 u2!")
def filter_rows(rows: Any, pixel: int, kind: int, out: Any) -> None:
    """Residuals of rows (h, n) of bytes against the row above (UP), or its mean with the pixel to the left (AVERAGE).

    out (h, 1 + n) has the filter type before each row; pixel is the number of bytes per pixel.
    """
    h, n = rows.shape
    above = np.zeros(n, dtype=np.uint8)
    for i in range(h):
        out[i, 0] = kind
        row, into = rows[i], out[i, 1:]
        if kind == UP:
            for j in range(n):
                into[j] = np.uint8(row[j] - above[j])
        else:
            for j in range(min(pixel, n)):
                into[j] = np.uint8(row[j] - (above[j] >> 1))
            left, here, over, rest = row[: n - pixel], row[pixel:], above[pixel:], into[pixel:]
            for j in range(n - pixel):
                a, b = left[j], over[j]
                rest[j] = here[j] - ((a & b) + ((a ^ b) >> np.uint8(1)))  # their mean, in 8 bits
        above[:] = row
