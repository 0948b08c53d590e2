"""CAO models as they are written: the polygons of the planar faces."""

import numpy as np
import pytest

from scenes.box import Box
from scenes.building import Building
from scenes.cao import face_polygon, read_cao, write_cao
from scenes.structure import Structure
from scenes.truss import Truss


def area(vertices, triangles):
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    return np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2


@pytest.mark.parametrize("kind", [Box, Truss])
def test_what_is_written_is_read_back(kind, tmp_path):
    structure = kind().build(np.random.default_rng(0)).structure
    write_cao(structure, tmp_path / "model.cao")
    read = read_cao(tmp_path / "model.cao")
    again = Structure.from_mesh(read.vertices, read.triangles)
    assert len(again.face_normals) == len(structure.face_normals)
    assert len(again.edges) == len(structure.edges)
    assert area(read.vertices, read.triangles) == pytest.approx(area(structure.vertices, structure.triangles))


def test_a_face_has_its_corners_only_and_turns_outward():
    """An L of five triangles and a vertex amid one of its sides."""
    points = np.array([[0, 0], [1, 0], [2, 0], [2, 1], [1, 1], [1, 2], [0, 2]], dtype=float)
    vertices = np.column_stack([points, np.zeros(7)])
    triangles = np.array([[0, 1, 4], [1, 2, 3], [1, 3, 4], [0, 4, 5], [0, 5, 6]])
    structure = Structure.from_mesh(vertices, triangles)
    polygon = structure.vertices[face_polygon(structure, 0)]
    assert len(polygon) == 6
    assert [1.0, 0.0, 0.0] not in polygon.tolist()
    turned = np.cross(polygon, np.roll(polygon, -1, axis=0)).sum(axis=0) / 2
    assert turned == pytest.approx(3.0 * structure.face_normals[0])


def test_an_opening_is_left_to_the_faces_in_it():
    """A facade with windows is one polygon of its outer border."""
    structure = Building().build(np.random.default_rng(0)).structure
    sizes = [len(face_polygon(structure, face)) for face in range(len(structure.face_normals))]
    largest = np.bincount(structure.triangle_face).argmax()
    assert sizes[largest] <= 8
    assert min(sizes) >= 3
