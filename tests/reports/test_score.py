"""Scores: closed forms, and failures that are never dropped."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.reports.drawn import RATE_HZ, make_sequence, results_of, track, true_rows
from uavbench.reports.scoring.score import Score, score
from uavbench.scenes.dataset.crlb import write_bounds
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.tracker.protocol import TrackResult
from uavbench.tracker.results import Results
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.pose import Pose

LOST = TrackResult(status="lost")


def test_a_known_offset_is_the_error(sequence: Sequence) -> None:
    found = score(sequence, results_of(sequence, true_rows(sequence, offset_m=0.03)))
    assert found.status == "complete"
    assert found.tracking.coverage == found.tracking.success == 1.0
    assert found.tracking.success_auc == pytest.approx(0.7, abs=1e-9)
    assert found.ate["none"].translation_m.rmse == pytest.approx(0.03, abs=1e-12)
    assert found.ate["none"].rotation_deg.max == pytest.approx(0.0, abs=1e-9)
    assert found.rpe["1 frame"].translation_m.n == len(sequence) - 1
    assert found.rpe["1 s"].translation_m.n == len(sequence) - RATE_HZ
    assert found.latency["total"].max_ms == 10.0 + len(sequence) - 1
    assert found.tracking.time_to_first_loss_s is None


def test_lost_frames_are_failures_and_the_ends_of_no_motion(sequence: Sequence) -> None:
    rows = true_rows(sequence)
    rows[15:30] = [LOST] * 15
    found = score(sequence, results_of(sequence, rows))
    assert found.status == "lost"
    assert found.tracking.coverage == found.tracking.success == pytest.approx(30 / 45)
    assert found.tracking.success_auc == pytest.approx(30 / 45)
    assert found.tracking.failures == 1
    assert found.tracking.failures_per_minute == pytest.approx(20.0, rel=1e-6)
    assert found.tracking.time_to_first_loss_s == pytest.approx(1.0)
    assert found.tracking.time_to_recover_s == pytest.approx(1.0)
    assert found.rpe["1 frame"].translation_m.n == 28
    assert found.ate["none"].translation_m.n == 30


def test_a_run_that_stopped_early_is_crashed_and_its_missing_frames_failed(sequence: Sequence) -> None:
    found = score(sequence, results_of(sequence, true_rows(sequence)[:9]))
    assert found.status == "crashed"
    assert found.tracking.coverage == pytest.approx(9 / 45)
    assert "stopped early" in found.errors[0]


def test_a_tracker_that_raised_is_crashed(sequence: Sequence) -> None:
    results = results_of(sequence, true_rows(sequence))
    raised = replace(results, record={**results.record, "errors": ["frame 3: ValueError: no"]})
    assert score(sequence, raised).status == "crashed"


def test_no_pose_at_all_scores_worst_without_an_error(sequence: Sequence) -> None:
    found = score(sequence, results_of(sequence, [LOST] * len(sequence)))
    assert found.tracking.coverage == found.tracking.success == found.tracking.success_auc == 0.0
    assert found.ate["none"].translation_m is None
    assert found.ate["none"].undefined == "no frame has a pose"
    assert found.tracking.time_to_first_loss_s == 0.0
    assert found.tracking.time_to_recover_s is None


def test_a_pose_that_is_not_a_number_is_no_pose(sequence: Sequence) -> None:
    rows = true_rows(sequence)
    rows[4] = replace(rows[4], cam_from_world=Pose(np.eye(3), [np.nan, 0, 0]))
    found = score(sequence, results_of(sequence, rows))
    assert found.tracking.with_pose == len(sequence) - 1
    assert found.status == "lost"


def test_alignment_of_a_pose_that_stands_still_is_undefined_and_says_so(sequence: Sequence) -> None:
    found = score(sequence, track(sequence, "hold", RATE_HZ))
    assert found.ate["none"].translation_m.rmse > 0.1
    assert found.ate["se3"].translation_m is None
    assert "do not move" in found.ate["se3"].undefined


def test_one_hertz_expects_one_frame_a_second(sequence: Sequence) -> None:
    found = score(sequence, track(sequence, "hold", 1.0))
    assert found.tracking.frames == 3
    assert found.tracking.coverage == 1.0


def test_a_score_reads_back_equal(sequence: Sequence, tmp_path) -> None:
    found = score(sequence, track(sequence, "hold", RATE_HZ))
    found.save(tmp_path / "score.json", content_hash="abc")
    assert Score.load(tmp_path / "score.json") == found
    assert json.loads((tmp_path / "score.json").read_text())["content_hash"] == "abc"


def test_results_survive_their_files_to_the_last_digit(sequence: Sequence, tmp_path) -> None:
    results = results_of(sequence, true_rows(sequence, offset_m=0.01))
    results.save(tmp_path / "run")
    again = score(sequence, Results.load(tmp_path / "run"))
    assert again.ate["none"].translation_m.rmse == pytest.approx(0.01, abs=1e-12)


def test_results_of_another_sequence_are_refused(sequence: Sequence, tmp_path) -> None:
    other = make_sequence(tmp_path / "other", 3, name="other")
    with pytest.raises(UserError, match="another sequence"):
        score(other, results_of(sequence, true_rows(sequence)))


def test_frames_off_the_rate_are_refused(sequence: Sequence) -> None:
    results = results_of(sequence, true_rows(sequence))
    slow = replace(results, record={**results.record, "rate_hz": 1.0})
    with pytest.raises(UserError, match="hold frame 1, which a run at 1 Hz does not track"):
        score(sequence, slow)


def test_a_damaged_score_is_named(tmp_path) -> None:
    (tmp_path / "score.json").write_text('{"label": "lsd"}')
    with pytest.raises(UserError, match=r"score.json: not a score: rate_hz"):
        Score.load(tmp_path / "score.json")


def test_the_error_is_told_in_bounds_of_the_image(tmp_path: Path) -> None:
    """1 mm of bound along each axis and no rotation: an offset of 3 cm is 3 / sqrt(3) / 0.1 bounds."""
    sequence = make_sequence(tmp_path / "bounded", 6)
    rows = true_rows(sequence, offset_m=0.03)
    assert score(sequence, results_of(sequence, rows)).bound is None
    write_bounds(sequence.folder, {frame: np.diag([1e-6] * 3 + [0.0] * 3) for frame in (0, 2, 4)})
    rows[2] = LOST
    found = score(Sequence.load(sequence.folder), results_of(sequence, rows)).bound
    assert found is not None and found.n == 2
    assert found.median == pytest.approx(30 / np.sqrt(3), rel=1e-9)
