"""Measures of flights in closed loop against cases that are known beforehand."""

import numpy as np
import pytest

from uavbench.reports.closed_loop.coverage import coverage, surface_points
from uavbench.reports.statistics.proportion import Proportion
from uavbench.scenes.camera import Camera
from uavbench.scenes.primitives.meshes import box
from uavbench.scenes.structure import Structure
from uavbench.trajectories.pose import Pose

CAMERA = Camera.from_field_of_view(200, 200, 90.0)
CUBE = Structure.from_mesh(*box((-1.0, -1.0, 0.0), (1.0, 1.0, 2.0)))


def looking_along_x(x_m, z_m=1.0):
    """A camera on the x axis that looks towards +x."""
    R = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
    return Pose(R, -R @ np.array([x_m, 0.0, z_m]))


def test_wilson_intervals_are_those_of_the_book():
    found = Proportion.of(8, 10)  # Newcombe 1998, method 3
    assert (found.low, found.high) == (pytest.approx(0.4902, abs=1e-4), pytest.approx(0.9433, abs=1e-4))
    assert Proportion.of(0, 10).low == 0.0
    assert Proportion.of(100, 100).low == pytest.approx(0.9630, abs=1e-4)
    assert (found.successes, found.n, found.share) == (8, 10, 0.8)
    assert Proportion.of(0, 0) == Proportion(successes=0, n=0, low=0.0, high=1.0)
    assert Proportion.of(0, 0).share == 0.0


def test_points_lie_evenly_on_the_surface():
    points, normals = surface_points(CUBE)
    on_faces = np.abs(points - [0, 0, 1]).max(axis=1)
    np.testing.assert_allclose(on_faces, 1.0, atol=1e-9)
    shares = [(normals @ n > 0.5).mean() for n in np.vstack([np.eye(3), -np.eye(3)])]
    np.testing.assert_allclose(shares, 1 / 6, atol=0.03)


def test_faces_have_points_by_their_area_which_lie_evenly_on_each():
    points, normals = surface_points(Structure.from_mesh(*box((0.0, 0.0, 0.0), (1.0, 2.0, 4.0))))
    size = np.array([1.0, 2.0, 4.0])
    for axis, area in enumerate((8.0, 4.0, 2.0)):
        on = np.abs(normals[:, axis]) > 0.5
        assert on.mean() == pytest.approx(area / 14, abs=0.03)
        for other in {0, 1, 2} - {axis}:
            along = points[on, other] / size[other]
            assert (along.mean(), along.var()) == (pytest.approx(1 / 2, abs=0.05), pytest.approx(1 / 12, abs=0.012))


def test_a_camera_before_a_cube_sees_one_face_of_six():
    share = float((surface_points(CUBE)[1] @ [-1.0, 0, 0] > 0.5).mean())
    assert coverage(CUBE, CAMERA, [looking_along_x(-3.0)], 10.0) == pytest.approx(share, abs=1e-9)
    assert coverage(CUBE, CAMERA, [looking_along_x(5.0)], 10.0) == 0.0
    assert coverage(CUBE, CAMERA, [], 10.0) == 0.0


def test_what_is_too_far_away_is_not_inspected():
    """At 2 m before the face and 100 px of focal length its middle has 50 px a metre."""
    assert coverage(CUBE, CAMERA, [looking_along_x(-3.0)], 51.0) == 0.0
    near = coverage(CUBE, CAMERA, [looking_along_x(-3.0)], 45.0)
    assert 0.0 < near < coverage(CUBE, CAMERA, [looking_along_x(-3.0)], 20.0)


@pytest.mark.parametrize("px_m", [35.0, 45.0, 49.0])
def test_resolution_falls_with_the_distance_and_with_the_slant(px_m):
    """A metre at the distance d and a slant a has 100 cos(a) / d px, and 2 m before the face cos(a) is 2 / d."""
    points, normals = surface_points(CUBE)
    square = ((points - [-3.0, 0.0, 1.0]) ** 2).sum(axis=1)
    expected = (normals @ [-1.0, 0, 0] > 0.5) & (100 * 2 / square >= px_m)
    assert coverage(CUBE, CAMERA, [looking_along_x(-3.0)], px_m) == pytest.approx(expected.mean(), abs=1e-9)


def test_only_what_lies_within_the_image_is_seen():
    """Half a metre before the face 90 degrees show half a metre to each side."""
    points, normals = surface_points(CUBE)
    inside = (np.abs(points[:, 1:] - [0.0, 1.0]) < 0.5).all(axis=1)
    expected = inside & (normals @ [-1.0, 0, 0] > 0.5)
    assert 0 < expected.mean() < 0.1
    assert coverage(CUBE, CAMERA, [looking_along_x(-1.5)], 1.0) == pytest.approx(expected.mean(), abs=1e-9)


@pytest.mark.parametrize(("model", "coefficients"), [("equidistant", (0.0,) * 4), ("radtan", (-0.3, 0.0, 0.0, 0.0))])
def test_a_lens_shows_what_is_in_its_own_image(model, coefficients):
    """Both see more than a pinhole of their focal length; the second folds over at a tangent of 1.05."""
    points, normals = surface_points(CUBE)
    camera = Camera(80, 60, 60.0, 60.0, 39.5, 29.5, model, coefficients)
    right, down = -points[:, 1] / 0.7, (1.0 - points[:, 2]) / 0.7
    tangent = np.hypot(right, down)
    radius = np.arctan(tangent) if model == "equidistant" else tangent * (1 - 0.3 * tangent**2)
    reached = (60 * np.abs(np.column_stack([right, down])) * (radius / tangent)[:, None] < [40.0, 30.0]).all(axis=1)
    reached &= (model == "equidistant") | (tangent < np.sqrt(1 / 0.9))
    facing = normals @ [-1.0, 0, 0] > 0.5
    expected = float((reached & facing).mean())
    assert expected > 1.1 * float(((60 * np.abs(right) < 40) & (60 * np.abs(down) < 30) & facing).mean())
    assert coverage(CUBE, camera, [looking_along_x(-1.7)], 1.0) == pytest.approx(expected, abs=1e-9)


def test_a_sheet_is_seen_from_its_front_alone():
    corners = np.array([[0.0, -1, 0], [0.0, 1, 0], [0.0, 1, 2], [0.0, -1, 2]])
    for triangles, seen in (([[0, 2, 1], [0, 3, 2]], 1.0), ([[0, 1, 2], [0, 2, 3]], 0.0)):
        sheet = Structure.from_mesh(corners, np.array(triangles))
        assert coverage(sheet, CAMERA, [looking_along_x(-3.0)], 1.0) == seen


def test_what_stands_behind_something_is_not_seen():
    front = box((-1.0, -1.0, 0.0), (1.0, 1.0, 2.0))
    back = box((4.0, -1.0, 0.0), (6.0, 1.0, 2.0))
    both = Structure.from_mesh(np.vstack([front[0], back[0]]), np.vstack([front[1], back[1] + len(front[0])]))
    alone = coverage(Structure.from_mesh(*back), CAMERA, [looking_along_x(-3.0)], 5.0)
    assert alone > 0.1
    points, normals = surface_points(both)
    front_share = float(((points[:, 0] < -0.99) & (normals @ [-1.0, 0, 0] > 0.5)).mean())
    assert coverage(both, CAMERA, [looking_along_x(-3.0)], 5.0) == pytest.approx(front_share, abs=1e-9)
