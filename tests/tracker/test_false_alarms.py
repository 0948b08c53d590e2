"""A track goes on while chance would not find so many edges, and no longer."""

from dataclasses import replace
from math import comb, log10

import numpy as np
import pytest

from tests.tracker.synthetic import BOX_TRIANGLES, CAMERA, Scene, box, box_corners, flown, look_at
from uavbench.scenes.structure import Structure
from uavbench.tracker.robust.config import RobustConfig
from uavbench.tracker.robust.fit.false_alarms import Chance, Found, chance, chance_of_lines, log10_tail
from uavbench.tracker.robust.relocalization.ranking import SEARCHED_POSES
from uavbench.tracker.robust.tracker import Robust
from uavbench.tracker.stage_clock import StageClock
from uavbench.trajectories.pose import Pose

STEP_NS = 66_666_667
KNOWN = 8
"""Frames before the texture changes."""


@pytest.mark.parametrize(("n", "k", "p"), [(20, 15, 0.3), (60, 51, 0.4), (10, 10, 0.5), (200, 90, 0.4)])
def test_the_bound_is_above_the_binomial_tail_and_near_it(n, k, p):
    tail = sum(comb(n, i) * p**i * (1 - p) ** (n - i) for i in range(k, n + 1))
    bound = log10_tail(float(k), n * p, n)
    assert log10(tail) <= bound <= log10(tail) + 1.5


def test_what_chance_finds_too_is_no_evidence():
    assert log10_tail(12.0, 15.0, 30) == 0.0
    assert log10_tail(12.0, 0.0, 30) == -np.inf
    assert log10_tail(0.0, 0.0, 0) == 0.0


def found_of(parts, found, candidates, patches=(), width_px=1.5, half_px=5.0):
    """`parts` parts of three points, of which the first `found` are found, each with so many candidates.

    patches: whether each that was searched is found; None for one that was not searched.
    """
    rows = np.repeat(np.arange(parts), 3)
    distance = np.full((3 * parts, 4), np.inf)
    distance[:, :candidates] = 0.0
    weight = np.where(rows < found, 1.0, 0.0)
    correlation = np.array([-1.0 if each is None else 0.9 for each in patches])
    patch_weight = np.array([float(bool(each)) for each in patches])
    return Found(rows, distance, weight, patch_weight, correlation, width_px, half_px)


def by_chance(*args):
    return chance(found_of(*args))


def test_points_of_a_part_are_one_observation_and_clutter_makes_them_worth_less():
    expected = 20 * (1 - 0.7)
    assert by_chance(20, 15, 1).edges == pytest.approx(log10_tail(15.0, expected, 20))
    assert by_chance(20, 15, 3).edges > by_chance(20, 15, 1).edges
    assert by_chance(20, 6, 1).edges == 0.0


def test_patches_that_are_found_count_and_missed_ones_cannot_hide_the_edges():
    edges = by_chance(20, 15, 1)
    assert by_chance(20, 15, 1, [True] * 5).whole < edges.whole
    assert by_chance(20, 15, 1, [None] * 5).whole == edges.whole
    missed = by_chance(20, 15, 1, [False] * 30)
    assert missed.edges == edges.edges
    assert missed.whole == pytest.approx(edges.edges + log10(2.0))  # of two tests the better one counts
    assert by_chance(0, 0, 0, [True] * 4).whole == pytest.approx(log10_tail(4.0, 4 * 0.3, 4) + log10(2.0))
    assert by_chance(0, 0, 0).whole == 0.0


def rays_of(lines):
    """Unit vectors (n, 3) to three points on each of several edges, given by their ends in the image at depth 1."""
    points = [np.linspace(*ends, 3) for ends in lines]
    rays = np.column_stack([np.concatenate(points), np.ones(3 * len(lines))])
    return rays / np.linalg.norm(rays, axis=1, keepdims=True)


def by_lines(edges, found, lines):
    """Chance of edges of one part each, of which the first `found` are found, that are seen at these lines."""
    return chance_of_lines(found_of(edges, found, 1), np.arange(0, 3 * edges + 1, 3), rays_of(lines), 0.006).edges


def test_edges_on_one_line_of_the_image_count_as_one_edge():
    row = [((x, 0.02 * x), (x + 0.02, 0.02 * (x + 0.02))) for x in np.linspace(-0.4, 0.4, 20)]
    of_one_edge = log10_tail(8.0, 8 * 0.3, 8)
    assert by_chance(20, 20, 1).edges < 2 * of_one_edge
    assert by_lines(20, 20, row) == pytest.approx(of_one_edge)
    assert by_lines(20, 10, row) == pytest.approx(log10_tail(4.0, 8 * 0.3, 8))
    assert by_lines(5, 5, row[:5]) == by_chance(5, 5, 1).edges
    posts = [((x, 0.0), (x, 0.03)) for x in np.linspace(-0.4, 0.4, 18)]  # that reach farther from the line than 0.006
    two = [((-0.5, 0.0), (0.5, 0.0)), ((-0.5, 0.2), (0.5, 0.2))]
    assert by_lines(20, 20, posts + two) == pytest.approx(log10_tail(20.0, 20 * 0.3, 20))


def test_short_edges_that_a_line_passes_are_found_with_it():
    line = [((-0.5, 0.0), (0.5, 0.0))]
    points = [((x, 0.002), (x, 0.002)) for x in np.linspace(-0.4, 0.4, 19)]
    assert by_lines(20, 20, points + line) == by_lines(20, 20, line + points)
    assert by_lines(20, 20, points + line) == pytest.approx(log10_tail(8.0, 8 * 0.3, 8))
    away = [((x, 0.1), (x, 0.1)) for x in np.linspace(-0.4, 0.4, 19)]
    assert by_lines(20, 20, away + line) == pytest.approx(log10_tail(20.0, 20 * 0.3, 20))
    same = [((0.2, 0.1), (0.2, 0.1)) for _ in range(20)]
    assert by_lines(20, 20, same) == pytest.approx(log10_tail(8.0, 8 * 0.3, 8))


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
    assert fit.log10_false_alarms(SEARCHED_POSES) < 0.0 < fit.log10_false_alarms_of_lines(SEARCHED_POSES)


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
    edge_support, log10_edges, recent, goes_on, was_lost
):
    """Also after a frame that was lost, as long as the last pose is recent."""
    run, near, fit = after_three_frames()
    fit = replace(fit, support=0.2, edge_support=edge_support, chance=Chance(log10_edges, log10_edges))
    run.state.is_lost = was_lost
    assert run.state.is_there(fit, near, recent) == goes_on
    assert run.state.holds(fit, near, searched=False, recent=recent) == goes_on


@pytest.mark.parametrize(("log10_edges", "holds"), [(-17.0, True), (-15.0, False)])
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
