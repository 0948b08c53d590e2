"""Poses that a tracker writes in another convention are scored as they are, and told; those of lost ones are not."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.reports.drawn import results_of, track, true_rows
from uavbench.reports.report import ReportInputs, write_report
from uavbench.reports.scoring.runs import ReportEntry
from uavbench.reports.scoring.score import Score, score
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.tracker.protocol import TrackResult
from uavbench.trajectories.pose import Pose

FLIP = Pose(np.diag([1.0, -1.0, -1.0]), np.zeros(3))
QUARTER = Pose(np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]), np.zeros(3))
Y_UP = Pose(np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]), np.zeros(3))


def written(sequence: Sequence, convention: Callable[[Pose], Pose], first: int = 0) -> list[TrackResult]:
    """True poses, from the given frame on in another convention."""
    rows = true_rows(sequence)
    poses = [sequence.true_cam_from_world(frame) for frame in range(len(rows))]
    return [
        replace(row, cam_from_world=convention(pose)) if frame >= first else row
        for frame, (row, pose) in enumerate(zip(rows, poses, strict=True))
    ]


def w_last(pose: Pose) -> Pose:
    w, x, y, z = pose.quaternion_wxyz
    return Pose.from_quaternion([x, y, z, w], pose.translation)


CONVENTIONS: dict[str, tuple[Callable[[Pose], Pose], str]] = {
    "w last": (w_last, "would fit if its quaternions were read w last"),
    "world_from_cam": (lambda pose: pose.inverse(), "would fit if its poses were inverted"),
    "conjugated": (lambda pose: Pose(pose.rotation.T, pose.translation), "would fit if its poses were inverted"),
    "millimetres": (
        lambda pose: Pose(pose.rotation, 1e3 * pose.translation),
        "the first translation is 1,000 times that of the initial pose",
    ),
    "OpenGL": (lambda pose: FLIP @ pose, "turned by the same 180 degrees in all poses"),
    "y up": (lambda pose: pose @ Y_UP, "in a world turned by 90 degrees"),
    "the camera's place": (lambda pose: Pose(pose.rotation, pose.inverse().translation), "the first pose is"),
}


@pytest.mark.parametrize("name", CONVENTIONS)
def test_poses_of_another_convention_are_told(sequence: Sequence, tmp_path: Path, name: str) -> None:
    convention, said = CONVENTIONS[name]
    found = score(sequence, results_of(sequence, written(sequence, convention)))
    assert len(found.doubts) == 1 and said in found.doubts[0], found.doubts
    assert "write cam_from_world, in metres, w first" in found.doubts[0]
    found.save(tmp_path / "score.json")
    assert Score.load(tmp_path / "score.json").doubts == found.doubts


def test_right_poses_and_those_of_trackers_that_drift_or_slip_leave_no_doubt(sequence: Sequence) -> None:
    """One that slips by a quarter turn about a structure with equal sides is right at first."""
    given = [
        true_rows(sequence),
        true_rows(sequence, offset_m=0.3),
        written(sequence, lambda pose: pose @ QUARTER, first=5),
        [TrackResult(status="lost")] * len(sequence),
    ]
    for rows in given:
        found = score(sequence, results_of(sequence, rows))
        assert found.doubts == () and "doubts" not in found.to_json()
    for kind in ("hold", "rapid", "lsd"):
        for rate_hz in (15.0, 1.0):
            assert score(sequence, track(sequence, kind, rate_hz)).doubts == ()


def test_the_page_tells_it_beside_the_failure(sequence: Sequence, tmp_path: Path) -> None:
    folder = tmp_path / "mine@15hz"
    results = results_of(sequence, written(sequence, lambda pose: pose.inverse()))
    results = replace(results, record={**results.record, "label": "mine", "tracker": {"kind": "external"}})
    results.save(folder)
    score(sequence, results).save(folder / "score.json")
    entry = ReportEntry(sequence.folder, folder, folder / "score.json")
    page = write_report(tmp_path / "report", ReportInputs("Ours", [entry])).read_text()
    assert "doubt: the rotations of the estimate would fit if its poses were inverted" in page
