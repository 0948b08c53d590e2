"""Poses of a search in the order in which they are fitted: by score and by how likely they are beforehand."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from uavbench.tracker.geometry_kernels import RigidMotion
from uavbench.tracker.robust.config import RobustConfig
from uavbench.tracker.robust.fit.false_alarms import Chance
from uavbench.tracker.robust.fit.pose_fit import Fit
from uavbench.tracker.robust.motion_model import Motion, isotropic_covariance
from uavbench.tracker.robust.relocalization.ranking import Likely, Ranking, Sought
from uavbench.tracker.robust.relocalization.relocate import Relocalized
from uavbench.tracker.robust.relocalization.scoring.pose_search import Candidate
from uavbench.tracker.robust.relocalization.scoring.pose_search_kernels import SeenEdges
from uavbench.trajectories.pose import Pose

RELOCALIZATION = RobustConfig().relocalization
RANGE_M, SIGMA = 2.0, 0.06
GUESS = Pose.exp(np.array([0.1, -0.2, RANGE_M, 0.3, 0.1, -0.2]))
NO_EDGES = SeenEdges(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(3))


def ranking():
    covariance = isotropic_covariance(SIGMA, RANGE_M)
    return Ranking(Sought(np.zeros((4, 4), np.uint8), [GUESS], covariance, RANGE_M), RELOCALIZATION)


def candidate(score, twist, cost=0.0):
    pose = Pose.exp(np.array(twist)) @ GUESS
    return Candidate(score, RigidMotion(pose.rotation, pose.translation), NO_EDGES, cost)


twists = st.lists(st.floats(-0.3, 0.3).map(lambda x: round(x, 3)), min_size=6, max_size=6)
"""Of angles of 1e-5 to 1e-4 rad `Pose.log` tells the translation to 1e-7 only, by cancellation."""


@given(st.floats(0, 1), twists, st.floats(0, 0.5))
def test_the_cost_of_a_pose_is_that_of_a_normal_prior_whatever_it_was_before(score, twist, cost):
    found = ranking().weighed(candidate(score - cost, twist, cost))
    sigmas = np.array(twist) / ([SIGMA * RANGE_M] * 3 + [SIGMA] * 3)
    expected = 0.5 * RELOCALIZATION.lead_of_rivals * float(sigmas @ sigmas)
    np.testing.assert_allclose([found.cost, found.score], [expected, score - expected], atol=1e-9)
    again = ranking().weighed(found)
    np.testing.assert_allclose([again.cost, again.score], [found.cost, found.score], atol=1e-9)


def test_of_two_poses_that_match_about_as_well_the_one_near_the_guess_comes_first():
    near, far = candidate(0.80, [0.0, 0.05, 0.0, 0.0, 0.0, 0.02]), candidate(0.85, [0.5, 0.0, 0.0, 0.0, 0.25, 0.0])
    weighed = ranking().weighed
    assert weighed(near).score > weighed(far).score


def fit(x_m, support, log10_chance=-20.0):
    pose = Pose.exp(np.array([x_m, 0.0, 0.0, 0.0, 0.0, 0.0])) @ GUESS
    chance = Chance(log10_chance, log10_chance)
    return Fit(pose, isotropic_covariance(0.001, RANGE_M), support, 50, 50, 50, RANGE_M, chance=chance)


@pytest.mark.parametrize("tracked", [False, True])
def test_a_tracks_pose_far_from_where_they_usually_are_needs_more_support(tracked):
    covariance = isotropic_covariance(SIGMA, RANGE_M)
    likely = [Likely(Motion(GUESS, covariance), scale=0.001)]
    near, far = fit(0.001, 0.6), fit(0.1, 0.7)
    sought = Sought(np.zeros((4, 4), np.uint8), [GUESS], covariance, RANGE_M, near, likely=likely, tracked=tracked)
    ranked = Ranking(sought, RELOCALIZATION)
    ranked.add(far)
    assert ranked.top is (near if tracked else far)
    ranked.add(sure := fit(0.1, 0.95))
    assert ranked.top is sure


@pytest.mark.parametrize(
    ("leads", "advantage", "explained", "explains", "outdone"),
    [
        (True, 0.2, True, False, True),
        (False, 0.2, True, False, False),
        (True, 0.05, True, False, False),
        (True, 0.2, False, False, False),
        (True, 0.2, True, True, False),
    ],
)
def test_a_track_that_chance_explains_is_outdone_by_a_found_pose_that_it_does_not(
    leads, advantage, explained, explains, outdone
):
    track, best = fit(0.1, 0.6, -1.0 if explained else -20.0), fit(0.0, 0.7, -1.0 if explains else -20.0)
    found = Relocalized(best, advantage, True, False, leads, False, True, (), ())
    assert found.outdoes(track, RELOCALIZATION.lead) == outdone
