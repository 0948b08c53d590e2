"""`uavbench score-submission`: a submission against the organizer's ground truth."""

from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from uavbench.bench.challenge.organizer import Challenge, Hidden
from uavbench.bench.challenge.submission import Fault, find_submission
from uavbench.bench.challenge.submitted_poses import Frames, Rows, read_submitted
from uavbench.reports.evaluation.doubts.plausibility import doubts
from uavbench.reports.leaderboard.submission_score import SequenceScore, SubmissionScore
from uavbench.reports.metrics.association import Matches, paired
from uavbench.reports.metrics.frame_errors import FrameErrors, frame_errors
from uavbench.reports.metrics.summary_statistics import ErrorSummary
from uavbench.reports.scoring.points import hilti_score
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.tracker.results import Results
from uavbench.tracker.run import stride
from uavbench.trajectories.pose import Array
from uavbench.trajectories.trajectory import Trajectory


def score_submission(truth: Path, folder: Path) -> SubmissionScore:
    """Score of the submission in a folder; truth: the organizer's folder.

    Missing or invalid content counts as failed and is listed in the score's faults. UserError when the folder is not a
    submission, or the organizer's folder is incomplete.
    """
    challenge = Challenge.load(truth)
    sequences = {name: Sequence.load(truth / "sequences" / kept.name) for name, kept in challenge.sequences.items()}
    submission = find_submission(folder, challenge.sequences)
    faults = list(submission.faults)
    runs = {}
    for run, files in submission.runs.items():
        prefix = f"{run}/" if len(submission.runs) > 1 else ""
        runs[run] = {
            name: _score(sequence, challenge, challenge.sequences[name], files.get(name), prefix + name, faults)
            for name, sequence in sequences.items()
        }
    return SubmissionScore(
        name=submission.name, challenge=challenge.challenge, runs=runs, faults=tuple(map(str, faults))
    )


def _score(
    sequence: Sequence, challenge: Challenge, hidden: Hidden, path: Path | None, where: str, faults: list[Fault]
) -> SequenceScore:
    frames = np.arange(0, len(sequence), stride(sequence, challenge.rate_hz))
    wanted = Frames(sequence.stamps_ns[frames], sequence.cam_from_body)
    rows, found = (wanted.lost, [Fault("no-file", where, "there is no file")])
    if path is not None:
        rows, found = read_submitted(path, where, wanted)
    faults += found
    faults += [Fault("doubtful", where, what) for what in _doubts(sequence, frames, rows, path)]
    errors = frame_errors(sequence, _results(sequence, challenge.rate_hz, frames, rows))
    return SequenceScore(
        flight=hidden.flight,
        frames=len(errors),
        points=hilti_score(errors.translation_m),
        success=float(errors.success.mean()),
        coverage=float(errors.ok.mean()),
        ate_position_m=_rmse(errors, errors.translation_m),
        ate_rotation_deg=_rmse(errors, errors.angle_deg),
    )


def _doubts(sequence: Sequence, frames: NDArray[np.int64], rows: Rows, path: Path | None) -> Iterator[str]:
    """Likely mistakes in units, directions and quaternions of submitted poses, compared in the file's direction."""
    located = [(int(frame), row.cam_from_world) for frame, row in zip(frames, rows, strict=True) if row.cam_from_world]
    if not located or path is None:
        return
    stamps = [int(sequence.stamps_ns[frame]) for frame, _ in located]
    given = [pose for _, pose in located]
    true = [sequence.true_cam_from_world(frame) for frame, _ in located]
    both = [[p.inverse() for p in poses] if path.suffix == ".tum" else poses for poses in (true, given)]
    reference, estimate = (Trajectory.from_poses(stamps, poses) for poses in both)
    every = np.arange(len(located))
    yield from doubts(reference, estimate, paired(reference, estimate, Matches(every, every)), "none")


def _results(sequence: Sequence, rate_hz: float, frames: NDArray[np.int64], rows: Rows) -> Results:
    record: Mapping[str, object] = {
        "tracker": {"kind": "a submission"},
        "rate_hz": rate_hz,
        "sequence": {"name": sequence.name, "content_hash": sequence.content_hash},
        "cam_from_body": sequence.cam_from_body.matrix.tolist(),
    }
    return Results(record, frames, sequence.stamps_ns[frames], rows)


def _rmse(errors: FrameErrors, values: Array) -> float | None:
    return ErrorSummary.of(values[errors.ok]).rmse if errors.ok.any() else None
