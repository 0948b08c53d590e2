"""Writer of ViSP's CAO models: one polygon per planar face of a structure, without the triangulation."""

from pathlib import Path

import numpy as np

from uavbench.scenes.structure import Structure
from uavbench.trajectories.files.writing import write_text
from uavbench.trajectories.pose import Array

STRAIGHT = 1e-6
"""Sine of the angle below which two consecutive sides of a polygon are collinear."""


def write_cao(structure: Structure, path: Path) -> None:
    """Write the outer boundary of each planar face, counter-clockwise from outside, in metres; holes are filled."""
    polygons = [p for face in range(len(structure.face_normals)) if (p := face_polygon(structure, face))]
    used = sorted({corner for polygon in polygons for corner in polygon})
    number = {corner: k for k, corner in enumerate(used)}
    lines = ["V1", str(len(used)), *(" ".join(map(repr, structure.vertices[k].tolist())) for k in used), "0", "0"]
    lines.append(str(len(polygons)))
    lines += [" ".join(map(str, [len(polygon), *(number[k] for k in polygon)])) for polygon in polygons]
    write_text(path, "\n".join([*lines, "0", "0"]) + "\n")


def face_polygon(structure: Structure, face: int) -> list[int]:
    """Vertex indices of the outer boundary of a planar face, corners only, counter-clockwise from outside."""
    triangles = structure.triangles[structure.triangle_face == face].tolist()
    sides = {(t[k], t[(k + 1) % 3]) for t in triangles for k in range(3)}
    follows: dict[int, list[int]] = {}
    for a, b in sorted(sides):
        if (b, a) not in sides:
            follows.setdefault(a, []).append(b)
    borders: list[list[int]] = []
    while follows:
        border = [min(follows)]
        while border[-1] in follows:
            ends = follows[border[-1]]
            border.append(ends.pop())
            if not ends:
                del follows[border[-2]]
        borders.append(border[:-1])
    at, normal = structure.vertices, structure.face_normals[face]
    return _corners(at, max(borders, key=lambda border: _area(at[border], normal), default=[]))


def _area(polygon: Array, normal: Array) -> float:
    """Signed area of a planar polygon (n, 3) about a normal (3,); negative for clockwise ones, such as holes."""
    return float(np.cross(polygon, np.roll(polygon, -1, axis=0)).sum(axis=0) @ normal / 2)


def _corners(at: Array, polygon: list[int]) -> list[int]:
    """The polygon without collinear vertices."""
    side = at[np.roll(polygon, -1)] - at[polygon] if polygon else np.zeros((0, 3))
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    turn = np.linalg.norm(np.cross(np.roll(side, 1, axis=0), side), axis=1)
    return [vertex for vertex, sine in zip(polygon, turn.tolist(), strict=True) if sine > STRAIGHT]
