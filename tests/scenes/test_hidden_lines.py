"""Hidden-line removal of drawings: what stands behind a face is not drawn, what stands beside it is, to the border."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.reports.drawn import make_sequence
from tests.scenes.conftest import looking
from uavbench.scenes.camera import Camera
from uavbench.scenes.dataset.contact_sheet import GREEN, with_edges
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.scenes.hidden_lines import seen_parts
from uavbench.scenes.primitives.meshes import box
from uavbench.scenes.structure import Structure
from uavbench.tracker.images.overlay import draw_edges
from uavbench.tracker.images.seen_edges import seen_edges_px
from uavbench.tracker.protocol import TrackResult
from uavbench.trajectories.pose import Array

CAMERA = Camera.from_field_of_view(320, 240, 60.0)


def structure_of(*boxes: tuple[tuple[float, float, float], tuple[float, float, float]]) -> Structure:
    vertices, triangles, first = [], [], 0
    for low, high in boxes:
        v, t = box(low, high)
        vertices.append(v)
        triangles.append(np.asarray(t) + first)
        first += len(v)
    return Structure.from_mesh(np.concatenate(vertices), np.concatenate(triangles))


WALL = ((1.0, -0.5, 0.0), (1.1, 0.5, 1.0))
BEHIND = ((3.0, -0.4, 0.2), (3.2, 0.4, 0.8))
EYE = np.array([-3.0, 0.0, 0.5])


def length(segments: Array) -> float:
    return float(np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1).sum())


def test_what_stands_behind_a_face_is_not_seen() -> None:
    both = structure_of(WALL, BEHIND)
    far = both.edge_segments[(both.edge_segments[..., 0] > 2).all(axis=1)]
    assert len(far) == 12
    assert len(seen_parts(both, EYE, far)) == 0


def test_an_edge_is_cut_where_the_face_before_it_ends() -> None:
    both = structure_of(WALL, BEHIND)
    edge = np.array([[[4.0, -2.0, 0.5], [4.0, 2.0, 0.5]]])
    parts = seen_parts(both, EYE, edge)
    shadow = 0.5 / 4.0 * 7.0  # of the wall's front, 4 m from the eye, on what lies 7 m from it
    assert parts[:, :, 1] == pytest.approx(np.array([[-2.0, -shadow], [shadow, 2.0]]), abs=0.005)


def test_nothing_of_a_convex_box_is_lost() -> None:
    alone = structure_of(WALL)
    pose = looking((-2.0, -1.5, 1.8), (1.0, 0.0, 0.5))
    seen = seen_edges_px(alone, CAMERA, pose)
    assert len(seen) == 9
    assert length(seen_parts(alone, pose.inverse().translation, alone.edge_segments)) == pytest.approx(
        3 + 3 + 0.3, abs=0.01
    )


def test_no_edge_and_nothing_seen_are_empty() -> None:
    assert seen_parts(structure_of(WALL), EYE, np.zeros((0, 2, 3))).shape == (0, 2, 3)


def test_the_overlay_of_real_images_draws_no_hidden_edge() -> None:
    pose = looking((-3.0, 0.0, 0.5), (1.0, 0.0, 0.5))
    blank = np.zeros((240, 320, 3), np.uint8)
    result = TrackResult(status="ok", cam_from_world=pose)
    both, alone = (draw_edges(blank, structure_of(*b), CAMERA, result) for b in ((WALL, BEHIND), (WALL,)))
    assert both.any()
    assert np.array_equal(both, alone)


def test_the_contact_sheet_draws_what_is_seen(tmp_path: Path) -> None:
    sequence: Sequence = make_sequence(tmp_path / "arc", 2)
    drawn = (np.abs(with_edges(sequence, 0).astype(int) - GREEN).sum(axis=2) < 60).astype(np.uint8)
    expected = np.zeros(drawn.shape, np.uint8)
    for a, b in seen_edges_px(sequence.structure, sequence.camera, sequence.true_cam_from_world(0)):
        cv2.line(expected, np.rint(a).astype(int).tolist(), np.rint(b).astype(int).tolist(), 1, 3)
    assert drawn.sum() > 100
    assert (drawn <= expected).mean() > 0.999
