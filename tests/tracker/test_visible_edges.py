import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.tracker.synthetic import CAMERA, box, look_at
from uavbench.scenes.camera import Camera
from uavbench.scenes.structure import Structure
from uavbench.tracker.shang_shen.control_points import control_points
from uavbench.tracker.visible_edges import (
    clip_to_view,
    near_depth,
    pinhole,
    to_image,
    undistorted_bounds,
    visible_edges,
    visible_faces,
)
from uavbench.trajectories.pose import Pose

BOX = box()
NEAR = 0.02
angles = st.floats(0.0, 2 * np.pi)


@pytest.mark.parametrize(
    ("eye", "faces", "edges"),
    [((1.2, 0.0, 0.15), 1, 4), ((1.0, 1.0, 0.15), 2, 7), ((1.0, 1.0, 0.9), 3, 9)],
)
def test_a_box_shows_the_edges_of_its_visible_faces(eye, faces, edges):
    seen = visible_edges(BOX, CAMERA, look_at(np.array(eye), (0, 0, 0.15)))
    assert len(seen.edges) == edges


def test_from_below_only_the_bottom_is_seen():
    pose = look_at(np.array([0.05, 0.0, -1.0]), (0, 0, 0.15))
    assert len(visible_edges(BOX, CAMERA, pose).edges) == 4


def test_a_face_seen_exactly_from_its_side_is_not_visible():
    """The eye lies in the planes of two faces; only the one before it shows its edges."""
    pose = look_at(np.array([1.2, 0.15, 0.3]), (0.0, 0.15, 0.3))
    assert visible_faces(BOX, pose).sum() == 1
    assert len(visible_edges(BOX, CAMERA, pose).edges) == 4


def test_a_sheet_is_seen_from_its_front_alone():
    sheet = Structure.from_mesh(
        np.array([[0.0, -0.2, 0.0], [0.0, 0.2, 0.0], [0.0, 0.2, 0.3], [0.0, -0.2, 0.3]]),
        np.array([[0, 1, 2], [0, 2, 3]]),
    )
    front, behind = (look_at(np.array([x, 0.1, 0.1]), (0, 0, 0.15)) for x in (1.0, -1.0))
    assert len(visible_edges(sheet, CAMERA, front).edges) == 4
    assert len(visible_edges(sheet, CAMERA, behind).edges) == 0


def test_the_image_of_a_pinhole_ends_at_the_borders_of_its_pixels():
    assert undistorted_bounds(CAMERA) == pytest.approx((-0.5, -0.5, 639.5, 479.5))


@pytest.mark.parametrize("k1", [-0.28, 0.2])
def test_the_bounds_of_a_lens_are_those_of_its_whole_border(k1):
    camera = Camera(640, 480, 420.0, 430.0, 300.0, 250.0, "radtan", (k1, 0.05, 0.0, 0.0))
    u, v = np.linspace(-0.5, 639.5, 2001), np.linspace(-0.5, 479.5, 2001)
    border = [np.column_stack([u, 0 * u + y]) for y in (-0.5, 479.5)] + [
        np.column_stack([0 * v + x, v]) for x in (-0.5, 639.5)
    ]
    flat = camera.undistort(np.concatenate(border))
    assert undistorted_bounds(camera) == pytest.approx([*flat.min(axis=0), *flat.max(axis=0)], abs=0.1)


def test_a_segment_through_the_view_is_cut_at_both_borders_and_before_the_camera():
    """Along x at 1 m: it enters and leaves at the borders of the image; along the axis: it begins NEAR ahead."""
    half_left, half_right = (320.0 - -0.5) / CAMERA.fx, (639.5 - 320.0) / CAMERA.fx
    cx = (CAMERA.cx - 320.0) / CAMERA.fx
    segments = np.array(
        [
            [[-2.0, 0, 1], [2.0, 0, 1]],
            [[0, 0, -1.0], [0, 0, 1.0]],
            [[0, 0, 1.0], [0, 0, -1.0]],
            [[-2.0, 0, 1], [-1.9, 0, 1]],
        ]
    )
    start, end = clip_to_view(segments, CAMERA, NEAR)
    assert (start[0], end[0]) == pytest.approx(((2 - half_left - cx) / 4, (2 + half_right - cx) / 4))
    assert (start[1], end[1]) == pytest.approx(((1 + NEAR) / 2, 1.0))
    assert (start[2], end[2]) == pytest.approx((0.0, (1 - NEAR) / 2))
    assert start[3] >= end[3]


def test_visible_parts_are_those_of_the_clipped_edge_in_world_camera_and_image():
    pose = look_at(np.array([0.35, 0.05, 0.2]), (0, 0.1, 0.15))
    seen = visible_edges(BOX, CAMERA, pose)
    whole = BOX.edge_segments[seen.edges]
    start, end = clip_to_view(pose.transform(whole.reshape(-1, 3)).reshape(-1, 2, 3), CAMERA, near_depth(BOX))
    assert (start > 0).any() and (end < 1).any() and (start < end).all()
    for k, part in enumerate((start, end)):
        points = whole[:, 0] + part[:, None] * (whole[:, 1] - whole[:, 0])
        np.testing.assert_allclose(seen.segments_m[:, k], points, atol=1e-12)
        np.testing.assert_allclose(seen.depths_m[:, k], pose.transform(points)[:, 2], atol=1e-12)
    np.testing.assert_allclose(seen.lengths_px, np.linalg.norm(seen.segments_px[:, 0] - seen.segments_px[:, 1], axis=1))


def test_a_model_behind_the_camera_shows_nothing():
    away = look_at(np.array([1.0, 0.0, 0.3]), (2.0, 0, 0.3))
    assert len(visible_edges(BOX, CAMERA, away).edges) == 0


@settings(max_examples=60)
@given(angles, st.floats(0.25, 3.0), st.floats(0.0, 1.5), st.floats(-0.6, 0.6), st.floats(-0.6, 0.6))
def test_projected_edges_lie_in_the_image_and_agree_with_their_points(angle, radius, height, aim_x, aim_y):
    pose = look_at(np.array([radius * np.cos(angle), radius * np.sin(angle), height]), (aim_x, aim_y, 0.1))
    seen = visible_edges(BOX, CAMERA, pose)
    x0, y0, x1, y1 = undistorted_bounds(CAMERA)
    assert (seen.segments_px >= [x0 - 1e-6, y0 - 1e-6]).all()
    assert (seen.segments_px <= [x1 + 1e-6, y1 + 1e-6]).all()
    assert (seen.depths_m >= near_depth(BOX) - 1e-9).all()
    cam = pose.transform(seen.segments_m.reshape(-1, 3))
    np.testing.assert_allclose(pinhole(cam, CAMERA), seen.segments_px.reshape(-1, 2), atol=1e-6)


@settings(max_examples=60)
@given(st.lists(st.floats(-2, 2), min_size=6, max_size=6))
def test_clipping_agrees_with_sampling(numbers):
    segment = np.array(numbers).reshape(1, 2, 3)
    start, end = clip_to_view(segment, CAMERA, NEAR)
    parts = np.linspace(0, 1, 401)
    points = segment[0, 0] + parts[:, None] * (segment[0, 1] - segment[0, 0])
    px = pinhole(np.where(points[:, 2:] >= NEAR, points, np.nan), CAMERA)
    x0, y0, x1, y1 = undistorted_bounds(CAMERA)
    with np.errstate(invalid="ignore"):
        inside = (px[:, 0] >= x0) & (px[:, 0] <= x1) & (px[:, 1] >= y0) & (px[:, 1] <= y1)
    assert not np.any(inside & ((parts < start[0] - 1e-9) | (parts > end[0] + 1e-9)))
    if end[0] - start[0] > 0.01:
        assert inside[(parts > start[0] + 1e-9) & (parts < end[0] - 1e-9)].all()


def test_control_points_lie_on_their_edges_at_an_even_spacing():
    pose = look_at(np.array([0.9, 0.6, 0.7]), (0, 0, 0.15))
    seen = visible_edges(BOX, CAMERA, pose)
    points = control_points(seen, 8.0)
    np.testing.assert_allclose(pinhole(pose.transform(points.points_m), CAMERA), points.pixels, atol=1e-9)
    np.testing.assert_array_equal(np.bincount(points.edge, minlength=len(seen.edges)), np.round(seen.lengths_px / 8.0))
    gaps = np.linalg.norm(np.diff(points.pixels[points.edge == 0], axis=0), axis=1)
    np.testing.assert_allclose(gaps, gaps[0])
    direction = seen.segments_px[points.edge, 1] - seen.segments_px[points.edge, 0]
    np.testing.assert_allclose(np.einsum("ij,ij->i", direction, points.normals), 0, atol=1e-9)


@pytest.mark.parametrize(
    "camera",
    [
        Camera(640, 480, 420.0, 420.0, 320.0, 240.0, "radtan", (-0.283, 0.074, 0.0, 0.0)),
        Camera(640, 480, 300.0, 300.0, 320.0, 240.0, "equidistant", (0.01, -0.002, 0.0, 0.0)),
    ],
)
def test_undistorted_pixels_go_back_to_the_image(camera):
    pose = look_at(np.array([0.9, 0.6, 0.7]), (0, 0, 0.15))
    corners = pose.transform(BOX.vertices)
    np.testing.assert_allclose(to_image(pinhole(corners, camera), camera), camera.project(corners), atol=1e-9)
    x0, y0, x1, y1 = undistorted_bounds(camera)
    inner = camera.undistort(np.array([[0.0, 0.0], [639.0, 479.0]]))
    assert x0 <= inner[0, 0]
    assert y0 <= inner[0, 1]
    assert x1 >= inner[1, 0]
    assert y1 >= inner[1, 1]


def test_pinhole_is_opencvs():
    points = np.array([[0.1, -0.2, 1.5], [-0.3, 0.05, 0.7]])
    expected = cv2.projectPoints(points, np.zeros(3), np.zeros(3), CAMERA.K, np.zeros(4))[0].reshape(-1, 2)
    np.testing.assert_allclose(pinhole(points, CAMERA), expected)
    assert Pose.identity().rotation.shape == (3, 3)
