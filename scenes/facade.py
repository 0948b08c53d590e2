"""Where openings go in a facade, and the grid of cells that has them as recesses."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trajectories.pose import Array


@dataclass(frozen=True)
class Opening:
    """A recess in a facade: x0..x1 along it, z0..z1 up, in metres; a door or a window."""

    x0: float
    x1: float
    z0: float
    z1: float
    door: bool = False


def openings(width_m: float, height_m: float, bays: int, storeys: int, door_bay: int | None) -> tuple[Opening, ...]:
    """A window in the middle of each bay of each storey, and a door in the ground floor's door_bay."""
    bay, storey = width_m / bays, height_m / storeys
    w, h = min(0.45 * bay, 1.4), min(0.52 * storey, 1.7)
    out = []
    for level in range(storeys):
        for k in range(bays):
            x = (k + 0.5) * bay
            if level == 0 and k == door_bay:
                out.append(Opening(x - 0.5, x + 0.5, 0.0, min(2.1, 0.8 * storey), door=True))
            else:
                z = level * storey + 0.32 * storey
                out.append(Opening(x - w / 2, x + w / 2, z, z + h))
    return tuple(out)


def lines(low: float, high: float, cuts: list[float]) -> Array:
    """Grid lines from low to high through all cuts, each once."""
    return np.unique(np.round([low, high, *cuts], 9))


def inside(grid: Array, low: float, high: float) -> NDArray[np.bool_]:
    """Which cells of the grid lines lie between low and high."""
    middle = (grid[1:] + grid[:-1]) / 2
    return (middle > low) & (middle < high)
