"""The model of a sequence on disk: a mesh in groups of planar faces, and its true edges."""

from pathlib import Path

import numpy as np

from uavbench.scenes.dataset.table_files import read_integers
from uavbench.scenes.structure import Structure
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.limits import MODEL
from uavbench.trajectories.files.reading import read_text
from uavbench.trajectories.files.writing import write_text


def save_structure(structure: Structure, folder: Path) -> None:
    """Write `model.obj` and `edges.csv`; numbers round-trip exactly."""
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in structure.vertices.tolist()]
    for face in range(len(structure.face_normals)):
        lines.append(f"g face_{face}")
        rows = structure.triangles[structure.triangle_face == face] + 1
        lines += [f"f {a} {b} {c}" for a, b, c in rows.tolist()]
    write_text(folder / "model.obj", "\n".join(lines) + "\n")
    table = np.column_stack([structure.edges, structure.edge_faces]).tolist()
    write_text(folder / "edges.csv", "vertex_0,vertex_1,face_0,face_1\n" + _csv_rows(table))


def load_structure(folder: Path) -> Structure:
    """Read the files of `save_structure`; UserError naming the file and line of an error."""
    path = folder / "model.obj"
    lines = read_text(path, MODEL, inside=folder).splitlines()
    vertices: list[list[float]] = []
    triangles: list[list[int]] = []
    triangle_face: list[int] = []
    face = -1
    try:
        for number, line in enumerate(lines, start=1):
            match line.split():
                case ["v", x, y, z]:
                    vertices.append([float(x), float(y), float(z)])
                case ["g", _]:
                    face += 1
                case ["f", a, b, c]:
                    triangles.append([int(a) - 1, int(b) - 1, int(c) - 1])
                    triangle_face.append(face)
                case _:
                    raise UserError(f"{path}: line {number} is not valid in the model of a sequence")
    except ValueError as error:
        raise UserError(f"{path}: line {number}: {error}") from None
    edges = read_integers(folder / "edges.csv", ["vertex_0", "vertex_1", "face_0", "face_1"])
    points = np.array(vertices).reshape(-1, 3)
    if not (triangles and np.isfinite(points).all() and min(triangle_face) >= 0):
        raise UserError(f"{path}: needs finite vertices, and triangles in groups `g`")
    if not all(0 <= corner < len(points) for triangle in triangles for corner in triangle):
        raise UserError(f"{path}: a triangle refers to a missing vertex")
    if not ((edges >= [0, 0, -1, -1]) & (edges < [len(points), len(points), face + 1, face + 1])).all():
        raise UserError(f"{folder / 'edges.csv'}: an edge refers to a missing vertex or face")
    corners, owner = np.array(triangles, dtype=np.int64), np.array(triangle_face)
    p, q, r = (points[corners[:, k]] for k in range(3))
    normals = np.zeros((face + 1, 3))
    np.add.at(normals, owner, np.cross(q - p, r - p))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return Structure(points, corners, owner, normals, edges[:, :2], edges[:, 2:])


def _csv_rows(rows: list[list[int]]) -> str:
    return "".join(",".join(map(str, row)) + "\n" for row in rows)
