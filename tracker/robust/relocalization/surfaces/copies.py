"""Faces of a structure that are made alike: what one of them looks like says nothing of which one it is."""

import numpy as np
from numpy.typing import NDArray

from uavbench.tracker.robust.edges.edge_graph import EdgeMap
from uavbench.tracker.robust.relocalization.self_similarity import DIRECTION_STEP, LENGTH_STEP, direction_numbers
from uavbench.tracker.robust.row_numbers import row_numbers

SHORTEST = 1e-9
"""Length of an edge that is none, in the unit of the structure."""


def is_copied(edges: EdgeMap) -> NDArray[np.bool_]:
    """Whether each face (f,) has another one that is turned to the same side, with edges as long in all directions.

    So have the panes of equal windows, and not the wall between them. Faces are told by sums of 64 random bits for each
    of their edges: two of 100,000 are mistaken for each other with a probability of 3e-10.
    """
    along = edges.ends[:, 1] - edges.ends[:, 0]
    lengths = np.maximum(np.linalg.norm(along, axis=1), SHORTEST)
    sizes = np.round(np.log(lengths) / LENGTH_STEP).astype(np.int64)
    made = mixed(row_numbers(np.column_stack([direction_numbers(along / lengths[:, None]), sizes])))
    sides = mixed(row_numbers(np.round(edges.planes[:, :3] / DIRECTION_STEP).astype(np.int64)))
    outlines = mixed(sides.view(np.int64))  # twice: numbers of sides may be those of edges
    for faces in edges.faces.T:
        np.add.at(outlines, faces[faces >= 0], made[faces >= 0])
    _, kind, number = np.unique(outlines, return_inverse=True, return_counts=True)
    return np.asarray(number[kind] > 1)


def mixed(numbers: NDArray[np.int64]) -> NDArray[np.uint64]:
    """Numbers (n,) as 64 bits each that are random, but equal for equal numbers (SplitMix64: Steele et al. 2014)."""
    bits = numbers.astype(np.uint64) + np.uint64(1)
    bits *= np.uint64(0x9E3779B97F4A7C15)
    bits = (bits ^ (bits >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    bits = (bits ^ (bits >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return np.asarray(bits ^ (bits >> np.uint64(31)))
