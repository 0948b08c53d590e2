"""Faces of an OBJ file as triangles where its reader errs: it cuts concave ones into a fan, and may mistake large ones.

It takes the numbers of all lines for those of the first if each has as many: `1 2 3 4 5 6` for the `1/2 3/4 5/6` of a
triangle with texture coordinates. Faces of up to five corners have another number each way.
"""

from collections import defaultdict
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np

from uavbench.scenes.model_files.face_limits import FaceWork
from uavbench.scenes.model_files.polygons.concave import concave, cut
from uavbench.trajectories.pose import Array

UNMISTAKABLE = 5
"""Corners of a face up to which the count of its numbers tells how many there are, and how many numbers each has."""


class Face(NamedTuple):
    """A face of more than three corners: the row of its line, the words of its corners, and their vertices."""

    row: int
    words: list[bytes]
    vertices: list[int]


def with_triangles(path: Path, data: bytes) -> bytes:
    """An OBJ file's content, its concave and mistakable faces as triangles; UserError for no simple polygon.

    Faces of vertices that the file does not have, or that are not numbers, are left to its reader.
    """
    lines = data.splitlines()
    polygons = list(_faces(lines))
    points = _points(lines) if polygons else np.zeros((0, 3))
    faces = [polygons[number] for number in concave(points, [face.vertices for face in polygons])]
    fans = list(_mistakable(lines, polygons))
    if not faces and not fans:
        return data
    for face in fans:
        first, *others = face.words
        lines[face.row] = b"\n".join(b"f " + b" ".join([first, *pair]) for pair in pairwise(others))
    FaceWork(path).add(len(face.words) for face in faces)
    for face in faces:
        triangles = cut(path, f"line {face.row + 1}", points[face.vertices])
        lines[face.row] = b"\n".join(b"f " + b" ".join(face.words[k] for k in corners) for corners in triangles)
    return b"\n".join(lines) + b"\n"


def _mistakable(lines: list[bytes], polygons: list[Face]) -> Iterator[Face]:
    """The faces of which another face has as many numbers, of other corners."""
    large = [face for face in polygons if len(face.words) > UNMISTAKABLE]
    if not large:
        return
    corners: dict[int, set[int]] = defaultdict(set)
    for line in lines:
        if line.startswith(b"f "):
            words = line.partition(b"#")[0].split()[1:]
            corners[_numbers(words)].add(len(words))
    yield from (face for face in large if len(corners[_numbers(face.words)]) > 1)


def _numbers(words: list[bytes]) -> int:
    return len(b" ".join(words).replace(b"/", b" ").split())


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
