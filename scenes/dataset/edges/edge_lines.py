"""Lines of edges/NNNNNN.csv, by a kernel: Python's formatting of a bridge's edges takes as long as finding them."""

from typing import Any

import numpy as np

from uavbench.trajectories.kernels.compiled import compiled
from uavbench.trajectories.pose import Array

LONGEST = 24
"""Room for one number with the character after it, bytes: a sign, 18 digits, and a point."""
DIGITS, SCALE = 4, 10000.0
"""Digits after the point, and ten to their power."""
SPLITTER = 134217729.0
"""2^27 + 1, which splits a float64 into two halves of at most 26 bits (Dekker 1971)."""
MINUS, POINT, COMMA, ZERO, END = 45, 46, 44, 48, 10
"""ASCII codes."""


def edge_lines(rows: Array) -> bytes:
    """A line for each row (n, 7) of EDGE_COLUMNS: its edge as an integer, the others as by `%.4f`; below 10^12."""
    text = np.empty(rows.size * LONGEST, dtype=np.uint8)
    return text[: put_lines(np.ascontiguousarray(rows), text)].tobytes()


@compiled("f2 u1!", allocates=False)
def put_lines(rows: Any, text: Any) -> int:
    """Write the lines of rows (n, k) into text; returns its length in bytes."""
    at: int = 0
    for i in range(rows.shape[0]):
        at = _put_digits(text, at, int(rows[i, 0]), 1)
        for k in range(1, rows.shape[1]):
            text[at] = COMMA
            at = _put_number(text, at + 1, rows[i, k])
        text[at] = END
        at += 1
    return at


@compiled
def _put_number(text: Any, at: int, value: float) -> int:
    """Write a number as `%.4f`; returns where it ends."""
    if np.signbit(value):
        text[at] = MINUS
        at += 1
    units = _rounded(abs(value))
    whole = units // int(SCALE)
    at = _put_digits(text, at, whole, 1)
    text[at] = POINT
    return _put_digits(text, at + 1, units - whole * int(SCALE), DIGITS)


@compiled
def _rounded(value: float) -> int:
    """SCALE times a number, to the nearest integer, of two as near the even one: of the product without round-off."""
    near = value * SCALE
    high = SPLITTER * value
    high = high - (high - value)
    beyond = (high * SCALE - near) + (value - high) * SCALE  # round-off of the product (Dekker 1971)
    whole = np.rint(near)
    if near - whole == 0.5 and beyond > 0.0:
        whole += 1.0
    elif near - whole == -0.5 and beyond < 0.0:
        whole -= 1.0
    return int(whole)


@compiled
def _put_digits(text: Any, at: int, value: int, fewest: int) -> int:
    """Write an integer from 0 on with at least so many digits; returns where it ends."""
    count, rest = 1, value // 10
    while rest > 0:
        count, rest = count + 1, rest // 10
    count = max(count, fewest)
    for k in range(count - 1, -1, -1):
        text[at + k] = ZERO + value % 10
        value //= 10
    return at + count
