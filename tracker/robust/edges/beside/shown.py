"""Which faces show beside each part of each edge, where a mesh is made of parts that touch."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.scenes.structure import Structure
from uavbench.tracker.robust.edges.beside.contact_kernels import BEYOND, OPPOSITE, PARTS, SAME_WAY, WITHIN
from uavbench.tracker.robust.edges.columns import BOTH_FACES
from uavbench.trajectories.geometry.bvh import Tree
from uavbench.trajectories.geometry.rays import are_inside
from uavbench.trajectories.pose import Array

Indices = NDArray[np.int64]


class Beside(NamedTuple):
    """A structure, inward (e, 2, 3) of its edges, and the bits (e, 2, 2, PARTS) of the faces beside them.

    away: distance from an edge at which it is asked what is inside of the structure.
    """

    structure: Structure
    inward: Array
    faces: NDArray[np.uint8]
    away: float

    def places(self, parts: Indices) -> Array:
        """Places (n, 3) beside parts (n,) of the faces of all edges: `away` from the edge, outside of that face."""
        edge, side, part = np.unravel_index(parts, (*self.inward.shape[:2], PARTS))
        start, end = (self.structure.edge_segments[edge, k] for k in range(2))
        beside = self.inward[edge, side] + self.structure.face_normals[self.structure.edge_faces[edge, side]]
        return np.asarray(start + ((part + 0.5) / PARTS)[:, None] * (end - start) + self.away * beside)


def shown_faces(beside: Beside, tree: Tree) -> NDArray[np.uint8]:
    """Bits of the faces that show beside each part of each edge (e, 3, PARTS), 0 where it is no edge of the surface.

    The second axis is the bits of the faces that face the camera, less one.
    """
    covered = are_covered(beside, tree)
    goes_on = (beside.faces[:, :, BEYOND] & SAME_WAY) > 0
    one_two = np.array([1, 2], dtype=np.uint8)[:, None]
    facing = np.arange(1, BOTH_FACES + 1, dtype=np.uint8)[:, None]
    seen = facing & ~(covered * one_two).sum(axis=1, dtype=np.uint8)[:, None]
    joint = (seen != BOTH_FACES) & ((seen & (goes_on * one_two).sum(axis=1, dtype=np.uint8)[:, None]) > 0)
    return np.where(joint, np.uint8(0), seen)


def are_covered(beside: Beside, tree: Tree) -> NDArray[np.bool_]:
    """Mask (e, 2, PARTS) of the parts beside which a face of an edge is covered, as where another part begins.

    The back of a sheet that is drawn from both sides covers nothing: beyond the face has to be inside. That is asked at
    both ends and in the middle of each run of parts, and at all of them where the answers differ.
    """
    covered = (beside.faces[:, :, WITHIN] & OPPOSITE) > 0
    apart = np.pad(covered.reshape(-1, PARTS), ((0, 0), (1, 1)))
    row, begin = np.nonzero(apart[:, 1:] & ~apart[:, :-1])
    end = np.nonzero(apart[:, :-1] & ~apart[:, 1:])[1]
    some = row[:, None] * PARTS + np.stack([begin, (begin + end - 1) // 2, end - 1], axis=1)
    inside = are_inside(tree, beside.places(some.ravel())).reshape(-1, 3).sum(axis=1)
    flat, asked = np.flatnonzero(covered), np.repeat(inside, end - begin)
    of_run = asked == some.shape[1]
    mixed = (asked > 0) & ~of_run
    of_run[mixed] = are_inside(tree, beside.places(flat[mixed]))
    covered.ravel()[flat] = of_run
    return covered
