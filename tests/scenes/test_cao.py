"""CAO models as they are written: the polygons of the planar faces."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from uavbench.scenes.model_files.cao.reading import read_cao
from uavbench.scenes.model_files.cao.writing import face_polygon, write_cao
from uavbench.scenes.model_files.referenced_files import parts_of
from uavbench.scenes.structure import Structure
from uavbench.scenes.structures.box import Box
from uavbench.scenes.structures.building import Building
from uavbench.scenes.structures.truss import Truss
from uavbench.trajectories.errors import UserError


def area(vertices, triangles):
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    return np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2


@pytest.mark.parametrize("kind", [Box, Truss])
def test_what_is_written_is_read_back(kind, tmp_path):
    structure = kind().unpainted().structure
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
    structure = Building().unpainted().structure
    sizes = [len(face_polygon(structure, face)) for face in range(len(structure.face_normals))]
    largest = np.bincount(structure.triangle_face).argmax()
    assert sizes[largest] <= 8
    assert min(sizes) >= 3


ROUND_CAO = """V1
4
0 0 0
0 0 2 # the axis
1 0 2
0 1 2
0
0
0
1
0 1 0.5 name="tower"
{circles}
"""


@pytest.mark.parametrize("circles", ["0", "1\n0.5 1 2 3"])
def test_a_cylinder_is_closed_and_a_circle_at_its_end_is_nothing_new(circles, tmp_path):
    (tmp_path / "tower.cao").write_text(ROUND_CAO.format(circles=circles))
    read = read_cao(tmp_path / "tower.cao")
    a, b, c = (read.vertices[read.triangles[:, k]] for k in range(3))
    assert np.einsum("ij,ij->", a, np.cross(b, c)) / 6 == pytest.approx(np.pi * 0.25 * 2, rel=0.01)
    structure = Structure.from_mesh(read.vertices, read.triangles)
    assert (structure.edge_faces >= 0).all()
    assert structure.bounds[:, 2].tolist() == [0, 2]


def test_a_circle_that_ends_nothing_is_a_disc(tmp_path):
    (tmp_path / "disc.cao").write_text(ROUND_CAO.format(circles="1\n0.8 0 2 3"))
    read = read_cao(tmp_path / "disc.cao")
    assert area(read.vertices, read.triangles) == pytest.approx(np.pi * (2 * 0.25 + 2 * 0.5 * 2 + 0.64), rel=0.01)


def test_a_model_may_load_others(tmp_path):
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "tower.cao").write_text(ROUND_CAO.format(circles="0"))
    write_cao(Box().unpainted().structure, tmp_path / "parts" / "box.cao")
    text = 'V1\nload("parts/tower.cao")\nload("parts/box.cao")\n0\n0\n0\n0\n0\n0\n'
    (tmp_path / "all.cao").write_text(text)
    parts = [read_cao(tmp_path / "parts" / name) for name in ("tower.cao", "box.cao")]
    assert set(parts_of(tmp_path / "all.cao")) == {tmp_path / "parts" / "tower.cao", tmp_path / "parts" / "box.cao"}
    read = read_cao(tmp_path / "all.cao")
    assert len(read.triangles) == sum(len(part.triangles) for part in parts)
    assert area(read.vertices, read.triangles) == pytest.approx(sum(area(p.vertices, p.triangles) for p in parts))


def test_a_load_places_its_model_as_visp_does(tmp_path):
    """A row of bricks that loads a brick, placed by a model that loads the row: exp(tu) p + t, twice."""
    brick = Box().unpainted().structure
    write_cao(brick, tmp_path / "brick.cao")
    (tmp_path / "row.cao").write_text('V1\nload("brick.cao")\nload("brick.cao", t=[1; 0; 0], tu=[0; 0; 90 deg])\n')
    outer = 'load("row.cao", tu=[0.3; -0.2 rad; 0.5], t=[0.1;0.2;0.3])  # placed'
    (tmp_path / "all.cao").write_text(f"V1\n{outer}\n0\n0\n0\n0\n0\n0\n")
    one = read_cao(tmp_path / "brick.cao")
    alone = one.vertices
    tu, t = Rotation.from_rotvec([0.3, -0.2, 0.5]), [0.1, 0.2, 0.3]
    turned = Rotation.from_euler("z", 90, degrees=True).apply(alone) + np.array([1, 0, 0])
    expected = tu.apply(np.concatenate([alone, turned])) + t
    read = read_cao(tmp_path / "all.cao")
    np.testing.assert_allclose(read.vertices, expected, atol=1e-12)
    assert area(read.vertices, read.triangles) == pytest.approx(2 * area(alone, one.triangles))
    by_matrix = 'V1\nload("brick.cao", t=[1; 0; 0], R=[0; -1; 0; 1; 0; 0; 0; 0; 1])\n'
    (tmp_path / "matrix.cao").write_text(by_matrix)
    np.testing.assert_allclose(read_cao(tmp_path / "matrix.cao").vertices, turned, atol=1e-12)


def test_a_placed_cylinder_keeps_its_shape(tmp_path):
    (tmp_path / "tower.cao").write_text(ROUND_CAO.format(circles="0"))
    (tmp_path / "placed.cao").write_text('V1\nload("tower.cao", t=[5; 0; 0], tu=[0; 90deg; 0])\n')
    placed = read_cao(tmp_path / "placed.cao")
    structure = Structure.from_mesh(placed.vertices, placed.triangles)
    np.testing.assert_allclose(structure.bounds, [[5, -0.5, -0.5], [7, 0.5, 0.5]], atol=1e-9)


OF_LINES = """V1
4
0 0 0
1 0 0
1 1 0
0 1 0
4
0 1 name="a long side" minLineLengthThreshold=50
1 2
2 3
3 0
1
4 0 1 2 3 name="the front, below the roof" useLod=true
0
0
0
"""


def test_names_may_have_spaces_as_in_visp(tmp_path):
    (tmp_path / "front.cao").write_text(OF_LINES)
    read = read_cao(tmp_path / "front.cao")
    assert area(read.vertices, read.triangles) == pytest.approx(1)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('V1\nload("a.cao", t=[0; 1])\n', r"line 2: t=\[0; 1\] has 2 numbers, expected 3"),
        ('V1\nload("a.cao", t=[0; 1; x])\n', "line 2: could not convert string to float"),
        ('V1\nload("a.cao", tu=[0; 1; 2 grad])\n', "line 2: could not convert string to float"),
        ('V1\nload("a.cao", t=[0; 1; nan])\n', "line 2: nan is not finite"),
        ('V1\nload("a.cao", t=[0; 1; 1_0])\n', "line 2: could not convert string to float: '1_0'"),
        ("V1\n3\n0 0 0\n1_0 0 0\n", "line 4: expected numbers for the points, got '1_0 0 0'"),
        ('V1\nload("a.cao", s=[0; 1; 1])\n', "line 2: unknown parameter 's' of load"),
        ('V1\nload("a.cao", R=[1; 0; 0; 0; 1; 0; 0; 0; -1])\n', "line 2: R is not a rotation"),
        ('V1\nload("a.cao", tu=[0; 0; 0], tu=[0; 0; 0])\n', "line 2: tu is given twice"),
        ('V1\nload("me.cao")\n', "line 2: me.cao loads itself"),
        ('V1\nload("none.cao")\n', "none.cao: no such file"),
        ('V1\nload("../none.cao")\n', "outside the model's folder"),
        ('V1\nload("a.cao", 0 0 1)\n', "line 2: expected load"),
        (ROUND_CAO.format(circles="1\n0.5 1 2"), "a circle a radius and three points"),
        (ROUND_CAO.format(circles="0").replace("0 1 0.5", "0 9 0.5"), "a cylinder takes two existing points"),
        (ROUND_CAO.format(circles="0").replace("0 1 0.5", "0 0 0.5"), "a cylinder needs a positive length"),
        (ROUND_CAO.format(circles="0").replace("0 1 0.5", "0 -1 0.5"), "a cylinder takes two existing points"),
        (ROUND_CAO.format(circles="1\n0.5 1 -2 3"), "a circle a radius and three points"),
        (OF_LINES.replace("2 3\n3 0\n", "2 3\n3 1\n"), "its lines are not connected"),
        (OF_LINES.replace("1 2\n", "0 2\n"), "its lines are not connected"),
    ],
)
def test_a_wrong_model_is_told(text, message, tmp_path):
    (tmp_path / "me.cao").write_text(text)
    with pytest.raises(UserError, match=message):
        read_cao(tmp_path / "me.cao")


FACE = "V1\n4\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n0\n0\n1\n4 0 1 2 3\n0\n0\n"


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("V1\n4", f"V1\n{count}") for count in ("inf", "nan", "3.5", "-1", "1e30", "1e400", "many", "4 x", "")
    ] + [
        ("4 0 1 2 3", face)
        for face in ("inf 0 1 2", "nan 0 1 2", "3.5 0 1 2 3", "-4 0 1 2 3", "4 0 1 2", "4 0 1 2 3.5", "4 0 1 2 -1",
                     "4 0 1 2 inf", "4 0 1 2 9", "2 0 1", "1e9 0 1 2 3", "name=x", "")
    ] + [
        ("1 0 0", point) for point in ("nan 0 0", "inf 0 0", "1e308 0 0", "1 0", "1 0 0x")
    ] + [
        ("0\n0\n1\n4", lines) for lines in ("1\n0.5 1\n0\n1\n4", "nan\n0\n1\n4", "1\n0 1\n1\n3 0 inf 1\n1\n4")
    ] + [
        ("3\n0\n0\n", end) for end in ("3\ninf\n0\n", "3\n1\nnan 1 0.5\n0\n", "3\n0\n1.5\n", "3\n0\n1\n0.5 0 1 inf\n")
    ],
)  # fmt: skip
def test_counts_indices_and_coordinates_that_are_none_are_told(old, new, tmp_path):
    (tmp_path / "a.cao").write_text(FACE)
    assert len(read_cao(tmp_path / "a.cao").triangles) == 2
    (tmp_path / "a.cao").write_text(FACE.replace(old, new))
    with pytest.raises(UserError, match=r"a\.cao: "):
        read_cao(tmp_path / "a.cao")


def test_doubled_loads_are_told_at_once(tmp_path):
    (tmp_path / "m0.cao").write_text(FACE)
    for k in range(1, 22):
        (tmp_path / f"m{k}.cao").write_text(f'V1\nload("m{k - 1}.cao")\nload("m{k - 1}.cao")\n0\n0\n0\n0\n0\n0\n')
    with pytest.raises(UserError, match=r"m\d+\.cao: line 3: its loads make a model of more than 1,000 pieces"):
        read_cao(tmp_path / "m21.cao")
    for k in range(1, 90):
        (tmp_path / f"m{k}.cao").write_text(f'V1\nload("m{k - 1}.cao")\n0\n0\n0\n0\n0\n0\n')
    with pytest.raises(UserError, match="64 levels"):
        read_cao(tmp_path / "m89.cao")


MANY = " ".join(map(str, range(1000)))
BOMBS = {
    "lines": ("V1\n" + "0\n" * 8_100_000, "more than 4,000,000 lines"),
    "lines of other separators": ("V1\n" + "\f" * 20_000, "line 2: beyond .* 16,384 characters"),
    "a long line": ("V1\n1\n" + "0 " * 10_000, "line 3: beyond .* 16,384 characters"),
    "cylinders": (ROUND_CAO.replace("1\n0 1", "10001\n0 1"), "cylinders .* not within 0 .. 10,000"),
    "circles": (ROUND_CAO.format(circles="10001"), "circles .* not within 0 .. 10,000"),
    "corners": ("V1\n1000\n" + "0 0 0\n" * 1000 + "0\n0\n6\n" + f"1000 {MANY}\n" * 6, "too many corners"),
    "faces": ("V1\n3\n" + "0 0 0\n" * 3 + "0\n0\n200001\n" + f"12{' 0 1 2' * 4}\n" * 200_001, "2,000,010 triangles"),
}


@pytest.mark.parametrize("what", BOMBS)
def test_what_would_take_all_memory_or_hours_is_refused_first(what, tmp_path):
    text, message = BOMBS[what]
    (tmp_path / "bomb.cao").write_text(text)
    with pytest.raises(UserError, match=message):
        read_cao(tmp_path / "bomb.cao")


def test_loads_of_many_cylinders_are_counted_together(tmp_path):
    many = "9000\n" + "0 1 0.5\n" * 9000
    text = ROUND_CAO.format(circles="0").replace('1\n0 1 0.5 name="tower"\n', many)
    (tmp_path / "part.cao").write_text(text)
    (tmp_path / "whole.cao").write_text("V1\n" + 'load("part.cao")\n' * 9)
    with pytest.raises(UserError, match=r"whole\.cao: .* triangles are more than the 2,000,000"):
        read_cao(tmp_path / "whole.cao")


def test_the_ends_of_many_cylinders_are_found_at_once(tmp_path):
    ends = "3\n0 1 0.5\n0 2 0.5\n0 3 0.5"
    text = ROUND_CAO.format(circles="2\n0.5 1 2 3\n0.9 1 2 3").replace('1\n0 1 0.5 name="tower"', ends)
    (tmp_path / "a.cao").write_text(text)
    (tmp_path / "b.cao").write_text(text.replace("2\n0.5 1 2 3\n", "1\n"))
    assert len(read_cao(tmp_path / "a.cao").triangles) == len(read_cao(tmp_path / "b.cao").triangles)
