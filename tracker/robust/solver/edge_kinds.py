"""Kinds of edges: those of equal details, such as all sills, whose images are offset alike."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.tracker.robust.edges.columns import BOTH_FACES
from uavbench.tracker.robust.edges.edge_graph import EdgeMap
from uavbench.tracker.robust.row_numbers import row_numbers
from uavbench.trajectories.pose import Array

LENGTH_STEP = 0.01
"""Relative difference between a length and the next greater one from which on they are not equal."""
DIRECTION_STEPS = 16
"""Steps of a component of a unit vector; those that structures have, as 0, 1/2 and 0.71, lie well within a step."""

Indices = NDArray[np.int64]


class EdgeKinds(NamedTuple):
    """Kinds (3 e,) of edges as seen with one, the other, or both of their faces, -1 for one that is like no other.

    signs (3 e,) of their normals relative to those of the others; number of kinds.
    """

    kinds: Indices
    signs: Array
    number: int

    @classmethod
    def of(cls, edges: EdgeMap) -> "EdgeKinds":
        """Kinds of a structure's edges: of equal direction and length, between faces of equal normals and sides."""
        along = edges.ends[:, 1] - edges.ends[:, 0]
        lengths = np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-12)
        forward, back = numbers(along / lengths), numbers(-along / lengths)
        signs = np.where(_less(forward, back), -1.0, 1.0)
        normals = np.where((edges.faces >= 0)[..., None], edges.planes[edges.faces, :3], 0.0)
        sides = np.concatenate([numbers(normals), numbers(edges.inward)], axis=2)
        swapped = _less(sides[:, 1], sides[:, 0])
        sides[swapped] = sides[swapped][:, ::-1]
        looks = np.column_stack([np.where(signs[:, None] < 0, back, forward), sides.reshape(len(lengths), 12)])
        kind = _split(row_numbers(looks), np.log(lengths[:, 0]), LENGTH_STEP)
        faces = np.tile(np.arange(1, BOTH_FACES + 1), (len(lengths), 1))
        faces[swapped] = faces[swapped][:, [1, 0, 2]]
        kind = (kind[:, None] * BOTH_FACES + faces - 1).ravel()
        members = np.bincount(kind)
        numbered = np.where(members > 1, np.cumsum(members > 1) - 1, -1)
        return cls(numbered[kind], np.repeat(signs, BOTH_FACES), int(np.count_nonzero(members > 1)))


def numbers(directions: Array) -> Indices:
    """Whole numbers of the components of unit vectors, equal for those of about one direction."""
    return np.round(directions * DIRECTION_STEPS).astype(np.int64)


def _split(groups: Indices, values: Array, step: float) -> Indices:
    """Groups (n,), split where sorted values (n,) differ from the next by more than a step: no bin parts equal ones."""
    order = np.lexsort([values, groups])
    apart = (np.diff(groups[order]) != 0) | (np.diff(values[order]) > step)
    split = np.zeros(len(groups), dtype=np.int64)
    split[order[1:]] = np.cumsum(apart)
    return split


def _less(a: Indices, b: Indices) -> NDArray[np.bool_]:
    """Mask (n,) of the rows of a (n, k) that come before those of b in lexicographic order."""
    differ = np.argmax(a != b, axis=1)
    rows = np.arange(len(a))
    return np.asarray(a[rows, differ] < b[rows, differ])
