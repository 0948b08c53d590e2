"""Poses near a prediction: taken before all others were compared where the motion tells, and not before it does."""

from dataclasses import replace

import numpy as np
import pytest

from tests.tracker.synthetic import BOX_TRIANGLES, CAMERA, Scene, box, box_corners, flown, look_at
from uavbench.scenes.structure import Structure
from uavbench.tracker.robust.fit.false_alarms import Chance
from uavbench.tracker.robust.motion_model import isotropic_covariance
from uavbench.tracker.robust.relocalization.relocate import Relocalized
from uavbench.tracker.robust.tracker import Robust
from uavbench.tracker.stage_clock import StageClock
from uavbench.trajectories.pose import Pose

STEP_NS = 200_000_000
KNOWN = 4
PANEL_M, RANGE_M = 0.3, 0.9


@pytest.fixture(scope="module")
def flight():
    return flown(3 * KNOWN + 1, seed=11)


def known(flight, frames):
    """A run at 5 Hz after these frames, the next one, and the right fit to it."""
    run = Robust().start(box(), CAMERA, flight.poses[0], np.random.default_rng(0))
    for k in range(frames):
        assert run.track(flight.images[k], k * STEP_NS).status == "ok"
    assert run.frames.is_new(flight.images[frames], frames * STEP_NS)
    frame = run.frames.prepared(flight.images[frames], frames * STEP_NS, None, StageClock())
    right = run.follower.fit(frame, StageClock())
    return run, frame, replace(right, support=0.85 * run.state.usual_support)  # enough, but not for a search to end


def decided(run, frame, found, **progress):
    """The decision where a track went astray, and a slice that ended before all likely poses were fitted found this."""
    outcome = Relocalized(found, 0.5, False, False, True, False, True, (), ())
    run.decider.relocator.search = lambda sought: outcome._replace(**progress)
    astray = replace(found, support=0.1, edge_support=0.1, chance=Chance(0.0, 0.0))
    return run.decider.decide(frame, astray, StageClock())


def test_a_search_need_not_end_where_the_motion_tells_which_of_its_poses_is_the_one(flight):
    run, frame, right = known(flight, KNOWN)
    assert not run.decider.is_slow(frame) and not run.config.budget.is_least(frame.step_s)
    decision = decided(run, frame, right)
    assert decision.settled and decision.fit.cam_from_world is right.cam_from_world


@pytest.mark.parametrize("progress", [{"leads": False}, {"expected": False}])
def test_it_has_to_where_another_pose_is_as_good_or_it_is_far_away(flight, progress):
    run, frame, right = known(flight, KNOWN)
    assert not decided(run, frame, right, **progress).settled


def test_it_has_to_where_as_much_is_found_by_chance_or_support_is_less_than_usual(flight):
    """Near the prediction chance would not find as much, but among all poses of a search."""
    run, frame, right = known(flight, KNOWN)
    near = replace(right, chance=Chance(-11.0, -11.0))
    assert run.state.holds(near, frame.predicted, False, True)
    assert not decided(run, frame, near).settled
    little = replace(right, support=0.7 * run.state.usual_support, chance=Chance(-15.0, -15.0))
    assert run.state.holds(little, frame.predicted, False, True)
    assert not decided(run, frame, little).settled
    assert decided(run, frame, replace(little, chance=Chance(-25.0, -25.0))).settled


def test_it_has_to_before_a_velocity_is_known(flight):
    run, frame, right = known(flight, 1)
    assert run.state.motion.velocity is None
    assert not decided(run, frame, right).settled


@pytest.mark.parametrize(("step_ns", "compared"), [(STEP_NS, True), (STEP_NS // 3, False)])
def test_before_a_velocity_is_known_a_pose_that_looks_like_another_one_is_compared_with_it(step_ns, compared):
    """In the middle of a long row of boxes the second frame shows the same from one box beside."""
    corners = [box_corners((0.12, 0.15, 0.25), ((k - 7) * PANEL_M, 0.0)) for k in range(15)]
    triangles = np.concatenate([BOX_TRIANGLES + 8 * k for k in range(len(corners))])
    pose = look_at(np.array([0.0, -RANGE_M, 0.35]), (0.03, 0.0, 0.12))
    scene, rng = Scene(corners, seed=2), np.random.default_rng(3)
    structure = Structure.from_mesh(np.concatenate(corners), triangles)
    run = Robust().start(structure, CAMERA, pose, np.random.default_rng(0))
    images = [scene.render(pose, noise_rng=rng) for _ in range(2)]
    assert run.track(images[0], 0).status == "ok"
    assert run.frames.is_new(images[1], step_ns)
    frame = run.frames.prepared(images[1], step_ns, None, StageClock())
    beside = Pose(pose.rotation, pose.translation - pose.rotation @ np.array([PANEL_M, 0.0, 0.0]))
    fit = run.fitter.fit(frame.image, beside, isotropic_covariance(0.005, RANGE_M), StageClock())
    assert fit.support > run.config.loss.min_support
    decision = run.decider.confirmed(frame, fit, StageClock())
    assert (decision.settled and decision.fit is fit) != compared
