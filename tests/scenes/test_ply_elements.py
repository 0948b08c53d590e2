"""A PLY file is the same model in text and in binary form, whatever its faces and further properties are."""

import struct
from pathlib import Path

import numpy as np
import pytest

from uavbench.scenes.model_files.mesh_file import MeshFile
from uavbench.scenes.model_files.model_reading import read
from uavbench.scenes.structure import Structure
from uavbench.trajectories.errors import UserError

OUTLINE = [(0, 0), (3, 0), (3, 1), (1, 1), (1, 2), (0, 2)]
POINTS = [(x, y, z) for z in (0, 1.5) for x, y in OUTLINE]
FACES = [[5, 4, 3, 2, 1, 0], [6, 7, 8, 9, 10, 11], *[[k, (k + 1) % 6, (k + 1) % 6 + 6, k + 6] for k in range(5)],
         [5, 0, 6], [5, 6, 11]]  # fmt: skip
"""An L-shaped block: two concave faces, quadrilaterals and triangles."""
ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}


def ply(form: str, flags: bool, end: str = "\n", faces: list[list[int]] = FACES) -> bytes:
    """The block; flags: another element before the vertices, and properties before and after the faces' lists."""
    lines = ["ply", f"format {form} 1.0", "comment by a program"]
    lines += ["element camera 1", "property list uchar short sizes", "property double f"] if flags else []
    lines += ["element vertex 12", "property float x", "property float y", "property double z"]
    lines += ["property uchar quality"] if flags else []
    lines += [f"element face {len(faces)}"] + (["property uchar flags"] if flags else [])
    lines += ["property list uchar uint vertex_indices"] + (["property float area"] if flags else [])
    head = (end.join([*lines, "end_header"]) + end).encode()
    rows: list[tuple[tuple[str, tuple[float, ...]], ...]] = [(("B2h", (2, 640, 480)), ("d", (0.5,)))] if flags else []
    rows += [(("2f", p[:2]), ("d", p[2:]), *([("B", (9,))] if flags else [])) for p in POINTS]
    for face in faces:
        listed = (f"B{len(face)}I", (len(face), *face))
        rows.append((("B", (1,)), listed, ("f", (0.25,))) if flags else (listed,))
    if form == "ascii":
        body = end.join(" ".join(str(value) for _, values in row for value in values) for row in rows) + end
        return head + body.encode()
    return head + b"".join(struct.pack(ORDERS[form] + kinds, *values) for row in rows for kinds, values in row)


def structure(path: Path, data: bytes) -> Structure:
    path.write_bytes(data)
    return MeshFile(path=str(path), keep_origin=True).build(np.random.default_rng(0)).structure


@pytest.mark.parametrize("form", ORDERS)
@pytest.mark.parametrize("flags", [False, True], ids=["plain", "flags"])
@pytest.mark.parametrize("end", ["\n", "\r\n"], ids=["lf", "crlf"])
def test_faces_of_different_length_are_read_in_every_form(tmp_path: Path, form: str, flags: bool, end: str) -> None:
    found = structure(tmp_path / "block.ply", ply(form, flags, end))
    np.testing.assert_array_equal(np.unique(found.vertices, axis=0), np.unique(POINTS, axis=0))
    assert len(found.edges) == 18 and len(found.face_normals) == 8


@pytest.mark.parametrize("form", ORDERS)
@pytest.mark.parametrize("faces", [FACES, [[0, 1, 2]] * 5], ids=["different", "alike"])
def test_a_file_that_ends_early_is_refused(tmp_path: Path, form: str, faces: list[list[int]]) -> None:
    whole = ply(form, flags=False, faces=faces)
    (tmp_path / "cut.ply").write_bytes(whole[: -len("3 5 6 11\n") if form == "ascii" else -13])
    told = rf"cut.ply: is truncated: its header counts {len(faces)} rows of face, and it holds {len(faces) - 1}; copy"
    with pytest.raises(UserError, match=told):
        read(tmp_path / "cut.ply")


def test_empty_lines_and_comments_between_rows_count_for_none(tmp_path: Path) -> None:
    head, _, body = ply("ascii", flags=False).partition(b"end_header\n")
    spaced = body.replace(b"\n", b"\n\ncomment next\n")
    found = structure(tmp_path / "spaced.ply", head + b"end_header\n\n" + spaced)
    assert len(found.edges) == 18


def test_an_element_without_properties_has_no_rows(tmp_path: Path) -> None:
    head, _, body = ply("ascii", flags=False).partition(b"end_header\n")
    found = structure(tmp_path / "empty.ply", head + b"element marks 3\nend_header\n" + body)
    assert len(found.edges) == 18


@pytest.mark.parametrize("end", [0.3, 0.51, 0.6, 0.95])
def test_a_truncated_stl_file_of_text_is_told(tmp_path: Path, end: float) -> None:
    corners = "vertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\n"
    facets = f"facet normal 0 0 1\nouter loop\n{corners}endloop\nendfacet\n" * 4
    text = f"solid first\n{facets}endsolid first\nsolid second\n{facets}endsolid second\n"
    (tmp_path / "part.stl").write_text(text[: int(end * len(text))])
    with pytest.raises(UserError, match=r"part.stl: is truncated: it does not end with endsolid; copy it"):
        read(tmp_path / "part.stl")
    for whole in (text.upper(), text + "; written by a program, 8 facets\n\n", text.replace("second", "solid vertex")):
        (tmp_path / "part.stl").write_text(whole)
        assert sum(len(piece.triangles) for piece in read(tmp_path / "part.stl")) == 8


def test_a_binary_stl_file_of_more_triangles_than_it_counts_is_told(tmp_path: Path) -> None:
    whole = b"solid of CAD".ljust(80) + (2).to_bytes(4, "little") + bytes(3 * 50)
    (tmp_path / "streamed.stl").write_bytes(whole)
    with pytest.raises(UserError, match="its header counts 2 triangles, and it holds 3; copy it again"):
        read(tmp_path / "streamed.stl")
