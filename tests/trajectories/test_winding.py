"""Triangles that are wound against their neighbours are found, however many and whichever they are."""

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from uavbench.trajectories.geometry.winding import wound_against

BODIES = {
    "box": trimesh.creation.box((4.0, 3.0, 2.0)),
    "ring": trimesh.creation.annulus(1.0, 2.0, 1.0, sections=12),
    "ball": trimesh.creation.icosphere(subdivisions=2),
    "two": trimesh.util.concatenate(
        [
            trimesh.creation.box((1.0, 1.0, 1.0)),
            trimesh.creation.box((2.0, 1.0, 1.0)).apply_translation((5.0, 0.0, 0.0)),
        ]
    ),
}


def soup(mesh):
    """Vertices (3m, 3) and triangles (m, 3) that share no vertex, as an STL file has them."""
    corners = np.asarray(mesh.vertices)[mesh.faces].reshape(-1, 3)
    return corners, np.arange(len(corners)).reshape(-1, 3)


def with_turned(triangles, turned):
    return np.where(turned[:, None], triangles[:, ::-1], triangles)


@pytest.mark.parametrize("name", BODIES)
@given(data=st.data())
def test_any_turned_triangles_of_a_closed_body_are_found(name, data):
    vertices, triangles = soup(BODIES[name])
    turned = np.array(data.draw(st.lists(st.booleans(), min_size=len(triangles), max_size=len(triangles))))
    body = np.arange(len(triangles)) < 12  # the first box of two
    for part in (body, ~body) if name == "two" else (np.ones_like(body),):
        if turned[part].all():
            turned[part] = False  # inside out: it agrees with itself
    assert (wound_against(vertices, with_turned(triangles, turned)) == turned).all()


@pytest.mark.parametrize("missing", [(0, 0, -1), (0, 0, 1), (1, 0, 0)])
def test_an_open_body_faces_outwards_however_many_triangles_do_not(missing):
    box = BODIES["box"]
    vertices, triangles = soup(box)
    is_there = box.face_normals @ missing < 0.5
    triangles, normals = triangles[is_there], box.face_normals[is_there]
    for turned in (normals[:, 1] > 0.5, normals[:, 1] < 0.5, np.arange(len(triangles)) == 3):
        assert (wound_against(vertices, with_turned(triangles, turned)) == turned).all()


def test_of_a_sheet_the_smaller_part_is_turned():
    vertices = np.array([[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [4.0, 2.0, 0.0], [0.0, 2.0, 0.0], [5.0, 1.0, 0.0]])
    triangles = np.array([[0, 1, 2], [0, 2, 3], [1, 2, 4]])  # the last one against the others
    assert wound_against(vertices, triangles).tolist() == [False, False, True]
    assert wound_against(vertices, triangles[:, ::-1]).tolist() == [False, False, True]


def test_bodies_that_agree_with_themselves_stay_as_they_are():
    hollow = trimesh.util.concatenate([BODIES["box"], trimesh.creation.box((1.0, 1.0, 1.0))])
    cavity = np.arange(len(hollow.faces)) >= 12
    vertices, triangles = soup(hollow)
    assert not wound_against(vertices, with_turned(triangles, cavity)).any()
    assert not wound_against(vertices, triangles[:, ::-1]).any()
    both_sides = np.concatenate([triangles, triangles[:, ::-1]])
    assert not wound_against(vertices, both_sides).any()
    assert wound_against(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64)).shape == (0,)
    assert not wound_against(np.full_like(vertices, np.nan), triangles).any()


def test_a_body_that_is_inside_out_beside_a_larger_one_is_turned():
    vertices, triangles = soup(BODIES["two"])
    for smaller in (np.arange(24) < 12, np.arange(24) >= 12):
        larger = trimesh.creation.box((5.0, 5.0, 5.0)).apply_translation((0.0, 20.0, 0.0))
        more, others = soup(larger)
        turned = np.concatenate([smaller, np.zeros(12, dtype=bool)])
        whole = np.concatenate([triangles, others + len(vertices)])
        found = wound_against(np.concatenate([vertices, more]), with_turned(whole, turned))
        assert (found == turned).all()


def test_a_room_of_which_only_the_inside_is_modelled_stays_as_it_is():
    room = trimesh.creation.box((9.0, 9.0, 9.0))
    vertices, triangles = soup(trimesh.util.concatenate([room, BODIES["box"]]))
    assert not wound_against(vertices, with_turned(triangles, np.arange(24) < 12)).any()


def test_a_one_sided_band_stays_as_it_is():
    angle, across = np.linspace(0, 2 * np.pi, 12, endpoint=False), np.repeat([-0.5, 0.5], 12)
    angle = np.tile(angle, 2)
    radius = 2 + across * np.cos(angle / 2)
    vertices = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), across * np.sin(angle / 2)])
    low, high = np.arange(12), np.arange(12) + 12
    next_low, next_high = np.r_[low[1:], 12], np.r_[high[1:], 0]  # the last piece is joined with a half turn
    triangles = np.concatenate([np.stack([low, next_low, high], axis=1), np.stack([high, next_low, next_high], axis=1)])
    assert not wound_against(vertices, triangles).any()


@pytest.mark.parametrize("missing", [(0, 0, -1), (-1, 0, 0)])
def test_a_room_in_a_shell_that_is_open_somewhere_faces_inwards_still(missing):
    room, shell = trimesh.creation.box((5.0, 4.0, 3.0)), trimesh.creation.box((5.2, 4.2, 3.2))
    other = trimesh.creation.box((9.0, 9.0, 9.0)).apply_translation((20.0, 0.0, 0.0))
    inner, outer, more = soup(room), soup(shell), soup(other)
    walls = outer[1][shell.face_normals @ missing < 0.5]
    vertices = np.concatenate([inner[0], outer[0], more[0]])
    triangles = np.concatenate([inner[1][:, ::-1], walls + 36, more[1] + 72])
    assert not wound_against(vertices, triangles).any()


@pytest.mark.parametrize("again", [[0], [3, 3, 7], range(11)])
def test_copies_of_triangles_beside_a_hole_are_not_turned(again):
    """At a hole the two copies of a triangle share an edge with no third, and pass it the same way."""
    vertices, triangles = np.asarray(BODIES["box"].vertices), np.asarray(BODIES["box"].faces)[:-1]
    copies = np.roll(triangles[list(again)], 1, axis=1)
    assert not wound_against(vertices, np.concatenate([triangles, copies])).any()
    turned = np.zeros(len(triangles), dtype=bool)
    turned[5] = True
    wrong = np.concatenate([with_turned(triangles, turned), with_turned(triangles, turned)])
    assert wound_against(vertices, wrong).tolist() == [*turned, *turned]
