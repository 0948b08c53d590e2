"""A track goes on while chance would not find so many edges, and no longer."""

from dataclasses import replace
from itertools import pairwise
from math import log10

import numpy as np
import pytest
from scipy.stats import norm

from tests.tracker.synthetic import BOX_TRIANGLES, CAMERA, Scene, box, box_corners, flown, look_at
from uavbench.scenes.structure import Structure
from uavbench.tracker.robust import track_state
from uavbench.tracker.robust.config import RobustConfig
from uavbench.tracker.robust.fit.false_alarms import (
    HIDDEN_PARTS,
    OTHERWISE_HIDDEN,
    PARTS_OF_LINE,
    Chance,
    Found,
    chance,
    evidence,
    lines_of_edges,
)
from uavbench.tracker.robust.relocalization.ranking import SEARCHED_POSES
from uavbench.tracker.robust.track_state import TrackState
from uavbench.tracker.robust.tracker import Robust
from uavbench.tracker.stage_clock import StageClock
from uavbench.trajectories.pose import Pose

STEP_NS = 66_666_667
KNOWN = 8
"""Frames before the texture changes."""


SIGMA_PX, HALF_PX = 0.67, 5.0


def found_of(residuals, candidates=1, patches=(), sigma_px=SIGMA_PX):
    """An edge for each row (p, k) of residuals: p parts of k points each, with so many candidates, at least one.

    patches: whether each that was searched is found; None for one that was not searched.
    """
    edges = [np.atleast_2d(each) for each in residuals]
    parts = np.concatenate([np.arange(len(each)).repeat(each.shape[1]) for each in edges]) if edges else np.zeros(0)
    first = np.cumsum([0, *(each.size for each in edges)])
    rows = parts.astype(np.int64) + 100 * np.arange(len(edges)).repeat(np.diff(first))
    residual = np.concatenate([np.zeros(0), *(each.ravel() for each in edges)])
    correlation = np.array([-1.0 if each is None else 0.9 for each in patches])
    return Found(
        rows,
        first,
        np.full(len(rows), candidates),
        residual,
        np.full(len(rows), sigma_px**2),
        np.array([float(bool(each)) for each in patches]),
        correlation,
        HALF_PX,
        1.5,
    )


def by_chance(*args, **keywords):
    """Chance of edges that are seen on a line each."""
    found = found_of(*args, **keywords)
    return chance(found, np.arange(len(found.first) - 1))


def ratio(residual_px, candidates):
    """Likelihood ratio of the nearest of so many candidates, by its definition."""
    r = np.abs(residual_px)
    near = candidates / HALF_PX * (1 - r / HALF_PX) ** (candidates - 1)
    return 2 * norm.pdf(r, scale=SIGMA_PX) / near


def bound(ratios):
    """log10 of the inverse of the mean likelihood ratio (n,) over the hidden parts."""
    hidden = (np.arange(10)[:, None] + 0.5) / 10
    return -log10(np.prod(hidden + (1 - hidden) * np.asarray(ratios), axis=1).mean())


@pytest.mark.parametrize("candidates", [1, 2, 4])
def test_chance_finds_as_much_no_oftener_than_is_said(candidates):
    """Distances of random candidates from 5 edges of 3 parts, whose nearest ones count: Markov's inequality."""
    rng = np.random.default_rng(candidates)
    nearest = rng.uniform(0.0, HALF_PX, (4000, 5, 3, 1, candidates)).min(axis=-1)
    log10_p = np.array([by_chance(list(each), candidates).edges for each in nearest])
    for least in (-0.3, -1.0, -2.0):
        assert (log10_p <= least).mean() <= 10.0**least
    assert (log10_p < 0.0).any()


@pytest.mark.parametrize("candidates", [1, 3])
def test_edges_that_are_found_are_as_rare_as_their_likelihood_ratio_says(candidates):
    residuals = np.array([0.0, 0.3, -0.5, 1.0, -2.0, 4.9, 0.1, 0.2])
    edges = [[[each]] for each in residuals]
    assert by_chance(edges, candidates).edges == pytest.approx(bound(ratio(residuals, candidates)))


def test_points_of_a_part_are_one_observation_and_clutter_makes_them_worth_less():
    one, three = [[[0.2]]] * 9, [[[0.2, 0.2, 0.2]]] * 9
    assert by_chance(three).edges == pytest.approx(by_chance(one).edges)
    mixed = [[[0.0, 1.0]]] * 9
    assert by_chance([[[0.0]]] * 9).edges < by_chance(mixed).edges < by_chance([[[1.0]]] * 9).edges
    assert by_chance(one, 3).edges > by_chance(one, 1).edges
    assert by_chance([[[4.0]]] * 9).edges == 0.0


def test_what_was_skipped_or_has_no_candidate_is_taken_for_hidden():
    seen, hidden = [[[0.1]]] * 12, [[[np.inf]]] * 6
    expected = bound([*[ratio(0.1, 1)] * 12, *[0.0] * 6])
    assert by_chance(seen + hidden).edges == pytest.approx(expected)
    found = found_of(seen + hidden)
    found.residual[12:], found.candidates[12:] = 0.0, 0
    assert chance(found, np.arange(18)).edges == pytest.approx(expected)
    assert by_chance(hidden).edges == 0.0


def all_missing(points):
    """Logarithms of the ratios of so many points that are not found, by the part that is hidden."""
    return points * np.log(HIDDEN_PARTS)


def test_what_is_found_beside_others_is_as_likely_as_their_hidden_part_says():
    seen, nothing = 20 * np.log(HIDDEN_PARTS + (1 - HIDDEN_PARTS) * 5.0), np.zeros(len(HIDDEN_PARTS))
    part = np.exp(seen) / np.exp(seen).sum()
    part = (1 - OTHERWISE_HIDDEN) * part + OTHERWISE_HIDDEN / len(part)
    for some in (seen, all_missing(3)):
        assert evidence(some, seen) == pytest.approx(log10(part @ np.exp(some)))
    assert evidence(nothing, seen) == pytest.approx(0.0)
    assert evidence(all_missing(4), nothing) == pytest.approx(log10((HIDDEN_PARTS**4).mean()))


def test_what_is_missing_beside_others_that_are_seen_speaks_against_a_pose_but_never_beyond_doubt():
    """Ten posts that are not there where nothing else is hidden are unlikely; a tree may stand before all of them."""
    seen = 50 * np.log(HIDDEN_PARTS + (1 - HIDDEN_PARTS) * 5.0)
    lacking = [evidence(all_missing(n), seen) for n in (1, 3, 10, 40)]
    assert all(after < before for before, after in pairwise(lacking))
    assert lacking[0] < -0.9
    least = OTHERWISE_HIDDEN / len(HIDDEN_PARTS) * HIDDEN_PARTS[-1] ** 40
    assert lacking[-1] >= log10(least)


def test_patches_that_are_found_count_and_missed_ones_cannot_hide_the_edges():
    twenty = [[[0.3]]] * 20
    edges = by_chance(twenty)
    assert by_chance(twenty, patches=[True] * 5).whole < edges.whole
    assert by_chance(twenty, patches=[None] * 5).whole == edges.whole
    missed = by_chance(twenty, patches=[False] * 30)
    assert missed.edges == edges.edges
    assert missed.whole == pytest.approx(edges.edges + log10(2.0))  # of two tests the better one counts
    assert by_chance([], patches=[True] * 4).whole == pytest.approx(bound([5.0 / 1.5] * 4) + log10(2.0))
    assert by_chance([]).whole == 0.0


def by_lines(lines, residual_px=0.2):
    """Chance of edges of one part each that are all found, and seen at these lines, given by ends at depth 1."""
    points = np.concatenate([np.column_stack([np.linspace(*ends, 3), np.ones(3)]) for ends in lines])
    found = found_of([[[residual_px] * 3]] * len(lines))
    return chance(found, lines_of_edges(np.eye(3), np.zeros(3), points, found.first, 0.006)).edges


def of_parts(number, residual_px=0.2):
    """Chance of so many parts of edges that are found."""
    return pytest.approx(bound([ratio(residual_px, 1)] * number))


def test_edges_on_one_line_of_the_image_count_as_one_edge():
    row = [((x, 0.02 * x), (x + 0.02, 0.02 * (x + 0.02))) for x in np.linspace(-0.4, 0.4, 20)]
    assert by_lines(row) == of_parts(PARTS_OF_LINE)
    assert by_lines(row[:PARTS_OF_LINE]) == of_parts(PARTS_OF_LINE)
    assert by_lines(row[:4]) == of_parts(4)
    posts = [((x, 0.0), (x, 0.03)) for x in np.linspace(-0.4, 0.4, 18)]  # that reach farther from the line than 0.006
    two = [((-0.5, 0.0), (0.5, 0.0)), ((-0.5, 0.2), (0.5, 0.2))]
    assert by_lines(posts + two) == of_parts(20)


def test_an_edge_is_a_line_of_its_own():
    whole = by_chance([np.full((8, 2), 0.2)])
    assert whole.edges == of_parts(PARTS_OF_LINE)


def test_short_edges_that_a_line_passes_are_found_with_it():
    line = [((-0.5, 0.0), (0.5, 0.0))]
    points = [((x, 0.002), (x, 0.002)) for x in np.linspace(-0.4, 0.4, 19)]
    assert by_lines(points + line) == pytest.approx(by_lines(line + points))
    assert by_lines(points + line) == of_parts(PARTS_OF_LINE)
    away = [((x, 0.1), (x, 0.1)) for x in np.linspace(-0.4, 0.4, 19)]
    assert by_lines(away + line) == of_parts(20)
    assert by_lines([((0.2, 0.1), (0.2, 0.1))] * 20) == of_parts(PARTS_OF_LINE)


def test_a_row_of_posts_is_not_found_at_a_horizon():
    """Seen from the ground, the feet of many posts lie on one line, which any horizon fits."""
    corners = [box_corners((0.05, 0.05, 0.004), (0.0, y)) for y in np.linspace(-0.5, 0.5, 12)]
    triangles = np.concatenate([BOX_TRIANGLES + 8 * k for k in range(len(corners))])
    posts = Structure.from_mesh(np.concatenate(corners), triangles)
    pose = look_at(np.array([-1.4, 0.0, 0.002]), (0.0, 0.0, 0.002))
    image = np.full((CAMERA.height, CAMERA.width, 3), 90, dtype=np.uint8)
    image[: CAMERA.height // 2] = 180
    run = Robust().start(posts, CAMERA, pose, np.random.default_rng(0))
    fit = run.fitter.searched(image, pose, np.diag([1e-6] * 6), StageClock(), 5.0)
    assert fit.inliers > 30
    assert fit.log10_false_alarms(SEARCHED_POSES) > 0.0


@pytest.mark.parametrize("seed", range(4))
def test_random_poses_are_not_taken_for_right_ones(seed):
    """At random views of an image chance explains what is found, unless the fit goes to the right pose."""
    poses, images = flown(KNOWN, seed=11 + seed)
    run = Robust().start(box(), CAMERA, poses[0], np.random.default_rng(0))
    results = [run.track(image, i * STEP_NS) for i, image in enumerate(images)]
    assert all(result.log10_nfa < -3.0 for result in results)
    rng = np.random.default_rng(seed)
    for _ in range(12):
        away = Pose.exp(np.r_[rng.normal(0, 0.15, 3), rng.normal(0, 0.1, 3)]) @ poses[-1]
        away = Pose(np.ascontiguousarray(away.rotation), np.ascontiguousarray(away.translation))
        fit = run.fitter.fit(images[-1], away, np.diag([1e-8] * 6), StageClock(), 5.0)
        off = np.linalg.norm((poses[-1] @ fit.cam_from_world.inverse()).log()[:3])
        if off > 0.1:
            assert fit.log10_false_alarms(SEARCHED_POSES) > 0.0


def repainted(log10_false_alarms):
    """Statuses of a flight round a box whose faces change their texture in flight, where much support is asked for.

    So all patches are missed while all edges are found, as where noise hides the texture of a plain facade.
    """
    poses, images = flown(KNOWN + 6, seed=11)
    other, rng = Scene([box_corners()], seed=12), np.random.default_rng(2)
    config = RobustConfig()
    loss = replace(config.loss, log10_false_alarms=log10_false_alarms, min_support=0.99)
    config = replace(config, loss=loss)
    run = Robust(config).start(box(), CAMERA, poses[0], np.random.default_rng(0))
    shown = [*images[:KNOWN], *(other.render(pose, noise_rng=rng) for pose in poses[KNOWN:])]
    results = [run.track(image, i * STEP_NS) for i, image in enumerate(shown)]
    return [result.status for result in results[KNOWN:]]


def test_a_track_goes_on_with_all_edges_where_the_texture_is_gone(monkeypatch):
    """By what chance explains alone: it has less than the support that is asked of others."""
    with monkeypatch.context() as patched:
        patched.setattr(TrackState, "is_there", lambda *given, **named: False)
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
    assert run.state.is_there(held, right, recent=True)
    assert not run.state.is_there(missed, replace(right, cam_from_world=wrong), recent=True)


def after_three_frames():
    """A run that has tracked a box for three frames, its prediction of the last one, and a fit from there."""
    poses, images = flown(3, seed=11)
    run = Robust().start(box(), CAMERA, poses[0], np.random.default_rng(0))
    for i, image in enumerate(images):
        run.track(image, i * STEP_NS)
    near = run.state.motion.predict(0.0, run.state.range_m, run.config.motion)
    return run, near, run.fitter.fit(images[-1], near.cam_from_world, near.covariance, StageClock(), 5.0)


@pytest.mark.parametrize(("log10_nfa", "holds"), [(-2.0, False), (-4.0, True)])
def test_after_a_loss_a_searched_pose_is_as_sure_as_a_track(log10_nfa, holds):
    run, near, fit = after_three_frames()
    by_chance = log10_nfa - log10(SEARCHED_POSES)
    fit = replace(fit, support=1.0, edge_support=1.0, chance=Chance(0.0, by_chance))
    run.state.is_lost = True
    assert run.state.holds(fit, near, searched=True, recent=False) == holds


@pytest.mark.parametrize(
    ("edge_support", "log10_edges", "recent", "goes_on"),
    [(0.6, -6.0, True, True), (0.6, -6.0, False, False), (0.4, -6.0, True, False), (0.6, -4.0, True, False)],
)
@pytest.mark.parametrize("was_lost", [False, True])
def test_patches_behind_an_occluder_say_nothing_against_half_of_the_edges(
    monkeypatch, edge_support, log10_edges, recent, goes_on, was_lost
):
    """Also after a frame that was lost, as long as the last pose is recent, and of many poses as near."""
    run, near, fit = after_three_frames()
    monkeypatch.setattr(track_state, "log10_poses_as_near", lambda *given: 6.0)
    fit = replace(fit, support=0.2, edge_support=edge_support, chance=Chance(log10_edges, log10_edges))
    run.state.is_lost = was_lost
    assert run.state.is_there(fit, near, recent) == goes_on
    monkeypatch.setattr(TrackState, "is_by_chance", lambda *given: False)
    assert run.state.holds(fit, near, searched=False, recent=recent) == goes_on


@pytest.mark.parametrize(
    ("log10_whole", "log10_as_near", "goes_on"), [(-5.0, 0.0, True), (-5.0, 2.5, False), (-2.5, 0.0, False)]
)
@pytest.mark.parametrize("was_lost", [False, True])
def test_a_track_that_is_mostly_hidden_goes_on_where_chance_finds_less_among_the_poses_as_near(
    monkeypatch, log10_whole, log10_as_near, goes_on, was_lost
):
    """A passer-by hides most of a box, and takes support away, but what is left is where it has to be."""
    run, near, fit = after_three_frames()
    fit = replace(fit, support=0.3, edge_support=0.3, chance=Chance(0.0, log10_whole))
    monkeypatch.setattr(track_state, "log10_poses_as_near", lambda *given: log10_as_near)
    run.state.is_lost = was_lost
    assert run.state.is_there(fit, near, recent=False) == goes_on
    assert run.state.holds(fit, near, searched=False, recent=False) == goes_on
    far = replace(near, cam_from_world=Pose(np.eye(3), np.array([0.1, 0.0, 0.0])) @ near.cam_from_world)
    assert not run.state.is_there(fit, far, recent=False)


@pytest.mark.parametrize(("log10_edges", "holds"), [(-20.0, True), (-18.0, False)])
@pytest.mark.parametrize("was_lost", [False, True])
def test_a_searched_pose_of_little_support_holds_where_no_pose_of_the_search_finds_as_much_by_chance(
    log10_edges, holds, was_lost
):
    """An occluder that hides most of a structure takes support away; what is found all the same is no chance."""
    run, far, fit = after_three_frames()
    fit = replace(fit, support=0.35, edge_support=0.35, chance=Chance(log10_edges, log10_edges))
    far = replace(far, cam_from_world=Pose(np.eye(3), np.array([0.5, 0.0, 0.0])) @ far.cam_from_world)
    run.state.is_lost = was_lost
    assert run.state.holds(fit, far, searched=True, recent=False) == holds
    assert not run.state.holds(fit, far, searched=False, recent=False)
