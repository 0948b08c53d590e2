"""A result whose status and pose do not agree says which of the two is wrong."""

from typing import Any

import pytest

from uavbench.tracker.protocol import TrackResult
from uavbench.trajectories.pose import Pose


@pytest.mark.parametrize(
    ("status", "pose", "told"),
    [
        ("OK", Pose.identity(), "the status 'OK' is none of ok, ambiguous, lost, not_initialized"),
        ("LOST", None, "the status 'LOST' is none of ok, ambiguous, lost, not_initialized"),
        (True, Pose.identity(), "the status True is none of ok"),
        ("ok", None, "the status is ok, and cam_from_world is None: a frame without a pose has the status lost"),
        ("lost", Pose.identity(), "the status is lost, and cam_from_world is given: a frame with a pose is ok"),
    ],
)
def test_a_wrong_status_is_told_with_the_valid_ones(status: Any, pose: Pose | None, told: str) -> None:
    with pytest.raises(ValueError, match=told):
        TrackResult(status=status, cam_from_world=pose)
