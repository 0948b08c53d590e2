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
from uavbench.tracker.robust.edges.columns import BOTH_FACES
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
    that last occluded a point of the edge, which is tried first: it saves time and changes nothing else.
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

    @classmethod
    def of(cls, structure: Structure, rounded_deg: float) -> "EdgeMap":
        """Edge map of a structure; faces at angles below rounded_deg belong to one rounded surface."""
        structure = with_silhouettes(structure, rounded_deg)
        corners = structure.vertices[structure.triangles]
        _, first = np.unique(structure.triangle_face, return_index=True)
        offsets = np.einsum("ij,ij->i", structure.face_normals, corners[first, 0])
        ends = np.array(structure.edge_segments, order="C")
        faces = np.array(structure.edge_faces, order="C")
        inward = _inward(structure, corners)
        planes = np.column_stack([structure.face_normals, offsets])
        tree = build_tree(corners)
        triangles = Triangles.of(tree, structure.triangle_face)
        size = float(np.linalg.norm(np.diff(structure.bounds, axis=0)))
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
            _shown(beside, _places_outside(structure, inward, BESIDE_EDGE * size), tree),
            np.full(len(structure.edges), NONE),
        )

    def directions(self, edges: Indices) -> Array:
        """Unit directions (n, 3) of edges, rows (n,)."""
        along = self.ends[edges, 1] - self.ends[edges, 0]
        return np.asarray(along / np.linalg.norm(along, axis=1, keepdims=True))


EDGE_MAP = named_tuple(EdgeMap, "f3! i2! f3! f2! triangles f2! b1! b1! u3! i1!", triangles=TRIANGLES)


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


def _inward(structure: Structure, corners: Array) -> Array:
    """Unit vectors (e, 2, 3) perpendicular to each edge, into the adjacent triangle of either face."""
    out = np.zeros((len(structure.edges), 2, 3))
    by_face = np.argsort(structure.triangle_face, kind="stable")
    bounds = np.searchsorted(structure.triangle_face[by_face], np.arange(len(structure.face_normals) + 1))
    for row, (ends, faces) in enumerate(zip(structure.edge_segments, structure.edge_faces.tolist(), strict=True)):
        length = np.linalg.norm(ends[1] - ends[0])
        along = (ends[1] - ends[0]) / length
        middle = ends[0] + 0.4567 * (ends[1] - ends[0])  # not at a vertex of a regular mesh
        for side, face in enumerate(faces):
            if face < 0:
                continue
            triangles = corners[by_face[bounds[face] : bounds[face + 1]]]
            best = triangles[np.argmin(_distance_to_sides(middle, triangles))]
            into = best.mean(axis=0) - middle
            into -= along * (into @ along)
            out[row, side] = into / max(float(np.linalg.norm(into)), 1e-12)
    return out


def _distance_to_sides(point: Array, triangles: Array) -> Array:
    """Distance (m,) of a point to the nearest side of each triangle (m, 3, 3)."""
    start, side = triangles, np.roll(triangles, -1, axis=1) - triangles
    part = np.clip(np.einsum("mij,mij->mi", point - start, side) / np.einsum("mij,mij->mi", side, side), 0, 1)
    return np.asarray(np.linalg.norm(point - start - part[..., None] * side, axis=2).min(axis=1))


def _places_outside(structure: Structure, inward: Array, away: float) -> Array:
    """Places (e, 2, PARTS, 3) beside each part of each edge, `away` from it and outside of either face."""
    part = ((np.arange(PARTS) + 0.5) / PARTS)[:, None]
    start, end = structure.edge_segments[:, :1], structure.edge_segments[:, 1:]
    beside = inward + structure.face_normals[structure.edge_faces]
    return np.asarray((start + part * (end - start))[:, None] + away * beside[:, :, None])


def _shown(beside: NDArray[np.uint8], outside: Array, tree: Tree) -> NDArray[np.uint8]:
    """Bits of the faces that show beside each part of each edge (e, 3, PARTS), 0 where it is no edge of the surface.

    The second axis is the bits of the faces that face the camera, less one. A face is covered where another part
    begins: the back of a sheet that is drawn from both sides covers nothing.
    """
    covered = (beside[:, :, WITHIN] & OPPOSITE) > 0
    covered[covered] = are_inside(tree, outside[covered])
    goes_on = (beside[:, :, BEYOND] & SAME_WAY) > 0
    one_two = np.array([1, 2])[:, None]
    facing = np.arange(1, BOTH_FACES + 1)[:, None]
    seen = facing & ~(covered * one_two).sum(axis=1)[:, None]
    joint = (seen != BOTH_FACES) & ((seen & (goes_on * one_two).sum(axis=1)[:, None]) > 0)
    return np.where(joint, 0, seen).astype(np.uint8)
