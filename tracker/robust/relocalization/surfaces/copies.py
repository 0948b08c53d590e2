"""Faces of a structure that are made alike: what one of them looks like says nothing of which one it is."""

from collections import Counter

import numpy as np
from numpy.typing import NDArray

from uavbench.tracker.robust.edges.edge_graph import EdgeMap
from uavbench.tracker.robust.relocalization.self_similarity import DIRECTION_STEP, LENGTH_STEP, direction_numbers

SHORTEST = 1e-9
"""Length of an edge that is none, in the unit of the structure."""


def is_copied(edges: EdgeMap) -> NDArray[np.bool_]:
    """Whether each face (f,) has another one that is turned to the same side, with edges as long in all directions.

    So have the panes of equal windows, and not the wall between them.
    """
    along = edges.ends[:, 1] - edges.ends[:, 0]
    lengths = np.maximum(np.linalg.norm(along, axis=1), SHORTEST)
    directions = direction_numbers(along / lengths[:, None]).tolist()
    sizes = np.round(np.log(lengths) / LENGTH_STEP).astype(np.int64).tolist()
    outlines: list[list[tuple[int, int]]] = [[] for _ in edges.planes]
    for faces, direction, size in zip(edges.faces.tolist(), directions, sizes, strict=True):
        for face in faces:
            if face >= 0:
                outlines[face].append((direction, size))
    sides = np.round(edges.planes[:, :3] / DIRECTION_STEP).astype(np.int64).tolist()
    made = [(tuple(side), tuple(sorted(outline))) for side, outline in zip(sides, outlines, strict=True)]
    number = Counter(made)
    return np.array([number[each] > 1 for each in made], dtype=np.bool_)
