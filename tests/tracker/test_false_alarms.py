"""A track goes on while chance would not find so many edges, and no longer."""

from dataclasses import replace
from math import comb, log10

import numpy as np
import pytest

from tests.tracker.synthetic import CAMERA, Scene, box, box_corners, flown
from uavbench.tracker.robust.config import RobustConfig
from uavbench.tracker.robust.false_alarms import log10_tail
from uavbench.tracker.robust.tracker import Robust
from uavbench.tracker.stage_clock import StageClock
from uavbench.trajectories.pose import Pose

STEP_NS = 66_666_667
KNOWN = 8
"""Frames before the texture changes."""


@pytest.mark.parametrize(("n", "k", "p"), [(20, 15, 0.3), (60, 51, 0.4), (10, 10, 0.5), (200, 90, 0.4)])
def test_the_bound_is_above_the_binomial_tail_and_near_it(n, k, p):
    tail = sum(comb(n, i) * p**i * (1 - p) ** (n - i) for i in range(k, n + 1))
    found = np.zeros(n)
    found[:k] = 1.0
    bound = log10_tail(found, np.full(n, p))
    assert log10(tail) <= bound <= log10(tail) + 1.5


def test_what_chance_finds_too_is_no_evidence():
    assert log10_tail(np.full(30, 0.4), np.full(30, 0.5)) == 0.0
    assert log10_tail(np.full(30, 0.4), np.zeros(30)) == -np.inf


def repainted(log10_false_alarms):
    """Statuses of a flight round a box whose faces change their texture in flight, where much support is asked for.

    So all patches are missed while all edges are found, as where noise hides the texture of a plain facade.
    """
    poses, images = flown(KNOWN + 6, seed=11)
    other, rng = Scene([box_corners()], seed=12), np.random.default_rng(2)
    config = RobustConfig()
    loss = replace(config.loss, log10_false_alarms=log10_false_alarms, min_support=0.8)
    config = replace(config, loss=loss)
    run = Robust(config).start(box(), CAMERA, poses[0], np.random.default_rng(0))
    shown = [*images[:KNOWN], *(other.render(pose, noise_rng=rng) for pose in poses[KNOWN:])]
    results = [run.track(image, i * STEP_NS) for i, image in enumerate(shown)]
    return [result.status for result in results[KNOWN:]]


def test_a_track_goes_on_with_all_edges_where_the_texture_is_gone():
    assert "lost" in repainted(-np.inf)
    assert repainted(RobustConfig().loss.log10_false_alarms) == ["ok"] * 6


@pytest.mark.parametrize("shift_m", [0.06, -0.06, 0.12, -0.12])
def test_a_wrong_pose_is_not_held_by_it(shift_m):
    """The structure jumps aside: what is found at the predicted pose is chance."""
    poses, images = flown(KNOWN, seed=11)
    run = Robust().start(box(), CAMERA, poses[0], np.random.default_rng(0))
    for i, image in enumerate(images):
        run.track(image, i * STEP_NS)
    right = run.state.motion.predict(0.0, run.state.range_m, run.config.motion)
    wrong = Pose(np.eye(3), np.array([shift_m, 0.0, 0.0])) @ right.cam_from_world
    held, missed = (
        run.fitter.fit(images[-1], pose, right.covariance * 4, StageClock(), 5.0)
        for pose in (right.cam_from_world, wrong)
    )
    assert run.state.is_there(held, right)
    assert not run.state.is_there(missed, replace(right, cam_from_world=wrong))
