"""An OBJ file is the same model however its lines are written."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from uavbench.scenes.model_files.mesh_file import MeshFile
from uavbench.scenes.model_files.model_reading import read
from uavbench.scenes.structure import Structure
from uavbench.trajectories.errors import UserError

OUTLINE = [(0, 0), (3, 0), (3, 1), (1, 1), (1, 2), (0, 2)]
"""An L, whose two caps are concave faces."""
FACES = [[5, 4, 3, 2, 1, 0], [6, 7, 8, 9, 10, 11], *[[k, (k + 1) % 6, (k + 1) % 6 + 6, k + 6] for k in range(6)]]


def block(shift: int, first: int) -> str:
    """An L-shaped block; the indices of its faces begin at `first`."""
    points = [(x + shift, y, z) for z in (0, 1.5) for x, y in OUTLINE]
    lines = [f"v {x} {y} {z}" for x, y, z in points]
    lines += ["f " + " ".join(str(k + first) for k in face) for face in FACES]
    return "\n".join([f"o block{shift}", *lines]) + "\n"


TWO = block(0, 1) + block(10, 13)


def structure(path: Path, data: str) -> Structure:
    path.write_bytes(data.encode())
    return MeshFile(path=str(path)).build(np.random.default_rng(0)).structure


def continued(text: str) -> str:
    """Each face of six corners over two lines, broken without a blank."""
    return "\n".join(
        line.replace(" ", "\\\n", 4).replace("\\\n", " ", 3) if line.startswith("f ") and line.count(" ") == 6 else line
        for line in text.splitlines()
    )


@pytest.mark.parametrize(
    "change",
    [
        lambda text: block(0, -12) + block(10, -12),
        lambda text: (block(0, -12) + block(10, -12)).replace("\n", "\nvn 0 0 1\n").replace("f ", "f\t"),
        continued,
        lambda text: continued(text).replace("\n", "\r\n"),
        lambda text: text.replace("\n", "\r"),
        lambda text: text.replace(" ", "\t"),
        lambda text: text.replace("\n", "\n  \t"),
        lambda text: text.replace("\n", " # v 1 2 3, f 1 2 -3\n"),
        lambda text: "# C:\\models\\\n" + continued(text),
    ],
    ids=["from-the-last", "tabs-from-the-last", "continued", "crlf", "cr", "tabs", "indents", "remarks", "folder"],
)
def test_a_model_is_the_same_however_its_lines_are_written(tmp_path: Path, change: Callable[[str], str]) -> None:
    plain, other = structure(tmp_path / "plain.obj", TWO), structure(tmp_path / "other.obj", change(TWO))
    assert np.ptp(other.vertices[:, 0]) == pytest.approx(13.0) and len(other.edges) == 36
    np.testing.assert_array_equal(other.vertices, plain.vertices)
    np.testing.assert_array_equal(other.triangles, plain.triangles)


def test_a_face_that_counts_back_too_far_is_told_with_its_line(tmp_path: Path) -> None:
    (tmp_path / "short.obj").write_text("v 0 0 0\nv 1 0 0 \\\n\nv 0 1 0\nf -1 -2 -3\nf -1 -2 -4\n")
    with pytest.raises(UserError, match=r"short.obj: line 6: a face refers to a missing vertex, -4; export the model"):
        read(tmp_path / "short.obj")


@pytest.mark.parametrize(
    "change",
    [
        lambda _: block(0, 0),
        lambda text: text + "f 1 2 0\n",
        lambda text: text.replace("f ", "f\t") + "f\t0/1/1 1/1/1 2/1/1\n",
        lambda text: text + "f 1//1 2//1 00//1\n",
    ],
    ids=["all", "last", "tabs", "with-normals"],
)
def test_faces_that_count_from_zero_are_told_with_their_line(tmp_path: Path, change: Callable[[str], str]) -> None:
    """Zero had been taken for the last vertex: the model was closed, and had another shape."""
    text = change(TWO)
    (tmp_path / "zero.obj").write_text(text)
    row = next(k for k, line in enumerate(text.splitlines(), 1) if line.startswith("f") and " 0" in f" {line[2:]}")
    with pytest.raises(UserError, match=rf"zero.obj: line {row}: a face refers to vertex 0, and OBJ counts from 1"):
        read(tmp_path / "zero.obj")


def test_a_long_line_beside_a_continued_one_is_read_at_once(tmp_path: Path) -> None:
    """The time is proportional to its length, not to the square."""
    text = continued(TWO) + "# " + "x" * 1_000_000 + "\n"
    assert len(structure(tmp_path / "long.obj", text).edges) == 36


@pytest.mark.parametrize("forms", [("{0}/1", "{0}"), ("{0}//1", "{0}"), ("{0}/1/1", "{0}/1")])
def test_faces_of_many_corners_are_those_of_a_file_with_one_form(tmp_path: Path, forms: tuple[str, str]) -> None:
    """Six corners had been taken for the three of `1/1 2/1 3/1`, and twelve numbers for quads with all three."""
    angles = np.arange(6) * np.pi / 3
    points = [(np.cos(a), np.sin(a), z) for z in (0.0, 1.0) for a in angles]
    sides = [[k, (k + 1) % 6, (k + 1) % 6 + 6, k + 6] for k in range(6)]
    sides = [half for a, b, c, d in sides for half in ((a, b, c), (a, c, d))] if "/1/1" not in forms[0] else sides
    faces = [(side, forms[0]) for side in sides] + [([5, 4, 3, 2, 1, 0], forms[1]), ([6, 7, 8, 9, 10, 11], forms[1])]
    lines = [f"v {x} {y} {z}" for x, y, z in points] + ["vt 0 0", "vn 0 0 1"]
    mixed = [*lines, *("f " + " ".join(form.format(k + 1) for k in face) for face, form in faces)]
    plain = [*lines, *("f " + " ".join(str(k + 1) for k in face) for face, _ in faces)]
    found, expected = (structure(tmp_path / f"{len(text)}.obj", "\n".join(text)) for text in (mixed, ["", *plain]))
    assert len(found.edges) == len(expected.edges) == 18
    np.testing.assert_allclose(*(np.unique(each.vertices.round(9), axis=0) for each in (found, expected)))
