"""A model in millimetres or kilometres is tracked like the same one in metres."""

import numpy as np
import pytest

from tests.tracker.synthetic import CAMERA, Scene, box, box_corners, orbit, pose_error
from uavbench.tracker.robust.config.robust import MotionConfig
from uavbench.tracker.robust.motion_model import Motion
from uavbench.tracker.robust.tracker import Robust
from uavbench.trajectories.pose import Pose

STEP_NS = 133_333_333
SIZE = np.array([0.4, 0.3, 0.3])


@pytest.fixture(scope="module")
def flight():
    """Poses and frames of 1.3 seconds around a box, at 7.5 Hz."""
    poses = orbit(20, seed=11)[::2]
    scene = Scene([box_corners()], seed=11)
    rng = np.random.default_rng(11)
    return poses, [scene.render(pose, noise_rng=rng) for pose in poses]


@pytest.mark.parametrize("unit", [0.001, 0.1, 1000.0])
def test_the_unit_of_the_model_does_not_matter(flight, unit):
    poses, images = flight
    first = Pose(poses[0].rotation, poses[0].translation * unit)
    run = Robust().start(box(SIZE * unit), CAMERA, first, np.random.default_rng(0))
    for i, (pose, image) in enumerate(zip(poses, images, strict=True)):
        result = run.track(image, i * STEP_NS)
        assert result.status == "ok"
        there = Pose(result.cam_from_world.rotation, result.cam_from_world.translation / unit)
        assert pose_error(there, pose)[0] < 0.01


def test_motion_is_expected_in_ranges_where_the_structure_is_far():
    motion = Motion(Pose(np.eye(3), np.zeros(3)), np.zeros((6, 6)), np.zeros(6))
    near, far, farther = (motion.predict(0.1, range_m, MotionConfig()).covariance for range_m in (0.1, 100.0, 1000.0))
    assert farther[0, 0] == pytest.approx(100.0 * far[0, 0])
    assert 0 < near[0, 0] < far[0, 0]
    assert far[3, 3] == near[3, 3]
