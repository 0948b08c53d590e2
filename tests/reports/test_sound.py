"""What a tracker says that no error can be computed of costs its frame, by name, and never the scoring."""

import json
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.figure import Figure

from uavbench.bench.trial.check import TRIAL
from uavbench.reports.figures import distributions as figures_statistics
from uavbench.reports.scoring.runs import ReportEntry, open_runs
from uavbench.reports.scoring.score import Score, score
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.tracker.protocol import TrackResult
from uavbench.tracker.results import Results
from uavbench.tracker.run import track_frame
from uavbench.trajectories.pose import Pose

BAD = 3
"""The frame of which something is said that cannot be."""


@pytest.fixture
def sequence():
    return Sequence.load(TRIAL)


@pytest.fixture
def good(sequence):
    """Results 1 cm beside the ground truth, with an honest covariance."""
    beside = Pose(np.eye(3), np.array([0.01, 0.0, 0.0]))
    rows = tuple(
        TrackResult(
            status="ok",
            cam_from_world=beside @ sequence.true_cam_from_world(k),
            covariance=1e-4 * np.eye(6),
            stage_ms={"total": 5.0},
        )
        for k in range(len(sequence))
    )
    record = {
        "tracker": {"kind": "beside", "parameters": {}},
        "rate_hz": float(sequence.info["rate_hz"]),
        "seed": 0,
        "sequence": {"name": sequence.name, "content_hash": sequence.content_hash},
        "cam_from_body": sequence.cam_from_body.matrix.tolist(),
    }
    return Results(record, np.arange(len(rows)), sequence.stamps_ns, rows)


def with_bad(results, **fields):
    rows = list(results.rows)
    rows[BAD] = replace(rows[BAD], **fields)
    return replace(results, rows=tuple(rows))


def saved(found, tmp_path):
    """The score as it is read again: it is JSON without NaN and infinity."""
    found.save(tmp_path / "score.json")
    json.loads((tmp_path / "score.json").read_text(), parse_constant=pytest.fail)
    return Score.load(tmp_path / "score.json")


@pytest.mark.parametrize("metres", [1e155, -1e308, 2e12, np.inf, np.nan])
def test_a_pose_out_of_reach_is_a_lost_frame_and_the_rest_stands(sequence, good, metres, tmp_path):
    away = Pose(np.eye(3), np.array([0.0, metres, 0.0]))
    found = saved(score(sequence, with_bad(good, cam_from_world=away)), tmp_path)
    n = len(sequence)
    assert found.status == "lost" and found.tracking.coverage == pytest.approx((n - 1) / n)
    assert found.ate["none"].translation_m.n == found.consistency.n == found.model.add_m.n == n - 1
    assert found.ate["none"].translation_m.rmse == pytest.approx(0.01)
    assert any(f"frame {BAD}: its pose is not finite or beyond 1e+12 m" in told for told in found.errors)


@pytest.mark.parametrize(
    "covariance",
    [
        np.zeros((6, 6)),
        np.diag([1e-4, 1e-4, 0, 1e-4, 1e-4, 1e-4]),
        1e-4 * np.ones((6, 6)),
    ],
    ids=["zeros", "a zero", "rank one"],
)
def test_a_singular_covariance_has_no_nees_and_counts_as_outside(sequence, good, covariance, tmp_path):
    found = saved(score(sequence, with_bad(good, covariance=covariance)), tmp_path)
    whole = score(sequence, good).consistency
    n = len(sequence)
    assert found.status == "complete" and not found.errors
    assert (found.consistency.n, found.consistency.singular) == (n - 1, 1)
    assert found.consistency.mean == pytest.approx(whole.mean)
    assert found.consistency.inside == pytest.approx(whole.inside * (n - 1) / n)


@pytest.mark.parametrize("covariance", [np.zeros((6, 6)), 1e-300 * np.eye(6)], ids=["zeros", "tiny"])
def test_a_run_whose_covariances_are_all_singular_is_scored(sequence, good, covariance, tmp_path):
    rows = tuple(replace(row, covariance=covariance) for row in good.rows)
    found = saved(score(sequence, replace(good, rows=rows)), tmp_path).consistency
    assert found.singular + found.n == len(sequence) and found.inside == 0
    assert found.n or found.mean is None


@pytest.mark.parametrize("scale", [1e20, 1e300, -1.0, np.nan, np.inf])
def test_huge_negative_and_endless_covariances_are_scored_without_or_left_out(sequence, good, scale, tmp_path):
    found = saved(score(sequence, with_bad(good, covariance=scale * np.eye(6))), tmp_path)
    kept = scale == 1e20
    assert found.consistency.n == len(sequence) - (not kept)
    assert kept or any(f"frame {BAD}: its covariance" in told for told in found.errors)


def test_the_report_draws_what_is_sound(sequence, good, tmp_path):
    bad = with_bad(good, covariance=np.zeros((6, 6)))
    rows = [*bad.rows]
    rows[BAD + 1] = replace(rows[BAD + 1], cam_from_world=Pose(np.eye(3), np.array([1e155, 0, 0])))
    bad = replace(bad, rows=tuple(rows))
    bad.save(tmp_path / "run")
    score(sequence, bad).save(tmp_path / "run" / "score.json")
    runs = open_runs([ReportEntry(TRIAL, tmp_path / "run", tmp_path / "run" / "score.json")])
    assert not runs[0].errors.ok[BAD + 1]
    figures_statistics.nees_over_time(runs, tmp_path / "nees")


@pytest.mark.parametrize("usual", [6.0, 1e-3])
def test_a_first_pose_without_error_does_not_stretch_the_axis_of_nees(sequence, good, usual, tmp_path, monkeypatch):
    """The pose that a tracker is given has round-off for an error, and a NEES of 1e-26."""
    good.save(tmp_path / "run")
    score(sequence, good).save(tmp_path / "run" / "score.json")
    runs = open_runs([ReportEntry(TRIAL, tmp_path / "run", tmp_path / "run" / "score.json")])
    values = np.full(len(sequence), usual)
    values[0] = 1e-26
    monkeypatch.setattr(figures_statistics, "nees", lambda *_: values)
    panel = Figure().subplots()
    figures_statistics.draw_nees_over_time(runs, panel)
    low, high = panel.get_ylim()
    assert 1e-6 < low < usual < high


@pytest.mark.parametrize(
    ("metres", "why"), [(1e155, "beyond 1e+12 m"), (np.nan, "[bad-result] the pose is not finite")]
)
def test_a_tracker_that_answers_out_of_reach_loses_the_frame_by_name(metres, why):
    class Away:
        def track(self, image, stamp_ns):
            return TrackResult(status="ok", cam_from_world=Pose(np.eye(3), np.array([metres, 0, 0])))

    result, error = track_frame(Away(), np.zeros((4, 4), np.uint8), 0)
    assert result.status == "lost" and result.cam_from_world is None and why in error
