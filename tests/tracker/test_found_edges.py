"""Edges that were found just before have to be found again, or patches have to be, for a track to go on."""

from dataclasses import replace
from math import comb

import numpy as np
import pytest

from tests.tracker.synthetic import CAMERA, box, flown
from uavbench.tracker.robust.decision import found_edges
from uavbench.tracker.robust.decision.found_edges import FoundEdges, missing_share
from uavbench.tracker.robust.fit.pose_fit import MIN_POINTS
from uavbench.tracker.robust.tracker import Robust
from uavbench.tracker.stage_clock import StageClock

KNOWN, STEP_NS = 12, 66_666_667
HIDDEN_PART = 0.4
"""Part of the image from the left that is painted over: four tenths of the points found before, not half of all."""


@pytest.fixture(scope="module")
def flight():
    return flown(KNOWN + 2, seed=11)


@pytest.fixture
def run(flight):
    """A run that knows the edges of the box."""
    run = Robust().start(box(), CAMERA, flight.poses[0], np.random.default_rng(0))
    for k in range(KNOWN):
        assert run.track(flight.images[k], k * STEP_NS).status == "ok"
    return run


def hidden(image):
    image = image.copy()
    image[:, : int(HIDDEN_PART * image.shape[1])] = 128
    return image


def fitted(run, image):
    """The next frame and its fit."""
    stamp_ns = KNOWN * STEP_NS
    assert run.frames.is_new(image, stamp_ns)
    frame = run.frames.prepared(image, stamp_ns, None, StageClock())
    return frame, run.follower.fit(frame, StageClock())


def has_slid(run, frame, fit):
    return run.decider.found_edges.has_slid(fit, again=not run.decider.is_slow(frame))


def without_patches(fit):
    none = fit.residuals.weighting._replace(patch_weight=np.zeros_like(fit.residuals.weighting.patch_weight))
    return replace(fit, residuals=fit.residuals._replace(weighting=none))


def test_little_is_missing_of_a_frame_like_the_ones_before(run, flight):
    frame, fit = fitted(run, flight.images[KNOWN])
    assert run.decider.found_edges.missing(fit) < 0.05
    assert not has_slid(run, frame, without_patches(fit))


def test_a_track_does_not_go_on_without_its_edges_and_without_patches(run, flight):
    frame, fit = fitted(run, hidden(flight.images[KNOWN]))
    assert run.state.holds(fit, frame.predicted, False, True), "the fit has enough support here"
    assert 0.3 < run.decider.found_edges.missing(fit) < 0.6
    motion, bare = run.state.motion, without_patches(fit)
    decision = run.decider.decide(frame, bare, StageClock())
    assert not decision.settled
    assert not decision.contenders, "a pose that slid is no hypothesis to go on from"
    assert run.state.motion is motion


def test_patches_vouch_for_a_pose_of_which_edges_are_hidden(run, flight):
    frame, fit = fitted(run, hidden(flight.images[KNOWN]))
    assert np.count_nonzero(fit.residuals.weighting.patch_weight) >= MIN_POINTS
    assert not has_slid(run, frame, fit)
    assert run.decider.decide(frame, fit, StageClock()).settled


def test_after_a_long_interval_and_without_memory_nothing_is_missed(run, flight):
    frame, fit = fitted(run, hidden(flight.images[KNOWN]))
    fit = without_patches(fit)
    assert has_slid(run, frame, fit)
    assert not has_slid(run, frame._replace(extrapolated_s=run.config.slow_s), fit)
    run.decider.found_edges.forget()
    assert not has_slid(run, frame, fit)


def test_a_track_that_slid_has_to_find_more_again(run, flight, monkeypatch):
    """Half-hidden edges: enough for a track that goes on, too few after a frame in which more were missing."""
    frame, fit = fitted(run, hidden(flight.images[KNOWN]))
    fit, missing = without_patches(fit), run.decider.found_edges.missing(fit)
    monkeypatch.setattr(found_edges, "MOST_MISSING", 1.2 * missing)
    monkeypatch.setattr(found_edges, "STILL_MISSING", 0.8 * missing)
    assert not has_slid(run, frame, fit)
    monkeypatch.setattr(found_edges, "MOST_MISSING", 0.9 * missing)
    assert has_slid(run, frame, fit)
    monkeypatch.setattr(found_edges, "MOST_MISSING", 1.2 * missing)
    assert has_slid(run, frame, fit)
    assert not has_slid(run, frame._replace(extrapolated_s=run.config.slow_s), fit)
    assert not has_slid(run, frame, fit), "poses that a search compared begin anew"


def test_a_track_goes_on_by_the_next_frame_that_shows_its_edges(run, flight, monkeypatch):
    fit_of = run.follower.fit
    monkeypatch.setattr(run.follower, "fit", lambda frame, clock: without_patches(fit_of(frame, clock)))
    hides = run.track(hidden(flight.images[KNOWN]), KNOWN * STEP_NS)
    assert hides.status == "lost"
    assert hides.guess is not None
    shows = run.track(flight.images[KNOWN + 1], (KNOWN + 1) * STEP_NS)
    assert shows.status == "ok"
    twist = (shows.cam_from_world @ flight.poses[KNOWN + 1].inverse()).log()
    assert np.linalg.norm(twist) < 0.01


def test_expectations_follow_what_is_found(run, flight):
    """Part 1 found once, then none of an edge nine times: what is expected falls by the rate each time."""
    _, fit = fitted(run, flight.images[KNOWN])
    found = FoundEdges(len(run.fitter.edges.ends), 0.1)
    found.learn(fit)
    assert found.missing(fit) == pytest.approx(0.0, abs=1e-12)
    weighting = fit.searched.found.estimate.weighting
    estimate = fit.searched.found.estimate._replace(
        weighting=weighting._replace(weight=np.zeros_like(weighting.weight))
    )
    nothing = replace(fit, searched=fit.searched._replace(found=fit.searched.found._replace(estimate=estimate)))
    assert found.missing(nothing) == pytest.approx(1.0)
    before = found.part.copy()
    for _ in range(9):
        found.learn(nothing)
    np.testing.assert_allclose(found.part, before * 0.9**9)


@pytest.mark.parametrize("points", [1, 4, 7])
def test_what_chance_leaves_out_is_not_missing(points):
    """Edges of which each point is found with a probability, as behind rows of seats: all outcomes, by how likely."""
    part, edges = 0.45, 60
    shares, likely = [], []
    for k in range(points + 1):
        keys = np.repeat(np.arange(edges), points)[:, None] * np.ones(3, dtype=np.int64)
        weight = np.tile(np.arange(points) < k, edges).astype(np.float64)
        shares.append(missing_share(keys, weight, np.full(edges, part)))
        likely.append(comb(points, k) * part**k * (1 - part) ** (points - k))
    below = np.maximum(points * part - np.arange(points + 1), 0.0)
    chance = np.dot(likely, below)
    np.testing.assert_allclose(shares, np.maximum(below - chance, 0.0) / (points * part - chance), atol=1e-12)
    assert shares[0] == pytest.approx(1.0) and shares[-1] == 0.0


def test_a_part_of_the_points_found_before_hides_no_slide():
    """Half of the points of each edge were found before, and as many now, others of them: chance alone tells 0.19."""
    keys = np.repeat(np.arange(60), 4)[:, None] * np.ones(3, dtype=np.int64)
    now = np.random.default_rng(1).random(len(keys)) < 0.5
    assert missing_share(keys, now.astype(np.float64), np.full(60, 0.5)) < 0.1
    elsewhere = now & (keys[:, 0] >= 30)
    assert missing_share(keys, elsewhere.astype(np.float64), np.full(60, 0.5)) > 0.4
