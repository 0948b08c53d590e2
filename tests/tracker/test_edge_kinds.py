"""Edges that look alike: those of equal details, and no others."""

import dataclasses

import numpy as np
import pytest
import trimesh

from uavbench.scenes.camera import Camera
from uavbench.scenes.structure import Structure
from uavbench.tracker.robust.edges.columns import BOTH_FACES, EDGE, FACES, NORMAL_U, NORMAL_V
from uavbench.tracker.robust.edges.edge_graph import EdgeMap
from uavbench.tracker.robust.edges.sampling_kernels import sample_edges, search_lines
from uavbench.tracker.robust.solver.edge_kinds import EdgeKinds
from uavbench.tracker.robust.view import View
from uavbench.trajectories.pose import Pose

CAMERA = Camera.from_field_of_view(640, 480, horizontal_deg=65.0)
SHIFT = np.array([1.5, 0.0, 0.0])


def boxes(*shifts, extents=(1.0, 0.7, 0.4)):
    """Structure of equal boxes in these places."""
    meshes = [trimesh.creation.box(extents, trimesh.transformations.translation_matrix(shift)) for shift in shifts]
    mesh = trimesh.util.concatenate(meshes)
    return Structure.from_mesh(np.array(mesh.vertices), np.array(mesh.faces))


def shuffled(structure, rng):
    """The same structure with the ends and the faces of half of its edges in the other order."""
    edges, faces = structure.edges.copy(), structure.edge_faces.copy()
    for rows in (edges, faces):
        back = rng.random(len(rows)) < 0.5
        rows[back] = rows[back][:, ::-1]
    return dataclasses.replace(structure, edges=edges, edge_faces=faces)


def looking_at(eye, target):
    """A level camera at a place that looks at another."""
    z = (target - eye) / np.linalg.norm(target - eye)
    x = np.cross(z, [0.0, 0.0, 1.0])
    x /= np.linalg.norm(x)
    R = np.array([x, np.cross(z, x), z])
    return Pose(R, -R @ eye)


def kind_of(kinds, edge, faces):
    return kinds.kinds[edge * BOTH_FACES + faces - 1]


@pytest.mark.parametrize("extents", [(1.0, 0.7, 0.4), (1.0, 1.0, 1.0)])
def test_no_edge_of_a_single_box_looks_like_another(extents):
    kinds = EdgeKinds.of(EdgeMap.of(boxes((0.0, 0.0, 0.0), extents=extents), 35.0))
    assert kinds.number == 0
    assert (kinds.kinds == -1).all()


@pytest.mark.parametrize("seed", range(4))
def test_an_edge_of_a_box_looks_like_that_of_an_equal_box_beside_it(seed):
    structure = shuffled(boxes((0.0, 0.0, 0.0), SHIFT, 2 * SHIFT), np.random.default_rng(seed))
    edges = EdgeMap.of(structure, 35.0)
    kinds = EdgeKinds.of(edges)
    middles = edges.ends.mean(axis=1)
    assert len(middles) == 36
    assert kinds.number == 12 * BOTH_FACES
    for a in range(len(middles)):
        for b in range(a + 1, len(middles)):
            apart = middles[b] - middles[a]
            same = np.allclose(np.abs(apart[0]) % SHIFT[0], 0, atol=1e-6) and np.allclose(apart[1:], 0, atol=1e-6)
            assert (kind_of(kinds, a, BOTH_FACES) == kind_of(kinds, b, BOTH_FACES)) == same


@pytest.mark.parametrize("seed", range(4))
def test_normals_and_visible_faces_of_a_kind_are_the_same_apart_from_the_sign(seed):
    """So that an offset to one side of an edge is one to the same side of all others of its kind."""
    edges = EdgeMap.of(shuffled(boxes((0.0, 0.0, 0.0), SHIFT), np.random.default_rng(seed)), 35.0)
    kinds = EdgeKinds.of(edges)
    eye = np.array([20.0, -40.0, 12.0])  # far away, so that both boxes are seen from the same side
    pose = looking_at(eye, np.array([0.75, 0.0, 0.0]))
    camera = dataclasses.replace(CAMERA, fx=8000.0, fy=8000.0)
    view = View.of(camera, boxes((0.0, 0.0, 0.0), SHIFT)).at(pose)
    points = sample_edges(edges, view, 6.0, 400)
    normals = search_lines(points, edges.ends, edges.inward, view).lines[:, [NORMAL_U, NORMAL_V]]
    rows = points.keys[:, EDGE] * BOTH_FACES + points.keys[:, FACES] - 1
    seen = np.unique(kinds.kinds[rows])
    assert len(seen) == 9  # the edges of a box that are seen from a corner of it
    assert seen.min() >= 0
    for kind in seen:
        of_kind = np.flatnonzero(kinds.kinds[rows] == kind)
        assert len(np.unique(points.keys[of_kind, EDGE])) == 2
        signed = normals[of_kind] * kinds.signs[rows[of_kind], None]
        assert (signed @ signed[0] > 0.99).all()


def test_the_foot_of_a_rib_does_not_look_like_its_top():
    """They have the same directions, lengths and normals of faces, which lie on other sides of them."""
    corners = np.array([(0, 0), (4, 0), (4, 1), (1.5, 1), (1, 1), (0, 1), (1.5, 2), (1, 2)], dtype=np.float64)
    triangles = np.array([(0, 1, 2), (0, 2, 3), (0, 3, 4), (0, 4, 5), (4, 3, 6), (4, 6, 7)])
    mesh = trimesh.creation.extrude_triangulation(corners, triangles, 3.0)
    edges = EdgeMap.of(Structure.from_mesh(np.array(mesh.vertices), np.array(mesh.faces)), 35.0)
    kinds = EdgeKinds.of(edges)
    upright = np.abs(edges.ends[:, 1] - edges.ends[:, 0])[:, 2] > 2.9
    middles = edges.ends.mean(axis=1)

    def at(x, y):
        (edge,) = np.flatnonzero(upright & (np.abs(middles[:, :2] - [x, y]) < 1e-6).all(axis=1))
        return kind_of(kinds, edge, BOTH_FACES)

    assert at(1, 2) == at(0, 1) != -1  # a corner of the same faces, to the left
    assert at(1.5, 2) == at(4, 1) != -1
    assert at(1, 1) == at(1.5, 1) == -1


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("turned_deg", [0.0, 30.0, 45.0, 60.0, 90.0])
def test_rounding_of_a_models_vertices_does_not_part_a_kind(turned_deg, seed):
    """Vertices written with three decimals: directions that structures have lie well within a class."""
    plain = boxes(np.zeros(3), SHIFT)
    turn = trimesh.transformations.rotation_matrix(np.radians(turned_deg), [0.0, 0.0, 1.0])[:3, :3]
    noise = np.random.default_rng(seed).uniform(-5e-4, 5e-4, plain.vertices.shape)
    turned = Structure.from_mesh(plain.vertices @ turn.T + noise, plain.triangles)
    kinds = [EdgeKinds.of(EdgeMap.of(each, 35.0)) for each in (plain, turned)]
    assert len(kinds[0].kinds) == len(kinds[1].kinds)
    assert kinds[1].number == kinds[0].number > 0
