"""The pose search's kernels against closed forms."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from uavbench.scenes.camera import Camera
from uavbench.tracker.geometry_kernels import RigidMotion
from uavbench.tracker.robust.relocalization.scoring.edge_pixel_kernels import ORIENTATIONS
from uavbench.tracker.robust.relocalization.scoring.pose_search_kernels import SmallCamera, orientation, seen_alike
from uavbench.trajectories.pose import Pose

NOT_TINY = st.floats(-1e6, 1e6).filter(lambda x: x == 0.0 or abs(x) > 1e-6)


def bins_from_angle(x, y):
    """Bins that the angle of a line along (x, y) may be in: two where it is within rounding of their border."""
    turn = math.atan2(y, x) / math.pi * ORIENTATIONS
    return {math.floor(turn + e) % ORIENTATIONS for e in (-1e-9, 1e-9)}


@given(NOT_TINY, NOT_TINY)
def test_a_line_is_in_the_bin_of_its_angle(x, y):
    if x or y:
        assert orientation.for_python(x, y) in bins_from_angle(x, y)
        assert orientation.for_python(-x, -y) == orientation.for_python(x, y)


@pytest.mark.parametrize("k", range(ORIENTATIONS))
def test_the_middle_of_each_bin_is_in_it(k):
    angle = (k + 0.5) * math.pi / ORIENTATIONS
    assert orientation.for_python(math.cos(angle), math.sin(angle)) == k


def test_axes_begin_a_bin():
    found = [orientation.for_python(x, y) for x, y in np.array([[1, 0], [0, 1], [-1, 0], [0, -1]], dtype=float)]
    assert found == [0, ORIENTATIONS // 2, 0, ORIENTATIONS // 2]


@settings(max_examples=50, deadline=None)
@given(seed=st.integers(0, 10**6), spread=st.floats(0.001, 0.3), step_px=st.floats(0.5, 20.0))
def test_poses_look_alike_where_no_point_moves_by_a_step(seed, spread, step_px):
    rng = np.random.default_rng(seed)
    camera = Camera(160, 120, 130.0, 125.0, 80.0, 61.0)
    small = SmallCamera(np.array([130.0, 125.0, 80.0, 61.0]), np.array([160.0, 120.0]), 0.01)
    points, here = rng.uniform(-1, 1, (12, 3)), Pose(np.eye(3), np.array([0.0, 0.0, 5.0]))
    poses = [Pose.exp(rng.normal(scale=spread, size=6)) @ here for _ in range(20)]
    moved = [camera.project(pose.transform(points)) - camera.project(here.transform(points)) for pose in poses]
    farthest_px = np.abs(moved).max(axis=(1, 2))
    R, t = np.array([pose.rotation for pose in poses]), np.array([pose.translation for pose in poses])
    found = seen_alike(points, RigidMotion(np.eye(3), np.array([0.0, 0.0, 5.0])), R, t, small, step_px)
    assert found[farthest_px < step_px - 1e-9].all()
    assert not found[farthest_px > step_px + 1e-9].any()
