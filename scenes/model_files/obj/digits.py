"""Digits of vertices in text: whether a program rounded them before it wrote them, as to 32-bit numbers."""

import re

import numpy as np

from uavbench.trajectories.pose import Array

EXPONENT = re.compile(rb"[eE]\+")
FEW_DIGITS = re.compile(rb"^v .*(?<![\d.])(\d\.?\d{0,6})[eE]\+0*([5-9]|1\d)\b", re.MULTILINE)
"""The last coordinate of 10^5 or more with an exponent and at most six digits, or seven: defaults of C and C++."""
SIX = 5
"""Decimal places by which the last of six digits is below the first; fewer are six whose zeros are left out."""
LEAST_STEP = 1 / 64
"""Least step of 32-bit numbers that is told from chance: it is that of coordinates from 131,072 on."""
ROUND_OFF = 0.00051
"""How far a coordinate with three decimals is from the 32-bit number that it is."""
FEWEST_BESIDE = {0.25: 3, 0.125: 2}
"""People write quarters, and eighths, as of masonry; so many other values, all 32-bit numbers, are not by chance."""


def written_step(data: bytes, vertices: Array) -> float:
    """Step to which the vertices (n, 3) of a file were rounded before they were written; 0 where none is seen."""
    exponents = FEW_DIGITS.finditer(data) if EXPONENT.search(data) else ()
    few = [10.0 ** (int(found[2]) - max(SIX, len(found[1].replace(b".", b"")) - 1)) for found in exponents]
    steps = np.spacing(np.abs(vertices).max(axis=0, initial=0).astype(np.float32)).astype(np.float64)
    rounded = any(_on_steps(axis, float(step)) for axis, step in zip(vertices.T, steps, strict=True))
    return max([*few, float(steps.max()) if rounded else 0.0])


def _on_steps(values: Array, step: float) -> bool:
    """Whether values (n,) are multiples of the step of 32-bit numbers, beyond what people write or chance gives."""
    if step < LEAST_STEP:
        return False
    off = np.abs(values - np.rint(values / step) * step)
    if off.max(initial=0) > ROUND_OFF:
        return False
    return all(
        np.unique(values[np.abs(values - np.rint(values / part) * part) > ROUND_OFF]).size >= fewest
        for part, fewest in FEWEST_BESIDE.items()
    )
