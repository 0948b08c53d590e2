"""Compiled row filters of PNG, which predict a pixel from its neighbours and keep the residual."""

from typing import Any

import numpy as np

from uavbench.trajectories.kernels.compiled import compiled

UP, AVERAGE = 2, 3
"""Filter types (PNG specification, third edition, section 9.2)."""


@compiled("u2 i0 i0 u2!", allocates=False)
def filter_rows(rows: Any, pixel: int, kind: int, out: Any) -> None:
    """Residuals of rows (h, n) of bytes against the row above (UP), or its mean with the pixel to the left (AVERAGE).

    out (h, 1 + n) has the filter type before each row; pixel is the number of bytes per pixel.
    """
    h, n = rows.shape
    first = min(pixel, n)
    for i in range(h):
        out[i, 0] = kind
        row, above, into = rows[i], rows[max(i - 1, 0)], out[i][1:]
        if kind == UP:
            less(row, above, i > 0, into)
        else:
            for j in range(first):
                into[j] = row[j] - (above[j] >> 1 if i else 0)
            _less_mean(row[: n - first], row[first:], above[first:], i > 0, into[first:])


@compiled
def less(row: Any, above: Any, has_above: bool, out: Any) -> None:
    """Out (n,) = row - above, or row where there is none above."""
    if has_above:
        for j in range(out.size):
            out[j] = row[j] - above[j]
    else:
        for j in range(out.size):
            out[j] = row[j]


@compiled
def _less_mean(left: Any, row: Any, above: Any, has_above: bool, out: Any) -> None:
    """Out (n,) = row minus the mean of left and above, which is 0 where there is none."""
    if has_above:
        for j in range(out.size):
            a, b = left[j], above[j]
            out[j] = row[j] - ((a & b) + ((a ^ b) >> np.uint8(1)))  # their mean, in 8 bits
    else:
        for j in range(out.size):
            out[j] = row[j] - (left[j] >> np.uint8(1))
