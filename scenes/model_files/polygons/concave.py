"""Concave faces among those of a model, and their triangles.

A gable with a door, or a wall above an arch, is one face in what modelling programs write. Its fan reaches across the
opening: it hides what is behind, and has edges where there are none.
"""

from collections import defaultdict
from collections.abc import Iterator, Sequence
from itertools import compress
from pathlib import Path

import numpy as np

from uavbench.scenes.primitives.solids import polygon_triangles
from uavbench.scenes.structure import Indices
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.pose import Array

CONCAVE = 1e-6
"""Area of a fan's triangle against the sense of its face, as a fraction of the face's, below which it is rounding."""


def concave(points: Array, faces: Sequence[Sequence[int]]) -> list[int]:
    """Numbers of the faces, by their vertices, of which a triangle of the fan has the opposite sense of the face.

    Faces of vertices that are not among the points (n, 3) are left out.
    """
    by_count: dict[int, list[int]] = defaultdict(list)
    for number, face in enumerate(faces):
        if len(face) > 3 and 0 <= min(face) <= max(face) < len(points):
            by_count[len(face)].append(number)
    return sorted(number for alike in by_count.values() for number in _concave(points, faces, alike))


def _concave(points: Array, faces: Sequence[Sequence[int]], alike: list[int]) -> Iterator[int]:
    corners = points[np.array([faces[number] for number in alike])]
    with np.errstate(invalid="ignore", over="ignore"):
        fan = np.cross(corners[:, 1:-1] - corners[:, :1], corners[:, 2:] - corners[:, :1])
        whole = fan.sum(axis=1)
        part = np.einsum("mij,mj->mi", fan, whole).min(axis=1)
        yield from compress(alike, part < -CONCAVE * (whole * whole).sum(axis=1))


def cut(path: Path, where: str, corners: Array) -> Indices:
    """Triangles of a face by its corners (n, 3); UserError, told with its place, when it is not a simple polygon."""
    try:
        return polygon_triangles(corners)
    except ValueError:
        raise UserError(f"{path}: {where}: this face is not a simple polygon; export triangles") from None
