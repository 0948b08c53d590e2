"""When a track of little support goes on: whether a pose is searched, and how near the prediction it has to be."""

from dataclasses import replace

import numpy as np
import pytest

from tests.tracker.third_frame import third_frame
from uavbench.tracker.geometry_kernels import se3_exp_left
from uavbench.tracker.robust.decision.decider import SEARCH_EVERY, Decision
from uavbench.tracker.robust.fit.false_alarms import Chance
from uavbench.tracker.robust.motion_model import PredictionErrors
from uavbench.tracker.robust.relocalization.relocate import Relocalized
from uavbench.tracker.stage_clock import StageClock
from uavbench.trajectories.pose import Pose


@pytest.fixture(scope="module")
def tracked():
    """The run of a box, two frames old, and the fit of the third one."""
    return third_frame()


@pytest.mark.parametrize(
    ("support", "log10_chance", "due"),
    [
        (0.55, -30.0, False),
        (0.55, -9.1, False),
        (0.55, -8.9, True),
        (0.65, -30.0, False),
        (0.65, -8.9, True),
        (0.45, -30.0, True),
    ],
)
def test_a_search_is_not_put_off_where_chance_may_have_found_the_fit(tracked, support, log10_chance, due):
    """A thousand million poses of a search: chance is expected to find as much at one where that is 1e-9 for each."""
    tracked.run.decider.until_search, tracked.run.decider.searched_suspect = SEARCH_EVERY, False
    fit = replace(tracked.fit, support=support, chance=Chance(log10_chance, log10_chance))
    assert tracked.run.decider.search_is_due(tracked.frame, fit) == due


def test_the_search_for_a_fit_that_chance_may_have_found_is_put_off_once_it_was_made(tracked):
    decider, fit = tracked.run.decider, replace(tracked.fit, support=0.65, chance=Chance(-8.9, -8.9))
    decider.until_search = SEARCH_EVERY
    for searched_suspect in (False, True):
        decider.searched_suspect = searched_suspect
        assert decider.search_is_due(tracked.frame, fit) != searched_suspect
    decider.until_search = -1
    assert decider.search_is_due(tracked.frame, fit)


@pytest.mark.parametrize(
    ("step_s", "log10_chance", "support", "due"),
    [
        (0.2, -11.0, 0.7, True),
        (0.2, -11.0, 0.9, False),
        (0.2, -19.1, 0.7, False),
        (0.1, -11.0, 0.7, False),
    ],
)
def test_less_support_than_usual_is_compared_where_there_is_budget_and_doubt(
    tracked, monkeypatch, step_s, log10_chance, support, due
):
    """Usual is 0.9 here: at 5 Hz a box whose side lies on the lines of a floor has 0.79, and 1e-9 of it by chance."""
    monkeypatch.setattr(tracked.run.state, "usual_support", 0.9)
    fit = replace(tracked.fit, support=support, chance=Chance(log10_chance, log10_chance))
    assert tracked.run.decider.search_is_due(tracked.frame._replace(step_s=step_s), fit) == due


def test_after_a_long_interval_support_alone_counts(tracked):
    """The pose is then compared with those at which the structure looks alike, whatever chance may have found."""
    fit = replace(tracked.fit, support=0.99, chance=Chance(0.0, 0.0))
    late = tracked.frame._replace(extrapolated_s=1.0)
    assert tracked.run.decider.search_is_due(tracked.frame, fit)
    assert not tracked.run.decider.search_is_due(late, fit)


@pytest.mark.parametrize(("errors", "goes_on"), [(PredictionErrors(), True), (PredictionErrors(0.06, 10.0), False)])
def test_a_track_of_little_support_goes_on_where_the_predictions_of_the_run_are_as_far_off(tracked, errors, goes_on):
    """One standard deviation from a prediction is far where predictions are usually off by a thirtieth of one."""
    state, predicted = tracked.run.state, tracked.frame.predicted
    aside = se3_exp_left(
        predicted.cam_from_world.rotation,
        predicted.cam_from_world.translation,
        np.sqrt(np.diag(predicted.covariance)) * np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0]),
    )
    fit = replace(tracked.fit, cam_from_world=Pose(*aside), edge_support=0.6, chance=Chance(-7.0, -7.0))
    assert replace(state, prediction_errors=errors).is_there(fit, predicted, recent=True) == goes_on


@pytest.mark.parametrize(("step_s", "put_off"), [(0.067, True), (0.1, True), (0.2, False)])
def test_a_search_is_put_off_only_where_frames_have_the_least_budget(tracked, monkeypatch, step_s, put_off):
    """Eight frames at 5 Hz are 1.6 s, in which a track of little support slips to neighbouring edges."""
    decider, fit = tracked.run.decider, replace(tracked.fit, support=0.55, chance=Chance(-30.0, -30.0))
    decider.until_search = -1
    monkeypatch.setattr(decider, "recover", lambda frame, fit: Decision(fit, True))
    frame = tracked.frame._replace(step_s=step_s)
    decider.initialized_or_recovered(frame, fit, StageClock())
    decider.until_search -= 1
    assert decider.search_is_due(frame, fit) != put_off


@pytest.mark.parametrize(
    ("step_s", "near_done", "alone"), [(0.067, False, False), (0.2, False, True), (0.2, True, False)]
)
def test_a_track_goes_on_by_the_fit_that_begins_where_it_ends(tracked, monkeypatch, step_s, near_done, alone):
    """Where the prediction is off, the points of the fit from there are partly those that the pose does not show.

    Where frames have time for more, likely poses are compared with it first: at 5 Hz it may be at the next edges.
    """
    decider, frame = tracked.run.decider, tracked.frame._replace(step_s=step_s)
    weak = replace(tracked.fit, support=0.45, edge_support=0.45, chance=Chance(-2.0, -2.0))
    again = replace(tracked.fit, support=0.57, edge_support=0.57, chance=Chance(-14.0, -14.0))
    outcome = Relocalized(again, 0.12, False, False, False, False, True, (), ())
    for found, settled in ((outcome, True), (outcome._replace(fit=weak), False)):
        found = found._replace(near_done=near_done)
        monkeypatch.setattr(tracked.run.state, "is_lost", True)
        monkeypatch.setattr(decider.relocator, "search", lambda sought, found=found: found)
        decision = decider.recover(frame, weak)
        assert decision.settled == (settled and not alone) and decision.fit is found.fit


@pytest.mark.parametrize(("aside", "status"), [(0.0, "ok"), (0.2, "ambiguous")])
def test_a_track_is_not_ok_while_a_search_finds_a_likelier_pose_elsewhere(tracked, monkeypatch, aside, status):
    """Neither leads: the track's fit has been drawn along by what passes, or the other one is a chance find."""
    decider, frame, state = tracked.run.decider, tracked.frame, tracked.run.state
    weak = replace(tracked.fit, support=0.71, chance=Chance(-7.7, -7.7))
    turned = se3_exp_left(weak.cam_from_world.rotation, weak.cam_from_world.translation, np.full(6, aside))
    other = replace(weak, cam_from_world=Pose(*turned), support=0.73, chance=Chance(-12.3, -12.3))
    found = Relocalized(other, 0.02, False, False, False, False, False, (), ())
    monkeypatch.setattr(decider.relocator, "search", lambda sought: found)
    monkeypatch.setattr(state, "is_lost", False)
    monkeypatch.setattr(state, "usual_support", 0.85)
    decision = decider.recover(frame, weak)
    assert decision.settled == (status == "ok") and decision.rivalled == (status == "ambiguous")
    assert decision.fit is (weak if status == "ok" else other)
