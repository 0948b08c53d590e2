"""The kernels of the lens are OpenCV's formulas: of `projectPoints` and of the fisheye model."""

import math

import cv2
import numpy as np
import pytest

from uavbench.scenes.camera import Camera, camera_array
from uavbench.trajectories.kernels import lens

K = (310.0, 325.0, 161.0, 118.0)
LENSES = [
    ("none", ()),
    ("radtan", (-0.21, 0.06, 0.004, -0.003)),
    ("radtan", (-0.21, 0.06, 0.004, -0.003, 0.012)),
    ("radtan", (0.0, 0.06, 0.004, -0.003)),
    ("equidistant", (0.02, -0.013, 0.007, -0.004)),
    ("equidistant", (0.0, -0.013, 0.007, -0.004)),
]
POINTS = np.random.default_rng(5).uniform([-1.4, -1.2, 0.5], [1.4, 1.2, 2.5], (300, 3))


def called(kernel):
    """The kernel as Python calls it, compiled or not."""
    return getattr(kernel, "for_python", kernel)


def opencv(points: np.ndarray, model: str, coefficients: tuple[float, ...]) -> np.ndarray:
    fx, fy, cx, cy = K
    matrix, zero = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]]), np.zeros(3)
    project = cv2.fisheye.projectPoints if model == "equidistant" else cv2.projectPoints
    return project(points[:, None], zero, zero, matrix, np.array(coefficients or (0.0,) * 4))[0].reshape(-1, 2)


@pytest.mark.parametrize(("model", "coefficients"), LENSES)
def test_pixels_are_where_opencv_projects_the_points(model: str, coefficients: tuple[float, ...]) -> None:
    array = camera_array(Camera(320, 240, *K, model, coefficients))
    found = np.array([called(lens.project)(*point, array) for point in POINTS.tolist()])
    np.testing.assert_allclose(found, opencv(POINTS, model, coefficients), rtol=0, atol=1e-9)


@pytest.mark.parametrize(("model", "coefficients"), LENSES)
def test_normalized_coordinates_are_those_of_the_pixels(model: str, coefficients: tuple[float, ...]) -> None:
    array = camera_array(Camera(320, 240, *K, model, coefficients))
    flat = POINTS[:, :2] / POINTS[:, 2:]
    found = np.array([called(lens.distort)(x, y, array) for x, y in flat.tolist()])
    expected = (opencv(POINTS, model, coefficients) - K[2:]) / K[:2]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-11)


@pytest.mark.parametrize("far", [0.0, 1e-12, 1e-10, 1e-9, 1e-8, 1e-6])
@pytest.mark.parametrize(("model", "coefficients"), LENSES)
def test_next_to_the_optical_axis_a_lens_does_nothing(model: str, coefficients: tuple[float, ...], far: float) -> None:
    """The equidistant model divides by the distance from the axis, which is 0 on it."""
    array = camera_array(Camera(320, 240, *K, model, coefficients))
    x, y = called(lens.distort)(0.6 * far, -0.8 * far, array)
    tangential = 0.03 * far * far  # of second order
    assert math.hypot(x - 0.6 * far, y + 0.8 * far) <= tangential + 1e-13 * far
    u, v = called(lens.project)(0.0, 0.0, 2.0, array)
    assert (u, v) == K[2:]
