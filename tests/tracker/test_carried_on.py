"""A structure that leaves the view while the camera flies on is sought where its mean velocity leads."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.tracker.synthetic import CAMERA, Scene, box, box_corners, look_at, pose_error
from uavbench.tracker.robust.motion_model import Motion, isotropic_covariance
from uavbench.tracker.robust.tracker import Robust
from uavbench.trajectories.pose import Pose

MEMORY_S, RATE_HZ = 1.0, 15
KNOWN = isotropic_covariance(0.001, 1.0)


def followed(motion, steps_s, twists):
    """Motion after steps, in each of which the camera moved with a constant twist (6,)."""
    for step_s, twist in zip(steps_s, twists, strict=True):
        moved = Pose.exp(step_s * np.asarray(twist)) @ motion.cam_from_world
        motion = motion.update(moved, KNOWN, step_s, MEMORY_S)
    return motion


@given(
    st.lists(st.floats(-1.0, 1.0), min_size=6, max_size=6),
    st.lists(st.floats(0.01, 0.5), min_size=1, max_size=8),
    st.floats(0.0, 3.0),
)
def test_a_constant_twist_is_carried_on_exactly_whatever_the_intervals(twist, steps_s, dt_s):
    """On a circle or a straight line, at any time after."""
    start = Motion(Pose.exp([0.3, -0.2, 2.0, 0.1, 0.4, -0.3]), KNOWN)
    motion = followed(start, steps_s, [twist] * len(steps_s))
    expected = Pose.exp(dt_s * np.asarray(twist)) @ motion.cam_from_world
    np.testing.assert_allclose(motion.carried_on(dt_s).matrix, expected.matrix, atol=1e-7)


def test_a_wobble_about_a_velocity_is_not_carried_on():
    """Of a wobble with one second's memory less than a tenth of its velocity is left, of the mean all of it."""
    mean, wobble = np.array([0.2, 0, 0, 0, 0.1, 0]), np.array([0.0, 0.1, 0, 0, 0, 0.1])
    twists = [mean + wobble * (-1) ** k for k in range(4 * RATE_HZ)]
    motion = followed(Motion(Pose.identity(), KNOWN), [1 / RATE_HZ] * len(twists), twists)
    assert np.abs(motion.mean_velocity - mean).max() < 0.1 * wobble.max()
    assert np.abs(motion.velocity - mean).max() > 0.9 * wobble.max()


def test_without_a_velocity_it_stays():
    still = Motion(Pose.exp([0.3, -0.2, 2.0, 0.1, 0.4, -0.3]), KNOWN)
    assert still.carried_on(5.0) is still.cam_from_world


@pytest.mark.parametrize("rate_rad_s", [0.25, -0.2])
def test_a_camera_that_orbits_on_unseen_is_found_within_ten_frames(rate_rad_s):
    """For four seconds nothing is seen; meanwhile it turns by a radian, to other faces."""
    before, unseen, after = 2 * RATE_HZ, 4 * RATE_HZ, 10
    angles = 0.5 + rate_rad_s * np.arange(before + unseen + after) / RATE_HZ
    poses = [look_at(1.3 * np.array([np.cos(a), np.sin(a), 0.6]), (0.0, 0.0, 0.15)) for a in angles]
    rng, scene = np.random.default_rng(7), Scene([box_corners()], seed=7)
    run = Robust().start(box(), CAMERA, poses[0], np.random.default_rng(0))
    results = []
    for k, pose in enumerate(poses):
        blank = before <= k < before + unseen
        noise = np.clip(rng.normal(128, 3, (CAMERA.height, CAMERA.width, 3)), 0, 255).astype(np.uint8)
        image = noise if blank else scene.render(pose, noise_rng=rng)
        results.append(run.track(image, round(k * 1e9 / RATE_HZ)))
    assert {result.status for result in results[before + 1 : before + unseen]} == {"lost"}
    found = results[before + unseen :]
    assert "ok" in [result.status for result in found]
    for result, pose in zip(found, poses[before + unseen :], strict=True):
        assert result.status != "ok" or pose_error(result.cam_from_world, pose)[0] < 0.01
