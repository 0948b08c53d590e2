"""Rounded surfaces: their outlines are edges, and borders of many short edges are not lost."""

import numpy as np
import pytest

from tests.tracker.synthetic import CAMERA, box, look_at
from uavbench.scenes.structure import Structure
from uavbench.tracker.robust.config import RobustConfig
from uavbench.tracker.robust.config.edges import SamplingConfig
from uavbench.tracker.robust.edges.edge_graph import EdgeMap
from uavbench.tracker.robust.fit.edge_fit import EdgeFitter


def cylinder(sides):
    """A closed cylinder of radius and height 1 m on the ground."""
    angle = 2 * np.pi * np.arange(sides) / sides
    ring = np.column_stack([np.cos(angle), np.sin(angle)])
    vertices = np.concatenate([np.insert(ring, 2, z, axis=1) for z in (0.0, 1.0)] + [[[0, 0, 0], [0, 0, 1]]])
    k = np.arange(sides)
    after = (k + 1) % sides
    triangles = np.concatenate(
        [
            np.column_stack([k, after, after + sides]),
            np.column_stack([k, after + sides, k + sides]),
            np.column_stack([after, k, np.full(sides, 2 * sides)]),
            np.column_stack([k + sides, after + sides, np.full(sides, 2 * sides + 1)]),
        ]
    )
    return Structure.from_mesh(vertices, triangles)


@pytest.mark.parametrize("sides", [12, 48, 300])
def test_border_and_outline_of_a_cylinder_are_seen(sides):
    fitter = EdgeFitter(cylinder(sides), CAMERA, np.random.default_rng(0), RobustConfig())
    eye = np.array([0.0, -6.0, 2.0])
    points = fitter.sample(fitter.view.at(look_at(eye, (0, 0, 0.5)))).points
    rim = points[:, 2] > 0.999
    assert np.count_nonzero(rim) > 20
    middle = points[(points[:, 2] > 0.2) & (points[:, 2] < 0.8)]
    assert len(middle) > 5
    sideways = np.array([np.sqrt(1 - 1 / 36), -1 / 6])  # where rays from the eye touch the circle
    np.testing.assert_allclose(
        np.abs(middle[:, :2]), np.tile(np.abs(sideways), (len(middle), 1)), atol=2 * np.pi / sides
    )


def test_a_box_has_its_edges_and_no_more():
    structure = box()
    m = EdgeMap.of(structure, SamplingConfig().rounded_deg)
    np.testing.assert_array_equal(m.ends, structure.edge_segments)
    assert not m.rounded.any()
