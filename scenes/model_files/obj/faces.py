"""Concave faces of an OBJ file as triangles: its reader cuts every face into a fan, which is right for convex ones."""

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from uavbench.scenes.model_files.face_limits import FaceWork
from uavbench.scenes.model_files.polygons.concave import concave, cut
from uavbench.trajectories.pose import Array


class Face(NamedTuple):
    """A face of more than three corners: the row of its line, the words of its corners, and their vertices."""

    row: int
    words: list[bytes]
    vertices: list[int]


def with_triangles(path: Path, data: bytes) -> bytes:
    """An OBJ file's content, its concave faces as triangles; UserError for one that is not a simple polygon.

    Faces of vertices that the file does not have, or that are not numbers, are left to its reader.
    """
    lines = data.splitlines()
    polygons = list(_faces(lines))
    points = _points(lines) if polygons else np.zeros((0, 3))
    faces = [polygons[number] for number in concave(points, [face.vertices for face in polygons])]
    if not faces:
        return data
    FaceWork(path).add(len(face.words) for face in faces)
    for face in faces:
        triangles = cut(path, f"line {face.row + 1}", points[face.vertices])
        lines[face.row] = b"\n".join(b"f " + b" ".join(face.words[k] for k in corners) for corners in triangles)
    return b"\n".join(lines) + b"\n"


def _points(lines: list[bytes]) -> Array:
    """The vertices (n, 3), NaN where a line has no three numbers."""
    out: list[list[float]] = []
    for line in lines:
        if line.startswith(b"v "):
            try:
                x, y, z = map(float, line.split()[1:4])
            except ValueError:
                x = y = z = float("nan")
            out.append([x, y, z])
    return np.array(out, dtype=np.float64).reshape(-1, 3)


def _faces(lines: list[bytes]) -> Iterator[Face]:
    """The faces of more than three corners whose vertices are numbers, of which negative ones count from the last."""
    seen = 0
    for row, line in enumerate(lines):
        if line.startswith(b"v "):
            seen += 1
        elif line.startswith(b"f "):
            words = line.partition(b"#")[0].split()[1:]
            if len(words) > 3:
                try:
                    numbers = [int(word.partition(b"/")[0]) for word in words]
                except ValueError:
                    continue
                yield Face(row, words, [k - 1 if k > 0 else seen + k for k in numbers])
