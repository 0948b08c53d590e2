"""The structure as arrays for the kernels: edges, faces, and a tree of triangles for hidden-line removal."""

from dataclasses import replace
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.scenes.structure import COPLANAR_ANGLE_DEG, Structure, components
from uavbench.tracker.robust.edges.beside.contact_kernels import BESIDE_EDGE, faces_beside
from uavbench.tracker.robust.edges.beside.inward_kernels import into_faces
from uavbench.tracker.robust.edges.beside.shown import Beside, shown_faces
from uavbench.tracker.robust.edges.groups import GROUPS, Groups
from uavbench.tracker.robust.edges.hidden_line_kernels import NONE, TRIANGLES, Triangles
from uavbench.tracker.robust.row_numbers import row_numbers
from uavbench.trajectories.geometry.bvh import build_tree
from uavbench.trajectories.kernels.argument_types import named_tuple
from uavbench.trajectories.pose import Array

Indices = NDArray[np.int64]


class EdgeMap(NamedTuple):
    """Arrays of a structure.

    ends (e, 2, 3); faces (e, 2), -1 for none; inward (e, 2, 3) unit vectors from an edge into each of its faces, 0 for
    none; planes (f, 4) with outward normal n and offset d, n . p = d on the face; triangles for hidden-line removal;
    extent (8, 3) the corners of the bounding box; smooth (e,) whether both faces belong to one rounded surface, so that
    the edge is visible only as part of the outline; rounded (e,) whether it lies within or at the border of such a
    surface; shown (e, 3, PARTS) the faces that show beside each part, see `shown_faces`; in_front (e,) the triangle
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
            shown_faces(Beside(structure, inward, beside, BESIDE_EDGE * size), tree),
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
    pairs = np.concatenate([structure.edge_faces, every.edge_faces])
    numbers = row_numbers(np.sort(pairs, axis=1))
    known, faces = np.split(numbers, [len(structure.edges)])
    new = _smooth(every, rounded_deg) & ~np.isin(faces, known)
    if not new.any():
        return structure
    edges = np.concatenate([structure.edges, every.edges[new]])
    return replace(structure, edges=edges, edge_faces=np.concatenate([structure.edge_faces, every.edge_faces[new]]))


def members_of(ends: Array) -> Indices:
    """The member (e,) that each edge with its ends (e, 2, 3) is of: edges that meet at a vertex are of the same one.

    A window in a wall is one, and so is the wall about it. Parts of a structure that stand beside each other are.
    """
    vertices = row_numbers((ends + 0.0).reshape(-1, 3).view(np.int64))  # no number is a negative zero
    _, vertex = np.unique(vertices, return_inverse=True)
    one, two = vertex.reshape(-1, 2).T
    return np.asarray(components(len(ends) * 2, one, two)[one])


def _smooth(structure: Structure, rounded_deg: float) -> NDArray[np.bool_]:
    """Mask (e,) of the edges whose faces meet at an angle below rounded_deg."""
    one, two = structure.edge_faces.T
    turn = np.einsum("ij,ij->i", structure.face_normals[one], structure.face_normals[two])
    return np.asarray((one >= 0) & (two >= 0) & (turn > np.cos(np.radians(rounded_deg))))


def _rounded(structure: Structure, rounded_deg: float) -> NDArray[np.bool_]:
    """Mask (e,) of the edges adjacent to a face of a rounded surface."""
    faces = np.unique(structure.edge_faces[_smooth(structure, rounded_deg)])
    return np.asarray(np.isin(structure.edge_faces, faces[faces >= 0]).any(axis=1))
