"""Resets, anchors and the replay in real time, on runs whose outcome is known."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from tests.reports.drawn import RATE_HZ, results_of, true_rows
from uavbench.reports.protocols.restarting import (
    Restarted,
    RestartedOn,
    accuracy,
    expected_error,
    replay_in_real_time,
    run_from_anchors,
    run_with_resets,
)
from uavbench.reports.scoring.score import Score, score
from uavbench.scenes.camera import Camera
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.scenes.structure import Structure
from uavbench.tracker.baselines.hold import Hold
from uavbench.tracker.protocol import Image, Run, TrackResult
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.pose import Pose


@dataclass(frozen=True)
class DropsOut:
    """Holds the initial pose for a few frames, then is lost for ever."""

    frames: int = 2

    def start(self, structure: Structure, camera: Camera, cam_from_world: Pose, rng: np.random.Generator) -> Run:
        left = [self.frames]

        class Started:
            def track(self, image: Image, stamp_ns: int) -> TrackResult:
                left[0] -= 1
                if left[0] < 0:
                    return TrackResult(status="lost")
                return TrackResult(status="ok", cam_from_world=cam_from_world)

        return Started()


def test_a_reset_follows_every_failure(sequence: Sequence) -> None:
    run = run_with_resets(DropsOut(), sequence, rate_hz=RATE_HZ, seed=0, burn_in=1)
    assert run.given[0] and not run.failed[0]
    assert (run.given[1:] == run.failed[:-1]).all()
    assert not run.counted[run.given].any()
    minutes = len(sequence) / RATE_HZ / 60  # as in `tracking`
    assert run.failures_per_minute == pytest.approx(run.failed.sum() / minutes, rel=1e-6)
    found = accuracy(run, sequence)
    assert found is not None and found.n == (run.counted & run.results.ok).sum()


def test_a_run_with_resets_survives_its_folder(sequence: Sequence, tmp_path: Path) -> None:
    run = run_with_resets(DropsOut(), sequence, rate_hz=RATE_HZ, seed=0, burn_in=1)
    run.results.save(tmp_path / "reset")
    again = Restarted.load(tmp_path / "reset")
    for name in ("given", "counted", "failed"):
        assert (getattr(again, name) == getattr(run, name)).all()
    free = results_of(sequence, true_rows(sequence))
    free.save(tmp_path / "free")
    with pytest.raises(UserError, match="given_rows"):
        Restarted.load(tmp_path / "free")


def test_no_failure_no_reset(sequence: Sequence) -> None:
    run = run_from_anchors(Hold(), sequence, rate_hz=RATE_HZ, seed=0, every_s=1.0)
    assert np.flatnonzero(run.given).tolist() == [0, 15, 30]


def test_expected_error_grows_from_zero_after_an_anchor(sequence: Sequence) -> None:
    run = run_from_anchors(Hold(), sequence, rate_hz=RATE_HZ, seed=0, every_s=1.0)
    since, median, lost = expected_error([RestartedOn(run, sequence)] * 2)
    assert len(since) == 15
    assert median[0] == pytest.approx(0, abs=1e-12)
    assert (np.diff(median) > 0).all()
    assert lost[0] == 0 and lost[-1] == 1


def test_anchors_need_a_positive_time(sequence: Sequence) -> None:
    with pytest.raises(UserError, match="every_s"):
        run_from_anchors(Hold(), sequence, rate_hz=RATE_HZ, seed=0, every_s=0)


@pytest.mark.parametrize(("wall_ms", "dropped", "age_ms"), [(1.0, 0.0, 67.0), (100.0, 22 / 45, 133.0)])
def test_a_late_tracker_drops_frames_and_its_poses_age(
    sequence: Sequence, wall_ms: float, dropped: float, age_ms: float
) -> None:
    rows = [replace(row, stage_ms={"total": wall_ms}) for row in true_rows(sequence)]
    found = replay_in_real_time(sequence, results_of(sequence, rows))
    assert found is not None
    assert found.dropped == pytest.approx(dropped)
    assert found.age_ms == pytest.approx(age_ms, rel=0.02)
    assert found.translation_m is not None and found.translation_m.min > 0  # the ground truth has moved on meanwhile


def test_a_replay_without_a_pose_in_time_can_be_saved(sequence: Sequence, tmp_path: Path) -> None:
    rows = [replace(row, stage_ms={"total": 60_000.0}) for row in true_rows(sequence)]
    scored = score(sequence, results_of(sequence, rows))
    scored.save(tmp_path / "score.json")
    again = Score.load(tmp_path / "score.json").replay
    assert again is not None and again.age_ms is None and again.success == 0


def test_a_replay_needs_times(sequence: Sequence) -> None:
    rows = [replace(row, stage_ms={}) for row in true_rows(sequence)]
    assert replay_in_real_time(sequence, results_of(sequence, rows)) is None
