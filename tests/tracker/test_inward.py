"""Which way a face goes on from its edge, however it is cut into triangles."""

import numpy as np
import pytest
import trimesh

from tests.tracker.synthetic import BOX_TRIANGLES, box_corners
from uavbench.scenes.structure import Structure
from uavbench.tracker.robust.config import RobustConfig
from uavbench.tracker.robust.edges.edge_graph import EdgeMap

L_SHAPE = np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 1.0], [1.0, 1.0], [1.0, 3.0], [0.0, 3.0]])


def edges_of(vertices, triangles):
    return EdgeMap.of(Structure.from_mesh(vertices, triangles), RobustConfig().edges.sampling.rounded_deg)


def is_in_l_shape(place):
    x, y = place
    return 0.0 < x < 3.0 and 0.0 < y < 3.0 and (x < 1.0 or y < 1.0)


@pytest.mark.parametrize("times", [0, 1, 3])
def test_a_step_from_an_edge_of_a_box_is_on_its_face(times):
    """The faces of a box are cut into two triangles, or into 4^n of each."""
    vertices, triangles = box_corners((2.0, 1.0, 0.5)), BOX_TRIANGLES
    for _ in range(times):
        vertices, triangles = trimesh.remesh.subdivide(vertices, triangles)
    edges = edges_of(vertices, triangles)
    assert len(edges.ends) == 12
    for ends, faces, inward in zip(edges.ends, edges.faces, edges.inward, strict=True):
        for face, into in zip(faces, inward, strict=True):
            on_face = ends.mean(axis=0) + 0.1 * into
            assert np.linalg.norm(into) == pytest.approx(1.0)
            assert into @ (ends[1] - ends[0]) == pytest.approx(0.0, abs=1e-12)
            assert edges.planes[face, :3] @ on_face == pytest.approx(edges.planes[face, 3])
            assert (on_face >= vertices.min(axis=0) - 1e-9).all()
            assert (on_face <= vertices.max(axis=0) + 1e-9).all()


@pytest.mark.parametrize("times", [0, 2])
def test_a_face_that_is_bent_goes_on_from_each_edge_to_its_own_side(times):
    """An L: the middle of the whole face is on the wrong side of two of its edges."""
    solid = trimesh.creation.extrude_triangulation(
        L_SHAPE, np.array([[0, 1, 2], [0, 2, 3], [0, 3, 5], [3, 4, 5]]), height=1.0
    )
    vertices, triangles = solid.vertices, solid.faces
    for _ in range(times):
        vertices, triangles = trimesh.remesh.subdivide(vertices, triangles)
    edges = edges_of(vertices, triangles)
    on_top = 0
    for ends, faces, inward in zip(edges.ends, edges.faces, edges.inward, strict=True):
        for face, into in zip(faces, inward, strict=True):
            if edges.planes[face, 2] > 0.9:
                on_top += 1
                assert is_in_l_shape((ends.mean(axis=0) + 0.1 * into)[:2])
    assert on_top == len(L_SHAPE)
