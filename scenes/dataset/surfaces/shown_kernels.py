"""What the pixels of a camera show: facets, and inverse depths that are filled in row by row from their planes."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.trajectories.kernels.argument_types import named_tuple
from uavbench.trajectories.kernels.compiled import compiled
from uavbench.trajectories.kernels.equal_bytes import AT_ONCE, lowest_bit, unlike
from uavbench.trajectories.pose import Array


class Shown(NamedTuple):
    """What the pixels (h, w) of a camera show: facets, -1 for none, and inverse depths, 1/m, 0 for the sky and NaN for
    nothing. places (h, w, 2): where their rays meet the rendered image, px.

    Where the camera is the one that was rendered, places (h, 0, 2) and near (h, 0) are empty, and planes (n + 1, 3) has
    that of each facet that is shown, after that of the background: inverse depths are planes * (u, v, 1), but not < 0.
    """

    rows: NDArray[np.int32]
    near: Array
    planes: Array
    places: Array

    @classmethod
    def through_lens(cls, places: Array) -> "Shown":
        """Nothing as yet, at places (h, w, 2)."""
        size = places.shape[:2]
        return cls(np.empty(size, dtype=np.int32), np.empty(size), np.empty((0, 3)), places)

    @classmethod
    def rendered(cls, size: tuple[int, int], facets: int) -> "Shown":
        """Nothing as yet, at the centres of the pixels of an image of a size (h, w)."""
        h, w = size
        return cls(np.empty((h, w), dtype=np.int32), np.empty((h, 0)), np.empty((facets + 1, 3)), np.empty((h, 0, 2)))


SHOWN = named_tuple(Shown, "j2! f2! f2! f3!")


@compiled
def read_near(shown: Any, i: int, near: Any) -> None:
    """Set near (w,) to the inverse depths of row i: those of its pixels, or those of the planes of its runs."""
    rows, begin = shown.rows[i], 0
    for j in range(shown.near.shape[1]):
        near[j] = shown.near[i, j]
    while begin < rows.size and shown.near.shape[1] == 0:
        end = end_of_run(rows, begin)
        _fill(shown.planes[rows[begin] + 1], begin, i, near[begin:end])
        begin = end


@compiled
def end_of_run(rows: Any, begin: int) -> Any:
    """The first place after a beginning at which facets (w,) are not those there; or their number.

    AT_ONCE at once, with places without a sign, which need no check for one below 0.
    """
    data, place, last = rows.view(np.uint8), np.uint64(begin), np.uint64(rows.size)
    while place + np.uint64(AT_ONCE) < last:
        others = unlike(data, np.uint64(4) * place, np.uint64(4) * (place + np.uint64(1)), AT_ONCE)
        if others != 0:
            return np.int64(place + (lowest_bit(others) >> np.uint64(2)) + np.uint64(1))
        place += np.uint64(AT_ONCE)
    while place < last and rows[place] == rows[begin]:
        place += np.uint64(1)
    return np.int64(place)


@compiled
def _fill(plane: Any, begin: int, v: int, near: Any) -> None:
    """Inverse depths (n,) of a plane at n places of a row; 0 beyond the horizon."""
    rest = plane[1] * v + plane[2]
    for k in range(near.size):
        value = plane[0] * (begin + k) + rest
        near[k] = 0.0 if value < 0.0 else value
