"""Digits of vertices in text: whether a program rounded them before it wrote them, as to 32-bit numbers."""

import re

import numpy as np

from uavbench.trajectories.pose import Array

SIX_DIGITS = re.compile(rb"^v .*?\b(\d\.?\d{0,5})[eE]\+0*([5-9]|1\d)\b", re.MULTILINE)
"""A coordinate of 10^5 or more with an exponent and at most six digits: the default of C and C++."""
SIX = 5
"""Decimal places by which the last of six digits is below the first."""
LEAST_STEP = 1 / 64
"""Least step of 32-bit numbers that is told from chance: it is that of coordinates from 131,072 on."""
ROUND_OFF = 0.00051
"""How far a coordinate with three decimals is from the 32-bit number that it is."""
ROUND_PART, FEWEST = 0.25, 3
"""Quarters are written by people, too; so many other values, all of them 32-bit numbers, are not by chance."""


def written_step(data: bytes, vertices: Array) -> float:
    """Step to which the vertices (n, 3) of a file were rounded before they were written; 0 where none is seen."""
    exponents = SIX_DIGITS.finditer(data) if b"+" in data else ()
    six = [10.0 ** (int(found[2]) - SIX) for found in exponents]
    steps = np.spacing(np.abs(vertices).max(axis=0, initial=0).astype(np.float32)).astype(np.float64)
    rounded = any(_on_steps(axis, float(step)) for axis, step in zip(vertices.T, steps, strict=True))
    return max([*six, float(steps.max()) if rounded else 0.0])


def _on_steps(values: Array, step: float) -> bool:
    """Whether values (n,) are multiples of the step of 32-bit numbers, beyond what people write or chance gives."""
    if step < LEAST_STEP:
        return False
    off = np.abs(values - np.rint(values / step) * step)
    uneven = np.unique(values[np.abs(values - np.rint(values / ROUND_PART) * ROUND_PART) > ROUND_OFF])
    return bool(off.max(initial=0) <= ROUND_OFF) and len(uneven) >= FEWEST
