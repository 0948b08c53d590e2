"""The triangles of a PLY file with concave faces, from its faces as they are in the file."""

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from uavbench.scenes.model_files.face_limits import FaceWork
from uavbench.scenes.model_files.polygons.concave import concave, cut
from uavbench.scenes.structure import Indices
from uavbench.trajectories.errors import UserError

VERTICES_OF_A_FACE = ("vertex_index", "vertex_indices")
"""Names of the list of a face in PLY files."""


def triangles_of(path: Path, mesh: Any) -> Indices:
    """Triangles (n, 3) of the mesh that trimesh has read from a file: its own, unless a face of a PLY file is concave.

    UserError for a concave face that is not a simple polygon, or of a file whose texture parts the vertices.
    """
    fans = np.array(mesh.faces, dtype=np.int64)
    raw = mesh.metadata.get("_ply_raw")
    faces = [] if raw is None else _polygons(raw.get("face", {}).get("data"))
    if not faces:
        return fans
    points = np.column_stack([raw["vertex"]["data"][axis] for axis in "xyz"]).astype(np.float64)
    found = set(concave(points, faces))
    if not found:
        return fans
    if len(points) != len(mesh.vertices) or len(fans) != sum(max(len(face) - 2, 0) for face in faces):
        raise UserError(f"{path}: has concave faces, which cannot be read together with its texture; export triangles")
    FaceWork(path).add(len(faces[number]) for number in found)
    return np.concatenate([
        np.array(face)[cut(path, f"face {number + 1}", points[face])] if number in found else fan(face)
        for number, face in enumerate(faces)
    ])  # fmt: skip


def fan(face: list[int]) -> Indices:
    """Triangles (n - 2, 3) of a convex face by its n vertices; none of fewer than three."""
    return np.array([(face[0], *pair) for pair in pairwise(face[1:])], dtype=np.int64).reshape(-1, 3)


def _polygons(found: Any) -> list[list[int]]:
    """Faces by their vertices, of what trimesh holds of them; none where all are triangles."""
    names = tuple(found) if isinstance(found, dict) else getattr(getattr(found, "dtype", None), "names", None) or ()
    for name in names:
        if name in VERTICES_OF_A_FACE or len(names) == 1:
            lists = found[name]
            found = lists["f1"] if getattr(lists.dtype, "names", None) else lists
            break
    if found is None or isinstance(found, dict) or (found.ndim == 2 and found.shape[1] <= 3):
        return []
    return [np.asarray(face, dtype=np.int64).tolist() for face in found]
