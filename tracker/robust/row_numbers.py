"""A number for each row of whole numbers, by which rows are told and sorted in a fraction of the time."""

import numpy as np
from numpy.typing import NDArray

MOST = 1 << 62
"""Numbers that are told apart before those that do not occur are left out."""

Indices = NDArray[np.int64]


def row_numbers(rows: Indices) -> Indices:
    """A number (n,) for each row (n, k), equal for equal rows, in lexicographic order."""
    numbers, size = np.zeros(len(rows), dtype=np.int64), 1
    for column in rows.T:
        low, high = int(column.min(initial=0)), int(column.max(initial=0))
        if size * (high - low + 1) > MOST:
            numbers, column = (np.unique(each, return_inverse=True)[1] for each in (numbers, column))
            size, low, high = int(numbers.max()) + 1, 0, int(column.max())
        numbers = numbers * (high - low + 1) + (column - low)
        size *= high - low + 1
    return numbers
