"""`uavbench evaluate` doubts results against the ground truth of another sequence, whose stamps fit all the same."""

import json
from pathlib import Path

import numpy as np
import pytest

from uavbench.reports.evaluation.evaluate import evaluate_files
from uavbench.reports.evaluation.find_trajectory import POSE
from uavbench.trajectories.trajectory import Trajectory
from uavbench.trajectories.trajectory_files.formats import write_tum

N = 20
TURN = np.linspace(0, 1, N)
QUATERNIONS = np.column_stack([np.cos(TURN), 0 * TURN, 0 * TURN, np.sin(TURN)])
FLOWN = Trajectory(np.arange(N) * 100_000_000, np.column_stack([TURN, TURN**2, 0 * TURN]), QUATERNIONS)


def sequence(folder: Path, about: object) -> Path:
    folder.mkdir()
    (folder / "sequence.json").write_text(json.dumps(about))
    table = np.column_stack([FLOWN.positions_m, FLOWN.quaternions_wxyz]).tolist()
    rows = [",".join(map(repr, [stamp, *row])) for stamp, row in zip(FLOWN.stamps_ns.tolist(), table, strict=True)]
    (folder / "groundtruth.csv").write_text("\n".join([",".join(["stamp_ns", *POSE]), *rows]) + "\n")
    return folder


def results(folder: Path, about: object) -> Path:
    folder.mkdir()
    (folder / "record.json").write_text(json.dumps(about))
    write_tum(FLOWN, folder / "estimate_world_from_body.tum", "world_from_body")
    return folder


@pytest.mark.parametrize(
    ("of", "said"),
    [
        ({"name": "box-s1", "content_hash": "b"}, "of the sequence box-s1"),
        ({"name": "box-s0", "content_hash": "b"}, "of another version of the sequence box-s0"),
        ({"name": "box-s0", "content_hash": "a"}, ""),
        ({"name": "box-s0"}, ""),
        ("box-s1", ""),
    ],
)
def test_results_of_another_sequence_are_doubted(tmp_path: Path, of: object, said: str) -> None:
    truth = sequence(tmp_path / "box-s0", {"name": "box-s0", "content_hash": "a"})
    tracked = results(tmp_path / "tracked", {"sequence": of})
    found = evaluate_files(truth, tracked)
    assert [said in doubt for doubt in found.record["doubts"]] == ([True] if said else [])
    assert ("record.json" in found.text()) == bool(said)
    named = evaluate_files(truth / "groundtruth.csv", tracked / "estimate_world_from_body.tum")
    assert named.record["doubts"] == found.record["doubts"]


def test_files_of_others_beside_a_record_are_not_doubted(tmp_path: Path) -> None:
    truth = sequence(tmp_path / "box-s0", {"name": "box-s0", "content_hash": "a"})
    tracked = results(tmp_path / "tracked", {"sequence": {"name": "box-s1", "content_hash": "b"}})
    write_tum(FLOWN, tracked / "mine.tum", "world_from_body")
    assert evaluate_files(truth, tracked / "mine.tum").record["doubts"] == []
    (tracked / "record.json").write_text("no JSON")
    assert evaluate_files(truth, tracked).record["doubts"] == []
