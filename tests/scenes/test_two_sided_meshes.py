"""Faces that a mesh has twice, or from both sides, make no edges where its surface has none."""

from pathlib import Path

import numpy as np
import pytest

from uavbench.scenes import structure as scenes_structure
from uavbench.scenes.primitives.meshes import box
from uavbench.scenes.structure import Structure
from uavbench.tracker.images.track_images import load_model

VERTICES, TRIANGLES = box((0.0, 0.0, 0.0), (4.0, 2.0, 1.0))
SHEET = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]])
BENT = np.array([*SHEET.tolist(), [2.0, 0.0, 1.0], [2.0, 1.0, 1.0]])


def both_sides(triangles: np.ndarray, *, in_turn: bool) -> np.ndarray:
    """The triangles, and each of them from behind: right after it, or all of these at the end."""
    behind = triangles[:, [1, 0, 2]]
    return np.stack([triangles, behind], axis=1).reshape(-1, 3) if in_turn else np.concatenate([triangles, behind])


def places(structure: Structure) -> set[tuple[float, ...]]:
    """End points of the edges, whatever their order."""
    return {tuple(np.array(sorted(ends.tolist())).ravel().tolist()) for ends in structure.edge_segments}


@pytest.mark.parametrize("row", [0, 5, 11])
@pytest.mark.parametrize("turn", [0, 1, 2])
@pytest.mark.parametrize("first", [True, False])
def test_a_triangle_that_is_there_twice_counts_once(row: int, turn: int, first: bool) -> None:
    again = np.roll(TRIANGLES[row], turn)[None]
    many = np.concatenate([again, TRIANGLES] if first else [TRIANGLES, again])
    structure, plain = Structure.from_mesh(VERTICES, many), Structure.from_mesh(VERTICES, TRIANGLES)
    assert len(structure.triangles) == 12 and len(structure.edges) == 12
    assert places(structure) == places(plain) and (structure.edge_faces >= 0).all()


@pytest.mark.parametrize("in_turn", [True, False])
def test_the_diagonals_of_a_surface_with_both_sides_are_no_edges(in_turn: bool) -> None:
    one = Structure.from_mesh(VERTICES, TRIANGLES)
    two = Structure.from_mesh(VERTICES, both_sides(TRIANGLES, in_turn=in_turn))
    assert places(two) == places(one)
    assert len(two.edges) == 24 and len(two.face_normals) == 12
    normals = two.face_normals[two.edge_faces]
    np.testing.assert_allclose((normals[:, 0] * normals[:, 1]).sum(axis=1), 0.0, atol=1e-12)  # of one side, at a corner


@pytest.mark.parametrize("in_turn", [True, False])
def test_a_bent_sheet_with_both_sides_has_its_border_and_its_bend(in_turn: bool) -> None:
    triangles = np.array([[0, 1, 2], [0, 2, 3], [1, 4, 5], [1, 5, 2]])
    one = Structure.from_mesh(BENT, triangles)
    two = Structure.from_mesh(BENT, both_sides(triangles, in_turn=in_turn))
    assert places(two) == places(one)
    assert len(one.edges) == 7 and len(two.edges) == 8  # the bend from both sides


def test_trackers_get_no_diagonals_of_a_file_with_both_sides(tmp_path: Path) -> None:
    """As some modelling programs export it: each face, then the same from behind."""
    lines = [f"v {x} {y} {z}" for x, y, z in VERTICES.tolist()]
    lines += ["f " + " ".join(map(str, face)) for face in (both_sides(TRIANGLES, in_turn=True) + 1).tolist()]
    (tmp_path / "two.obj").write_text("\n".join(lines) + "\n")
    lengths = np.linalg.norm(np.diff(load_model(tmp_path / "two.obj").edge_segments, axis=1), axis=2)
    assert set(np.round(lengths.ravel(), 6)) == {1.0, 2.0, 4.0}


@pytest.mark.parametrize(("leaves", "compared"), [(25, True), (26, False)])
def test_leaves_of_one_edge_are_compared_up_to_a_number(
    leaves: int, compared: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of 4,000 leaves, each with each takes seconds, and of more of them hours."""
    angles = 2 * np.pi * np.arange(leaves) / leaves
    tips = np.column_stack([np.cos(angles), np.sin(angles), np.full(leaves, 0.5)])
    triangles = np.column_stack([np.zeros(leaves), np.ones(leaves), 2 + np.arange(leaves)]).astype(np.intp)
    asked: list[int] = []
    by_sides = scenes_structure._by_sides
    monkeypatch.setattr(scenes_structure, "_by_sides", lambda *sides: asked.append(len(sides[0])) or by_sides(*sides))
    vertices = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], *tips.tolist()])
    found = Structure.from_mesh(vertices, both_sides(triangles, in_turn=False))
    assert asked == [2 * leaves] * compared
    assert len(found.vertices) == leaves + 2 and len(found.edges) > leaves
