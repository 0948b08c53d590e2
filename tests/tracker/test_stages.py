"""The stages of the published method, each against a case with a known answer."""

import cv2
import numpy as np
import pytest

from tests.tracker.synthetic import CAMERA, box, look_at
from uavbench.scenes.camera import Camera
from uavbench.tracker.shang_shen.control_points import control_points
from uavbench.tracker.shang_shen.edge_search import Candidates, search_edge_pixels, search_gradient, search_segments
from uavbench.tracker.shang_shen.hypotheses import best_set, ransac
from uavbench.tracker.shang_shen.pose_update import normal_jacobian, prior_information, update_pose
from uavbench.tracker.shang_shen.segments import detect_edge_pixels, detect_segments, grey, undistort_segments
from uavbench.tracker.visible_edges import pinhole, visible_edges
from uavbench.trajectories.pose import Pose

BOX = box()
POSE = look_at(np.array([0.9, 0.6, 0.7]), (0, 0, 0.15))
MOVE = Pose.exp([0.01, -0.006, 0.012, 0.008, -0.01, 0.006])


def drawn_box(pose, supersample=8):
    """Grey image of the box's visible faces, each of one brightness."""
    image = np.full((480 * supersample, 640 * supersample), 60, np.uint8)
    for face, normal in enumerate(BOX.face_normals):
        corners = np.unique(BOX.triangles[BOX.triangle_face == face])
        cam = pose.transform(BOX.vertices[corners])
        if (pose.rotation @ normal) @ cam[0] >= 0:
            continue
        hull = cv2.convexHull(pinhole(cam, CAMERA).astype(np.float32)).reshape(-1, 2)
        at = (hull + 0.5) * supersample - 0.5
        cv2.fillConvexPoly(image, np.round(at * 16).astype(np.int32), int(100 + 30 * face), shift=4)
    return cv2.resize(image, (640, 480), interpolation=cv2.INTER_AREA)


def points_at(pose, spacing=8.0):
    return control_points(visible_edges(BOX, CAMERA, pose), spacing)


def test_short_segments_are_dropped():
    gray = np.full((200, 200), 50, np.uint8)
    cv2.rectangle(gray, (20, 20), (120, 120), 200, -1)
    cv2.rectangle(gray, (150, 150), (160, 160), 200, -1)
    found = detect_segments(gray)
    assert len(found) == 4
    assert np.hypot(found[:, 2] - found[:, 0], found[:, 3] - found[:, 1]).min() >= 90
    assert len(detect_segments(gray, 5.0)) == 8


def test_a_blank_image_has_no_segments():
    assert detect_segments(np.full((480, 640), 128, np.uint8)).shape == (0, 4)
    assert grey(np.zeros((4, 5, 3), np.uint8)).shape == (4, 5)


def test_the_jacobian_is_the_derivative_of_the_projection():
    points = points_at(POSE)
    cam = POSE.transform(points.points_m)
    J = normal_jacobian(cam, points.normals, CAMERA)
    for axis in range(6):
        step = np.zeros(6)
        step[axis] = 1e-6
        moved = pinhole(Pose.exp(step).transform(cam), CAMERA) - pinhole(Pose.exp(-step).transform(cam), CAMERA)
        np.testing.assert_allclose(J[:, axis], np.einsum("ij,ij->i", moved, points.normals) / 2e-6, atol=1e-3)


@pytest.mark.parametrize("detector", ["segments", "edge_pixels", "gradient"])
def test_search_finds_the_edges_of_a_drawn_box(detector):
    gray = drawn_box(MOVE @ POSE)
    points = points_at(POSE)
    if detector == "segments":
        candidates = search_segments(points, detect_segments(gray))
    elif detector == "edge_pixels":
        candidates = search_edge_pixels(points, detect_edge_pixels(gray), CAMERA)
    else:
        candidates = search_gradient(points, gray, CAMERA)
    ground_truth = points_at(MOVE @ POSE, 1.0)
    found = candidates.counts > 0
    assert found.mean() > 0.9
    chosen = np.array([np.nan] * len(points))
    for i in np.flatnonzero(found):
        # The true distance along this normal: where it meets the moved projection of the same edge
        line = ground_truth.pixels[ground_truth.edge == points.edge[i]]
        offset = line - points.pixels[i]
        along = offset @ np.array([-points.normals[i, 1], points.normals[i, 0]])
        nearest = np.argmin(np.abs(along))
        if abs(along[nearest]) < 1:
            chosen[i] = np.abs(candidates.distances[i] - offset[nearest] @ points.normals[i]).min()
    # a few points near the corners have lost their edge
    assert np.nanquantile(chosen, 0.9) < 1.0


def test_update_brings_back_the_pose_that_made_the_distances():
    points = points_at(POSE)
    true = MOVE @ POSE
    shift = pinhole(true.transform(points.points_m), CAMERA) - points.pixels
    distances = np.einsum("ij,ij->i", shift, points.normals)
    found = POSE
    for _ in range(3):  # the prior holds each update to where it starts
        found, information = update_pose(points, distances, CAMERA, found)
    assert np.linalg.norm((found @ true.inverse()).log()) < 1e-5
    assert np.linalg.eigvalsh(information).min() > 0


def test_ransac_finds_the_set_among_outliers():
    rng = np.random.default_rng(3)
    points = points_at(POSE)
    J = normal_jacobian(POSE.transform(points.points_m), points.normals, CAMERA)
    twist = np.array([0.01, -0.008, 0.015, 0.01, -0.012, 0.01])
    true = J @ twist
    distances = rng.uniform(-30, 30, (len(points), 3))
    distances[:, 1] = true + rng.normal(0, 0.3, len(points))
    distances[rng.random(len(points)) < 0.3, 1] = 25.0
    distances[:, 2] = np.inf
    order = np.argsort(np.abs(distances), axis=1)
    candidates = Candidates(np.take_along_axis(distances, order, axis=1))
    matches = ransac(candidates, J, points.edge, prior_information(1.0), rng)
    assert matches.inlier.mean() > 0.6
    assert np.abs(matches.distances - true)[matches.inlier].max() < 3.0
    assert np.median(np.abs(matches.distances - true)[matches.inlier]) < 0.5


def test_best_set_takes_the_nearest_candidate():
    distances = np.array([[1.0, -2.0], [5.0, np.inf], [np.inf, np.inf]])
    matches = best_set(distances, np.array([-1.5, 0.0, 0.0]), 2.0)
    assert matches.distances[0] == -2.0
    assert matches.inlier.tolist() == [True, False, False]


def test_segments_that_no_ray_reaches_are_left_out():
    """In the corners of a fisheye's image, beyond 90 degrees; those were mirrored to the other side."""
    coefficients = (0.0034823894, 0.0007150348, -0.0020532361, 0.00020293673)
    camera = Camera(512, 512, 190.97, 190.97, 254.93, 256.89, "equidistant", coefficients)
    middle, corner = [200.0, 250.0, 230.0, 251.0], [0.0, 0.0, 20.0, 20.0]
    found = undistort_segments(np.array([corner, middle, [*middle[:2], *corner[:2]]]), camera)
    x, y = (np.array(middle).reshape(2, 2) - [camera.cx, camera.cy]).T
    theta = np.hypot(x, y) / camera.fx
    assert found.shape == (1, 4)
    expected = np.column_stack([x, y]) * (np.tan(theta) / theta)[:, None] + [camera.cx, camera.cy]
    np.testing.assert_allclose(found.reshape(2, 2), expected, atol=0.1)
