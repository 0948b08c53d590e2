"""Failures, recovery and latency of a run against cases worked by hand."""

import numpy as np
import pytest

from uavbench.reports.metrics.association import PosePairs
from uavbench.reports.metrics.frame_errors import FrameErrors
from uavbench.reports.metrics.latency import Latency, deadline_misses, stage_latencies
from uavbench.reports.scoring.coverage import success_auc, success_curve, tracking
from uavbench.tracker.protocol import TrackResult
from uavbench.tracker.results import Results

GOOD, FAR, LOST = 0.01, 0.07, np.inf


def errors(translation_m, angle_deg=0.0, hz=10.0):
    """Errors of frames; what has no pose is infinitely far."""
    far = np.array(translation_m, dtype=float)
    n = len(far)
    stamps = np.rint(np.arange(n) / hz * 1e9).astype(np.int64) + 5 * 10**9
    pairs = PosePairs(stamps, np.zeros((n, 3)), np.zeros((n, 4)), np.zeros((n, 3)), np.zeros((n, 4)))
    return FrameErrors(np.arange(n), pairs, np.isfinite(far), far, np.broadcast_to(angle_deg, far.shape))


def test_failures_begin_after_a_success_or_at_the_start_and_last_to_the_next_success():
    found = tracking(errors([LOST, GOOD, GOOD, FAR, LOST, LOST, GOOD, FAR]))
    assert (found.frames, found.with_pose, found.failures) == (8, 5, 3)
    assert (found.coverage, found.success) == (5 / 8, 3 / 8)
    assert found.time_to_first_loss_s == 0.0
    assert found.time_to_recover_s == pytest.approx((0.1 + 0.3) / 2), "of the two that end"
    assert found.longest_failure_s == pytest.approx(0.3)
    assert found.duration_s == pytest.approx(0.8), "through the last frame's period"
    assert found.failures_per_minute == pytest.approx(3 / 0.8 * 60)
    at_the_end = tracking(errors([GOOD, GOOD, LOST, LOST]))
    assert (at_the_end.time_to_first_loss_s, at_the_end.time_to_recover_s) == (pytest.approx(0.2), None)
    assert at_the_end.longest_failure_s == pytest.approx(0.2)
    never = tracking(errors([GOOD] * 4))
    assert (never.failures, never.time_to_first_loss_s, never.longest_failure_s) == (0, None, 0.0)
    assert tracking(errors([LOST])).failures_per_minute == 1.0, "of a single frame there is no rate"


@pytest.mark.parametrize(
    ("metres", "degrees", "success"),
    [(0.05, 5.0, True), (0.0501, 0.0, False), (0.0, 5.01, False), (np.nan, 0.0, False), (0.0, np.nan, False)],
)
def test_a_frame_succeeds_within_5_cm_and_5_deg(metres, degrees, success):
    assert errors([metres], degrees).success.tolist() == [success]


def test_the_area_under_the_curve_is_that_of_its_steps():
    far = np.array([0.0, 0.02, 0.05, 0.2, np.inf])
    assert success_curve(far, np.array([0.0, 0.019, 0.02, 0.1, 1.0])).tolist() == [0.2, 0.2, 0.4, 0.6, 0.8]
    assert success_auc(far) == pytest.approx((1 + 0.8 + 0.5) / 5)
    limits = np.linspace(0, 0.1, 100_001)
    assert success_auc(far) == pytest.approx(success_curve(far, limits).mean(), abs=1e-4)


def results(stages, rate_hz=10.0, interval_ns=None):
    rows = tuple(TrackResult(status="lost", stage_ms=stage_ms) for stage_ms in stages)
    every_ns = round(1e9 / rate_hz) if interval_ns is None else interval_ns
    return Results({"rate_hz": rate_hz}, np.arange(len(rows)), every_ns * np.arange(len(rows)), rows)


def test_percentiles_of_latency_are_those_of_a_hundred_and_one_frames():
    times = np.random.default_rng(0).permutation(np.arange(101.0))
    assert Latency.of(times**2) == Latency(
        p50_ms=2500.0, p95_ms=9025.0, p99_ms=9801.0, max_ms=10_000.0, mean_ms=pytest.approx(3350.0), n=101
    )
    assert Latency.of(np.array([])) is None


def test_each_stage_has_the_frames_that_it_ran_on():
    found = stage_latencies(results([{"total": 5.0, "edges": 2.0}, {"total": 7.0}, {}]))
    assert {name: (latency.n, latency.mean_ms) for name, latency in found.items()} == {
        "total": (2, 6.0), "edges": (1, 2.0)
    }  # fmt: skip


@pytest.mark.parametrize(("rate_hz", "share"), [(10.0, 0.5), (30.0, 1.0), (20.0, 0.75), (3.0, 0.0)])
def test_a_deadline_is_the_next_frame(rate_hz, share):
    run = results([{"total": 50.0}, {"total": 100.0}, {"total": 100.1}, {"total": 300.0}, {"edges": 900.0}], rate_hz)
    assert deadline_misses(run) == share
    assert deadline_misses(results([{}])) is None
    assert deadline_misses(results([{"total": 50.0}], rate_hz)) == float(rate_hz == 30.0)


def test_a_deadline_is_that_of_the_frames_that_are_used_not_of_the_rate_that_is_asked():
    """Of frames at 15 Hz every fourth one is used where 4 Hz are asked for, 267 ms apart."""
    times = [{"total": 249.0}, {"total": 260.0}, {"total": 268.0}, {"total": 266.0}]
    assert deadline_misses(results(times, 4.0, 266_666_667)) == 0.25
