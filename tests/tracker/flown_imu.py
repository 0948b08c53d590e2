"""A smooth motion in closed form, and what perfect and imperfect sensors measure of it."""

import numpy as np

from uavbench.tracker.fusion.state import STANDARD_GRAVITY_M_S2
from uavbench.tracker.protocol import TrackResult
from uavbench.trajectories.pose import Pose, rotation_exp, rotation_log

CAM_FROM_BODY = Pose(np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]]), np.array([0.02, -0.01, 0.05]))
SIZE_M, SWING_RAD = np.array([2.0, 1.0, 0.3]), np.array([0.2, 0.15, 0.8])
PLACE_RAD_S, TURN_RAD_S = np.array([0.7, 1.1, 0.5]), np.array([1.3, 0.9, 0.6])


def world_from_body(t):
    """Pose at time t in s."""
    return Pose(rotation_exp(SWING_RAD * np.sin(TURN_RAD_S * t)), SIZE_M * np.sin(PLACE_RAD_S * t) + [0, 0, 1.5])


def velocity(t):
    return SIZE_M * PLACE_RAD_S * np.cos(PLACE_RAD_S * t)


def body_rate(t, h=1e-5):
    """Central difference of the rotation, good to 1e-10 rad/s."""
    before, after = world_from_body(t - h).rotation, world_from_body(t + h).rotation
    return rotation_log(before.T @ after) / (2 * h)


def specific_force(t):
    acceleration = -SIZE_M * PLACE_RAD_S**2 * np.sin(PLACE_RAD_S * t)
    return world_from_body(t).rotation.T @ (acceleration + np.array([0, 0, STANDARD_GRAVITY_M_S2]))


def camera_answer(t, covariance, error=None):
    """The answer of a tracker that errs by the twist `error`."""
    true = CAM_FROM_BODY @ world_from_body(t).inverse()
    error = np.zeros(6) if error is None else error
    return TrackResult(status="ok", cam_from_world=Pose.exp(-error) @ true, covariance=covariance)
