"""A distance that several edges share moves in the image as a point between them."""

import numpy as np
from hypothesis import example, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from tests.tracker.synthetic import CAMERA, box
from uavbench.tracker.robust.edges.subpixel_kernels import share_motion
from uavbench.tracker.robust.view import View
from uavbench.trajectories.pose import Pose

BESIDE = st.tuples(st.floats(-0.006, 0.006), st.floats(-0.006, 0.006), st.floats(0.5, 30.0))
"""A point in front of the camera: how far x / z and y / z are from those of another, a few pixels, and its depth."""


def number(low, high):
    return st.floats(low, high, allow_nan=False)


def moved_by(points, pose, twist):
    """Motion in px of points (n, 3) in the image, when the camera at a pose is moved by a twist."""
    return CAMERA.project((Pose.exp(twist) @ pose).transform(points)) - CAMERA.project(pose.transform(points))


def between(points, shares, pose):
    """Point and pixel that move as these points by their shares, the point's own at first."""
    point, line = points[0].copy(), np.zeros(4)
    view = View.of(CAMERA, box()).at(pose)
    share_motion(points, np.arange(len(points)), np.array(shares, dtype=float), view, point, line)
    return point, line


@example((0.0, 0.0), [(0.0, 0.0, 1.0), (0.0, 0.004, 2.0)], np.ones(5), np.array([0.0, 0.0, 1.0]), np.zeros(6))
@given(
    st.tuples(number(-0.4, 0.4), number(-0.3, 0.3)),
    st.lists(BESIDE, min_size=2, max_size=5),
    arrays(float, 5, elements=number(0.05, 1.0)),
    arrays(float, 3, elements=number(-1.0, 1.0)),
    arrays(float, 6, elements=number(-1.0, 1.0)),
)
def test_it_moves_as_their_mean_by_shares(at, places, shares, shift, turn):
    pose = Pose.exp(turn)
    seen = np.array([[(at[0] + x) * z, (at[1] + y) * z, z] for x, y, z in places])
    points, shares = pose.inverse().transform(seen), shares[: len(places)] / shares[: len(places)].sum()
    point, line = between(points, shares, pose)
    np.testing.assert_allclose(line[:2], shares @ CAMERA.project(seen), atol=1e-6)
    small = np.concatenate([1e-4 * shift * seen[:, 2].min(), np.zeros(3)])
    rigid, mean = moved_by(point[None], pose, small)[0], shares @ moved_by(points, pose, small)
    across = CAMERA.fx * np.linalg.norm(small) / seen[:, 2].min()  # along the axis pixels near its middle hardly move
    np.testing.assert_allclose(rigid, mean, atol=0.02 * across + 1e-6)


def test_an_edge_without_light_has_no_part_in_it():
    pose = Pose(np.eye(3), np.zeros(3))
    points = np.array([[0.0, 0.0, 2.0], [0.02, 0.0, 2.4]])
    for shares in ([0.0, 1.0], [-0.2, 1.2]):
        point, line = between(points, shares, pose)
        np.testing.assert_allclose(point, points[1])
        np.testing.assert_allclose(line[:2], CAMERA.project(points[1:])[0])
    point, _ = between(points, [-0.5, -0.5], pose)
    np.testing.assert_array_equal(point, points[0])
