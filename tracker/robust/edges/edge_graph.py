"""The structure as arrays for the kernels: edges, faces, and a tree of triangles for hidden-line removal."""

from dataclasses import replace
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.scenes.structure import COPLANAR_ANGLE_DEG, Structure
from uavbench.tracker.robust.edges.beside.contact_kernels import (
    BESIDE_EDGE,
    BEYOND,
    OPPOSITE,
    PARTS,
    SAME_WAY,
    WITHIN,
    faces_beside,
)
from uavbench.tracker.robust.edges.beside.inward_kernels import into_faces
from uavbench.tracker.robust.edges.columns import BOTH_FACES
from uavbench.tracker.robust.edges.groups import GROUPS, Groups
from uavbench.tracker.robust.edges.hidden_line_kernels import NONE, TRIANGLES, Triangles
from uavbench.trajectories.geometry.bvh import Tree, build_tree
from uavbench.trajectories.geometry.rays import are_inside
from uavbench.trajectories.kernels.argument_types import named_tuple
from uavbench.trajectories.pose import Array

Indices = NDArray[np.int64]


class EdgeMap(NamedTuple):
    """Arrays of a structure.

    ends (e, 2, 3); faces (e, 2), -1 for none; inward (e, 2, 3) unit vectors from an edge into each of its faces, 0 for
    none; planes (f, 4) with outward normal n and offset d, n . p = d on the face; triangles for hidden-line removal;
    extent (8, 3) the corners of the bounding box; smooth (e,) whether both faces belong to one rounded surface, so that
    the edge is visible only as part of the outline; rounded (e,) whether it lies within or at the border of such a
    surface; shown (e, 3, PARTS) the faces that show beside each part, see `_shown`; in_front (e,) the triangle
    that last occluded a point of the edge, which is tried first: it saves time and changes nothing else; groups of
    edges, by which those out of view are passed over; in_last_view (1,) how many were not.
    """

    ends: Array
    faces: Indices
    inward: Array
    planes: Array
    triangles: Triangles
    extent: Array
    smooth: NDArray[np.bool_]
    rounded: NDArray[np.bool_]
    shown: NDArray[np.uint8]
    in_front: Indices
    groups: Groups
    in_last_view: Indices

    @classmethod
    def of(cls, structure: Structure, rounded_deg: float) -> "EdgeMap":
        """Edge map of a structure; faces at angles below rounded_deg belong to one rounded surface."""
        structure = with_silhouettes(structure, rounded_deg)
        corners = structure.vertices[structure.triangles]
        _, first = np.unique(structure.triangle_face, return_index=True)
        offsets = np.einsum("ij,ij->i", structure.face_normals, corners[first, 0])
        ends = np.array(structure.edge_segments, order="C")
        faces = np.array(structure.edge_faces, order="C")
        planes = np.column_stack([structure.face_normals, offsets])
        tree = build_tree(corners)
        triangles = Triangles.of(tree, structure.triangle_face)
        size = float(np.linalg.norm(np.diff(structure.bounds, axis=0)))
        inward = into_faces(ends, faces, triangles, size)
        beside = faces_beside(ends, faces, inward, planes, triangles, size)
        return cls(
            ends,
            faces,
            inward,
            planes,
            triangles,
            np.array(list(product(*structure.bounds.T))),
            _smooth(structure, rounded_deg),
            _rounded(structure, rounded_deg),
            _shown(structure, inward, beside, BESIDE_EDGE * size, tree),
            np.full(len(structure.edges), NONE),
            Groups.of(ends),
            np.array([len(ends)]),
        )

    @property
    def looked_at(self) -> int:
        """How many edges were not passed over at the last view."""
        return int(self.in_last_view[0])

    def directions(self, edges: Indices) -> Array:
        """Unit directions (n, 3) of edges, rows (n,)."""
        along = self.ends[edges, 1] - self.ends[edges, 0]
        return np.asarray(along / np.linalg.norm(along, axis=1, keepdims=True))


EDGE_MAP = named_tuple(
    EdgeMap, "f3! i2! f3! f2! triangles f2! b1! b1! u3! i1! groups i1!", triangles=TRIANGLES, groups=GROUPS
)


def with_silhouettes(structure: Structure, rounded_deg: float) -> Structure:
    """The structure with the edges within rounded surfaces added, which may be part of the outline."""
    every = Structure.from_mesh(structure.vertices, structure.triangles, COPLANAR_ANGLE_DEG)
    if not np.array_equal(every.triangle_face, structure.triangle_face):
        return structure
    known = {(a, b) for a, b in np.sort(structure.edge_faces, axis=1).tolist()}
    faces = np.sort(every.edge_faces, axis=1)
    new = _smooth(every, rounded_deg) & np.array([(a, b) not in known for a, b in faces.tolist()], dtype=np.bool_)
    if not new.any():
        return structure
    edges = np.concatenate([structure.edges, every.edges[new]])
    return replace(structure, edges=edges, edge_faces=np.concatenate([structure.edge_faces, every.edge_faces[new]]))


def _smooth(structure: Structure, rounded_deg: float) -> NDArray[np.bool_]:
    """Mask (e,) of the edges whose faces meet at an angle below rounded_deg."""
    one, two = structure.edge_faces.T
    turn = np.einsum("ij,ij->i", structure.face_normals[one], structure.face_normals[two])
    return np.asarray((one >= 0) & (two >= 0) & (turn > np.cos(np.radians(rounded_deg))))


def _rounded(structure: Structure, rounded_deg: float) -> NDArray[np.bool_]:
    """Mask (e,) of the edges adjacent to a face of a rounded surface."""
    faces = np.unique(structure.edge_faces[_smooth(structure, rounded_deg)])
    return np.asarray(np.isin(structure.edge_faces, faces[faces >= 0]).any(axis=1))


def _shown(
    structure: Structure, inward: Array, beside: NDArray[np.uint8], away: float, tree: Tree
) -> NDArray[np.uint8]:
    """Bits of the faces that show beside each part of each edge (e, 3, PARTS), 0 where it is no edge of the surface.

    The second axis is the bits of the faces that face the camera, less one. A face is covered where another part
    begins, inside of which a place `away` from both is: the back of a sheet that is drawn from both sides covers
    nothing.
    """
    covered = (beside[:, :, WITHIN] & OPPOSITE) > 0
    covered[covered] = are_inside(tree, _places_outside(structure, inward, away, np.argwhere(covered)))
    goes_on = (beside[:, :, BEYOND] & SAME_WAY) > 0
    one_two = np.array([1, 2], dtype=np.uint8)[:, None]
    facing = np.arange(1, BOTH_FACES + 1, dtype=np.uint8)[:, None]
    seen = facing & ~(covered * one_two).sum(axis=1, dtype=np.uint8)[:, None]
    joint = (seen != BOTH_FACES) & ((seen & (goes_on * one_two).sum(axis=1, dtype=np.uint8)[:, None]) > 0)
    return np.where(joint, np.uint8(0), seen)


def _places_outside(structure: Structure, inward: Array, away: float, parts: Indices) -> Array:
    """Places (n, 3) beside parts (n, 3) of edges: edge, face and part; `away` from it and outside of that face."""
    edge, side, part = parts.T
    start, end = structure.edge_segments[edge, 0], structure.edge_segments[edge, 1]
    beside = inward[edge, side] + structure.face_normals[structure.edge_faces[edge, side]]
    return np.asarray(start + ((part + 0.5) / PARTS)[:, None] * (end - start) + away * beside)
