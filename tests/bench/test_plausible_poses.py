"""True poses of one's own that nobody measured."""

import re
from dataclasses import replace

import numpy as np
import pytest

from uavbench.bench.own_images.plausible_poses import doubts_of_poses
from uavbench.trajectories.trajectory import Trajectory


@pytest.mark.parametrize(("lost", "told"), [
    ([0.0, 0.0, 0.0], r"the ground truth .* is at 0, 0, 0 in 2 of 20 poses, .*as at 0.400 s: did motion capture lose"),
    (None, r"the ground truth .* stays at one pose, to the last digit, in 7 of 20 poses, .* from 0.133 s on: did"),
])  # fmt: skip
def test_rows_of_lost_markers_are_doubted(lost, told):
    """Of a straight flight at one speed; a camera that stands still, and goes on from there, is none."""
    straight = np.arange(20)[:, None] * [0.1, 0.02, 0.0] + [1.0, 0.0, 1.0]
    flown = Trajectory(np.arange(20) * 66_666_667, straight, np.tile([1.0, 0.0, 0.0, 0.0], (20, 1)))
    assert list(doubts_of_poses("poses.tum", flown)) == []
    stood = np.vstack([straight[:8], np.repeat(straight[8:9], 6, axis=0), straight[9:15]])
    assert list(doubts_of_poses("poses.tum", replace(flown, positions_m=stood))) == []
    straight[slice(6, 8) if lost else slice(2, 9)] = lost or straight[2]
    (found,) = doubts_of_poses("poses.tum", replace(flown, positions_m=straight))
    assert re.search(told, found)


@pytest.mark.parametrize(("rows", "next_m", "told"), [(6, 8.0, False), (5, 9.0, False), (6, 9.0, True)])
def test_a_pose_is_lost_that_lasts_for_more_than_five_rows_and_jumps_by_more_than_five_steps(rows, next_m, told):
    x = [1.0, 2.0, *[3.0] * rows, *(next_m + np.arange(6))]
    positions = np.column_stack([x, np.zeros((len(x), 2))])
    flown = Trajectory(np.arange(len(x)) * 10_000_000, positions, np.tile([1.0, 0.0, 0.0, 0.0], (len(x), 1)))
    assert bool(list(doubts_of_poses("poses.tum", flown))) == told
