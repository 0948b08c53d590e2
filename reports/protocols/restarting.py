"""Protocols other than the free run: reset on failure, anchored restarts, replay in real time.

Conventions: a protocol runs the same tracker on the same frames as the free run, with results in the same format.
Frames right after a reset are burn-in: they follow a given pose, so they are excluded from accuracy.
"""

from collections.abc import Sequence as ListOf
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.reports.metrics.ape import absolute_errors
from uavbench.reports.metrics.association import NS, PosePairs
from uavbench.reports.metrics.frame_errors import SUCCESS_DEG, SUCCESS_M, ended_s, estimated_bodies, frame_errors
from uavbench.reports.metrics.quaternions import normalized
from uavbench.reports.metrics.summary_statistics import ErrorSummary
from uavbench.scenes.dataset.body import Feed
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.tracker.protocol import Tracker, TrackResult
from uavbench.tracker.results import Results, cam_from_evaluated, evaluated_poses
from uavbench.tracker.run import begin, make_record, stride, track_frame, tracker_stream
from uavbench.tracker.sound_results import sound
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.pose import Array, Pose

FLAGS = ("given", "counted", "failed")
BURN_IN_FRAMES = 5
"""Frames after a given pose that are excluded from accuracy (ten in the VOT reset protocol)."""


@dataclass(frozen=True, eq=False)
class Restarted:
    """Results of a run that was restarted from true poses.

    given (n,): the row started from a true pose; counted (n,): it counts for accuracy; failed (n,): it was lost or
    beyond 5 cm or 5 deg. All are stored in the record of the results.
    """

    results: Results
    given: NDArray[np.bool_]
    counted: NDArray[np.bool_]
    failed: NDArray[np.bool_]

    @classmethod
    def load(cls, folder: Path) -> "Restarted":
        """Read what was saved of `results`; UserError when it was not a run under such a protocol."""
        results, _ = sound(Results.load(folder))
        flags = []
        for name in FLAGS:
            rows = results.record.get(f"{name}_rows")
            if not isinstance(rows, list) or not all(isinstance(k, int) and 0 <= k < len(results) for k in rows):
                raise UserError(f"{folder / 'record.json'}: {name}_rows: not rows of frames.csv; track again")
            flags.append(np.isin(np.arange(len(results)), rows))
        return cls(results, *flags)

    @property
    def failures_per_minute(self) -> float:
        """Failed frames that led to a reset, per minute of the run's duration, as of a free run."""
        minutes = ended_s((self.results.stamps_ns - self.results.stamps_ns[0]) / NS) / 60
        return float(self.failed.sum()) / minutes if minutes > 0 else float(self.failed.sum())


def run_with_resets(
    tracker: Tracker, sequence: Sequence, *, rate_hz: float, seed: int, burn_in: int = BURN_IN_FRAMES
) -> Restarted:
    """Reset protocol: after a frame beyond 5 cm or 5 deg, or without a pose, the next starts from the ground truth."""
    return _drive(tracker, sequence, rate_hz, seed, burn_in, anchors=frozenset([0]), on_failure=True)


def run_from_anchors(
    tracker: Tracker, sequence: Sequence, *, rate_hz: float, seed: int, every_s: float = 5.0, burn_in: int = 0
) -> Restarted:
    """Anchored restarts: the run is restarted from the ground truth at fixed intervals, regardless of failures."""
    if not every_s > 0:
        raise UserError(f"every_s = {every_s}: must be positive")
    frames = np.arange(0, len(sequence), stride(sequence, rate_hz))
    seconds = (sequence.stamps_ns[frames] - sequence.stamps_ns[0]) / NS
    anchors = np.flatnonzero(np.diff(np.floor(seconds / every_s + 1e-9), prepend=-1.0) > 0)
    return _drive(tracker, sequence, rate_hz, seed, burn_in, anchors=frozenset(anchors.tolist()), on_failure=False)


class ExpectedError(NamedTuple):
    """Time (k,) in s since the last given pose, median position error (k,) in m, and share (k,) of failed frames."""

    since_s: Array
    median_m: Array
    failed_share: Array


class RestartedOn(NamedTuple):
    """A run that was restarted from true poses, and its sequence."""

    restarted: Restarted
    sequence: Sequence


def expected_error(runs: ListOf[RestartedOn]) -> ExpectedError:
    """Error against the time since the last given pose, over all runs of one tracker at one rate.

    The median is infinite where more than half of the frames have no pose.
    """
    since, metres, failed = [], [], []
    for restarted, sequence in runs:
        errors = frame_errors(sequence, restarted.results)
        starts = np.flatnonzero(restarted.given)
        rows = np.arange(len(errors))
        since.append(rows - starts[np.searchsorted(starts, rows, side="right") - 1])
        metres.append(errors.translation_m)
        failed.append(restarted.failed)
    step_s = float(np.median(np.diff(errors.seconds))) if len(errors) > 1 else 0.0
    steps, which = np.unique(np.concatenate(since), return_inverse=True)
    of_step = [(np.concatenate(metres)[which == k], np.concatenate(failed)[which == k]) for k in range(len(steps))]
    median = np.array([float(np.median(m)) for m, _ in of_step])
    share = np.array([float(f.mean()) for _, f in of_step])
    since_s: Array = step_s * steps.astype(np.float64)
    return ExpectedError(since_s, median, share)


PROTOCOLS = {"reset": run_with_resets, "anchors": run_from_anchors}
"""Every protocol with restarts from true poses, by name."""


@dataclass(frozen=True, kw_only=True)
class Replay:
    """Poses available in real time: at each frame of the sequence the latest pose delivered by then.

    dropped: share of frames that arrived while the tracker was busy; age_ms: median age of the available pose, None
    without any; translation_m, rotation_deg: errors against the ground truth of the current frame; success: share of
    frames within 5 cm and 5 deg.
    """

    dropped: float
    age_ms: float | None
    translation_m: ErrorSummary | None
    rotation_deg: ErrorSummary | None
    success: float


def replay_in_real_time(sequence: Sequence, results: Results) -> Replay | None:
    """Replay of results with their wall-clock times: a busy tracker misses frames, and poses arrive with its latency.

    The poses are those of the free run; a tracker that really misses frames would predict over longer intervals, so
    this is a lower bound on the cost of latency. None when the results have no times.
    """
    if not len(results) or any("total" not in row.stage_ms for row in results.rows):
        return None
    free_at, out_at, rows = -1, [], []
    for k, (stamp, row) in enumerate(zip(results.stamps_ns.tolist(), results.rows, strict=True)):
        if stamp < free_at:
            continue
        free_at = stamp + round(1e6 * row.stage_ms["total"])
        out_at.append(free_at)
        rows.append(k)
    ground_truth = evaluated_poses(sequence)
    newest = np.searchsorted(np.array(out_at), sequence.stamps_ns, side="right") - 1
    positions, quaternions = estimated_bodies(results)
    row_of = np.array(rows)[np.maximum(newest, 0)]
    known = (newest >= 0) & np.isfinite(positions[row_of]).all(axis=1)
    pairs = PosePairs(
        ground_truth.stamps_ns[known], ground_truth.positions_m[known],
        normalized(ground_truth.quaternions_wxyz[known]),
        positions[row_of[known]], quaternions[row_of[known]],
    )  # fmt: skip
    metres, degrees = absolute_errors(pairs, "translation_m"), absolute_errors(pairs, "angle_deg")
    ages = (sequence.stamps_ns[known] - results.stamps_ns[row_of[known]]) / 1e6
    return Replay(
        dropped=1 - len(rows) / len(results),
        age_ms=float(np.median(ages)) if known.any() else None,
        translation_m=ErrorSummary.of(metres) if known.any() else None,
        rotation_deg=ErrorSummary.of(degrees) if known.any() else None,
        success=float(((metres <= SUCCESS_M) & (degrees <= SUCCESS_DEG)).sum() / len(sequence)),
    )


def _drive(
    tracker: Tracker,
    sequence: Sequence,
    rate_hz: float,
    seed: int,
    burn_in: int,
    *,
    anchors: frozenset[int],
    on_failure: bool,
) -> Restarted:
    frames = np.arange(0, len(sequence), stride(sequence, rate_hz))
    feed = Feed(sequence)
    rows: list[TrackResult] = []
    errors: list[str] = []
    given, counted, failed = (np.zeros(len(frames), dtype=bool) for _ in range(3))
    run, since, reset = None, 0, False
    for k, frame in enumerate(frames.tolist()):
        if run is None or reset or k in anchors:
            rng = tracker_stream(tracker, seed, "restart", k)
            run = begin(tracker, sequence, sequence.true_cam_from_world(frame), rng, feed.body)
            given[k], since = True, 0
        stamp_ns = int(sequence.stamps_ns[frame])
        result, error = track_frame(run, sequence.image(frame), stamp_ns, feed.upto(stamp_ns))
        if error:
            errors.append(f"frame {frame}: {error}")
        rows.append(result)
        failed[k] = not succeeds(result, sequence, frame)
        counted[k] = since >= burn_in
        reset = on_failure and bool(failed[k])
        since += 1
    record = make_record(tracker, sequence, rate_hz=rate_hz, seed=seed, errors=errors)
    record = {**record, "protocol": "reset" if on_failure else "anchors", "burn_in_frames": burn_in}
    for name, flags in zip(FLAGS, (given, counted, failed), strict=True):
        record[f"{name}_rows"] = np.flatnonzero(flags).tolist()
    return Restarted(Results(record, frames, sequence.stamps_ns[frames], tuple(rows)), given, counted, failed)


def succeeds(result: TrackResult, sequence: Sequence, frame: int) -> bool:
    """Whether a result is within 5 cm and 5 deg of the ground truth."""
    if result.cam_from_world is None:
        return False
    estimate = result.cam_from_world.inverse() @ cam_from_evaluated(sequence)
    error: Pose = evaluated_poses(sequence).pose(frame).inverse() @ estimate
    angle_deg = np.degrees(np.linalg.norm(error.log()[3:]))
    return bool(np.linalg.norm(error.translation) <= SUCCESS_M and angle_deg <= SUCCESS_DEG)


def accuracy(restarted: Restarted, sequence: Sequence) -> ErrorSummary | None:
    """Position errors in m of the frames that count and have a pose; read it with failures_per_minute."""
    errors = frame_errors(sequence, restarted.results)
    kept = errors.translation_m[errors.ok & restarted.counted]
    return ErrorSummary.of(kept) if len(kept) else None
