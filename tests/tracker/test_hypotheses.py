"""Hypotheses of an undecided run: what they predict, which are kept, and what an unfitted rival is taken for."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.tracker.synthetic import BOX_TRIANGLES, CAMERA, Scene, box_corners, look_at
from uavbench.scenes.structure import Structure
from uavbench.tracker.robust.config import RobustConfig
from uavbench.tracker.robust.fit.edge_fit import EdgeFitter
from uavbench.tracker.robust.fit.false_alarms import Chance
from uavbench.tracker.robust.fit.pose_fit import Fit
from uavbench.tracker.robust.motion_model import Motion, isotropic_covariance
from uavbench.tracker.robust.relocalization.ranking import Contender, Likely, Sought
from uavbench.tracker.robust.relocalization.relocate import Relocator
from uavbench.tracker.robust.solver.solve_kernels import UNKNOWNS
from uavbench.tracker.robust.track_state import Told, TrackState
from uavbench.tracker.stage_clock import StageClock
from uavbench.trajectories.pose import Pose

CONFIG = RobustConfig()
LEAD = CONFIG.relocalization.lead
RANGE_M, SIGMA = 2.0, 0.05
STEP_NS = 500_000_000
PANEL_M, COUNT = 0.3, 15


def at(x_m):
    return Pose.exp(np.array([x_m, 0.0, RANGE_M, 0.0, 0.0, 0.0]))


def fit(x_m, support, log10_chance=-20.0):
    covariance, chance = isotropic_covariance(0.001, RANGE_M), Chance(log10_chance, log10_chance)
    return Fit(at(x_m), covariance, support, 50, 50, 50, RANGE_M, chance=chance)


def tracked(speed_m_s):
    """State of a run that was ok until now and moves along x."""
    motion = Motion(at(0.0), isotropic_covariance(0.001, RANGE_M), np.array([speed_m_s, 0, 0, 0, 0, 0.0]))
    told = Told(motion, RANGE_M, 0.0)
    return TrackState(CONFIG, motion, RANGE_M, ok_ns=0, usual_support=0.7, frames_ok=5, told=told)


def followed(state, frames):
    """Suppose the contenders of each frame; a contender is its x in m, support, worth, and what it follows."""
    for k, contenders in enumerate(frames, 1):
        predicted = state.predicted(k * STEP_NS * 1e-9, k * STEP_NS)
        likely = state.likely(predicted, k * STEP_NS)
        rows = [Contender(fit(x_m, support), worth, follows) for x_m, support, worth, follows in contenders]
        state.suppose(rows, likely, k * STEP_NS * 1e-9, k * STEP_NS)
    return [each.cam_from_world.translation[0] for each, *_ in state.hypotheses]


@given(st.floats(0.01, 1.0), st.floats(-0.1, 0.0), st.floats(0.0, 50.0))
def test_the_prior_of_a_pose_falls_by_the_lead_where_it_is_ten_times_less_likely(scale, worth, chi2):
    likely = Likely(Motion(at(0.0), isotropic_covariance(SIGMA, RANGE_M)), worth, scale)
    away = at(math.sqrt(chi2) * SIGMA * RANGE_M)
    assert likely.prior(away, LEAD) == pytest.approx(worth - LEAD * math.log10(1 + chi2 / (UNKNOWNS * scale)))
    tenth = at(math.sqrt(9 * UNKNOWNS * scale) * SIGMA * RANGE_M)
    assert likely.prior(tenth, LEAD) == pytest.approx(worth - LEAD)


def test_two_hypotheses_are_kept_side_by_side_each_with_its_own_motion():
    state = tracked(speed_m_s=0.2)
    found = followed(state, [
        [(0.1, 0.70, 0.70, 0), (0.4, 0.69, 0.66, 0)],
        [(0.2, 0.70, 0.70, 0), (0.5, 0.70, 0.68, 1)],
    ])  # fmt: skip
    assert found == pytest.approx([0.2, 0.5])
    likely = state.likely(state.predicted(1.5, 3 * STEP_NS), 3 * STEP_NS)
    steps = [each.predicted.cam_from_world.translation[0] - x for each, x in zip(likely, found, strict=True)]
    assert steps == pytest.approx([steps[0]] * 2, abs=1e-9)  # both went 0.1 m in the last frame
    assert 0.05 < steps[0] < 0.1
    assert [each.worth for each in likely] == pytest.approx([0.0, -0.02])


def test_predictions_of_a_hypothesis_that_jumped_are_believed_less_than_those_of_one_that_went_on():
    state = tracked(speed_m_s=0.2)
    frames = [[(0.1 * k, 0.7, 0.7, 0), (0.1 * k + (-1) ** k * 0.6, 0.7, 0.68, 1 if k > 1 else 0)] for k in (1, 2, 3, 4)]
    followed(state, frames)
    steady, jumping = state.likely(state.predicted(2.5, 5 * STEP_NS), 5 * STEP_NS)
    assert steady.scale < 0.5 * jumping.scale


def test_from_a_place_to_another_one_that_looks_alike_nothing_moves():
    """Found 2.4 m beside its place after 10 s, and there in the next frame: that is no velocity of 36 m/s."""
    state, since_ns, step_ns = tracked(speed_m_s=0.2), 10_000_000_000, 66_666_667
    for stamp_ns, x_m in ((since_ns, 2.4), (since_ns + step_ns, 0.0)):
        likely = state.likely(state.predicted(stamp_ns * 1e-9, stamp_ns), stamp_ns)
        state.suppose([Contender(fit(x_m, 0.7), 0.7)], likely, stamp_ns * 1e-9, stamp_ns)
    stamp_ns += step_ns
    (only,) = state.likely(state.predicted(stamp_ns * 1e-9, stamp_ns), stamp_ns)
    assert abs(only.predicted.cam_from_world.translation[0]) < 0.05


def test_where_the_camera_may_be_is_told_by_the_last_pose_that_was_told():
    """A track that is followed without being believed went 2.4 m aside: that says nothing of where it may be."""
    state, told = tracked(speed_m_s=0.0), tracked(speed_m_s=0.0)
    state.learn(state.predicted(0.5, STEP_NS), fit(2.4, 0.7), 0.5, STEP_NS, 0.5)
    assert state.motion.cam_from_world.translation[0] == pytest.approx(2.4)
    for each, same in zip(state.within(1.0).reach, told.within(1.0).reach, strict=True):
        np.testing.assert_allclose(each.cam_from_world.translation, same.cam_from_world.translation)
        np.testing.assert_allclose(each.covariance, same.covariance)
    state.told = Told(state.motion, RANGE_M, 0.5)
    assert all(each.cam_from_world.translation[0] > 2.3 for each in state.within(0.5).reach)


@pytest.mark.parametrize("unsound", [(0.4, -18.0), (float("nan"), -18.0), (0.9, -5.0)])
def test_a_frame_whose_best_fit_is_weak_or_by_chance_leaves_the_hypotheses_as_they_are(unsound):
    state = tracked(speed_m_s=0.2)
    before = followed(state, [[(0.1, 0.7, 0.7, 0), (0.4, 0.7, 0.68, 0)]])
    kept = state.hypotheses
    weak = [Contender(fit(0.9, *unsound), 0.9), Contender(fit(5.0, 0.7), 0.3)]
    state.suppose(weak, state.likely(state.motion, 2 * STEP_NS), 1.0, 2 * STEP_NS)
    assert state.hypotheses is kept
    assert before == pytest.approx([0.1, 0.4])


def test_a_fit_of_little_support_whose_edges_leave_no_doubt_is_kept():
    """Of a side that a run sees for the first time a third is found as known, but no search finds as much by chance."""
    state = tracked(speed_m_s=0.2)
    rows = [Contender(fit(0.1, 0.3, -20.0), 0.3)]
    state.suppose(rows, state.likely(state.motion, STEP_NS), 0.5, STEP_NS)
    assert [each.motion.cam_from_world.translation[0] for each in state.hypotheses] == [0.1]


def test_an_accepted_pose_ends_all_hypotheses():
    state = tracked(speed_m_s=0.2)
    followed(state, [[(0.1, 0.7, 0.7, 0), (0.4, 0.7, 0.68, 0)]])
    predicted = state.predicted(1.0, 2 * STEP_NS)
    state.learn(predicted, fit(0.2, 0.8), 1.0, 2 * STEP_NS, 0.5)
    assert not state.hypotheses
    (only,) = state.likely(predicted, 3 * STEP_NS)
    assert only.predicted is predicted
    assert only.worth == 0.0


@pytest.mark.parametrize("hypotheses", [0, 2])
def test_once_its_velocity_is_forgotten_the_camera_may_be_as_far_as_an_unknown_one_leads(hypotheses):
    state = tracked(speed_m_s=0.2)
    last_ns = state.ok_ns
    if hypotheses:
        followed(state, [[(0.1, 0.70, 0.70, 0), (0.4, 0.69, 0.66, 0)]])
        last_ns = state.hypotheses[0].stamp_ns
    motion, before = state.config.motion, []
    for lost_s in (0.9 * motion.memory_s, 3.0 * motion.memory_s):
        stamp_ns = last_ns + round(lost_s * 1e9)
        predicted = state.predicted((stamp_ns - state.ok_ns) * 1e-9, stamp_ns)
        likely = state.likely(predicted, stamp_ns)
        unknown = motion.initial_rate_1_s * max(0.0, lost_s - motion.memory_s)
        least = [each.predicted.covariance[3, 3] - unknown**2 for each in likely]
        assert len(likely) == max(1, hypotheses)
        assert all(0.0 < each <= motion.max_sigma**2 + 0.01 for each in least)
        assert not unknown or all(each.scale == 1.0 for each in likely)
        before.append(least)
    assert before[0] <= before[1]


@pytest.fixture(scope="module")
def lattice():
    """A long row of equal boxes, its frame from the middle, and the fit there."""
    corners = [box_corners((0.12, 0.15, 0.25), ((k - COUNT // 2) * PANEL_M, 0.0)) for k in range(COUNT)]
    triangles = np.concatenate([BOX_TRIANGLES + 8 * k for k in range(COUNT)])
    fitter = EdgeFitter(
        Structure.from_mesh(np.concatenate(corners), triangles), CAMERA, np.random.default_rng(0), CONFIG
    )
    pose = look_at(np.array([0.0, -0.9, 0.35]), (0.03, 0.0, 0.12))
    image = Scene(corners, seed=2).render(pose, noise_rng=np.random.default_rng(3))
    fitter.begin(0, 1.0)
    first = fitter.fit(image, pose, isotropic_covariance(0.005, 0.9), StageClock())
    return fitter, image, first


@pytest.mark.parametrize(("scale", "room", "leads"), [
    (1.0, True, False), (1.0, False, False), (0.001, True, True), (0.001, False, True),
])  # fmt: skip
def test_a_rival_that_was_not_fitted_is_no_proof_that_there_is_none(lattice, scale, room, leads):
    """Only where the run's predictions are known to be good does a pose lead those that look like it."""
    fitter, image, first = lattice
    fitter.begin(1_000_000_000, 1.0)
    if not room:
        fitter.work.done = fitter.work.allowed
    predicted = Motion(first.cam_from_world, isotropic_covariance(0.2, 0.9))
    likely = [Likely(predicted, 0.0, scale)]
    sought = Sought(image, [first.cam_from_world], predicted.covariance, 0.9, first, thorough=True, likely=likely)
    found = Relocator(fitter, CAMERA).confirm(sought)
    assert found.leads == leads
    if not leads:
        apart = [(each.fit.cam_from_world @ first.cam_from_world.inverse()).translation[0] for each in found.contenders]
        assert any(abs(abs(x) - PANEL_M) < 0.05 for x in apart), apart
