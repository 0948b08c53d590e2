"""What the commands of the contract tests read."""

import json
import shutil

import cv2
import numpy as np
import pytest

from tests.bench.conftest import sketched  # noqa: F401, a fixture
from tests.bench.drawn_scores import drawn, write
from tests.bench.small_suites import FLOWN, small_suite
from tests.scenes.scanned import fine_box, write_ply
from uavbench.bench.challenge.organizer import Challenge, Hidden
from uavbench.bench.challenge.scoring import score_submission
from uavbench.bench.config.suite import load_suite
from uavbench.bench.trial.check import TRIAL
from uavbench.reports.history.history_file import Commit, History, SuiteIdentity, write_history
from uavbench.reports.report import ReportInputs, write_scores
from uavbench.reports.scoring.score import score
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.scenes.dataset.spec_record import described
from uavbench.tracker.baselines.hold import Hold
from uavbench.tracker.run import track_sequence


@pytest.fixture(scope="session")
def inputs(tmp_path_factory):
    """What the commands read."""
    folder = tmp_path_factory.mktemp("inputs")
    small_suite(folder)
    (folder / "flown.toml").write_text(FLOWN)
    (folder / "studied").mkdir()
    small_suite(folder / "studied", 'rapid = { kind = "rapid" }\n')
    (folder / "images").mkdir()
    shutil.copytree(TRIAL, folder / "trial")
    shutil.copytree(TRIAL, folder / "rendered")
    (spec,) = load_suite(TRIAL.parent / "suite.toml").sequences
    info = json.loads((TRIAL / "sequence.json").read_text()) | {"config": described(spec)}
    (folder / "rendered" / "sequence.json").write_text(json.dumps(info))
    (folder / "report").mkdir()
    sequence = Sequence.load(TRIAL)
    results = track_sequence(Hold(), sequence, rate_hz=5.0, seed=0)
    write_scores(folder / "report", ReportInputs("small", []), [score(sequence, results)])
    for name in ("000000.png", "000001.png"):
        shutil.copy(TRIAL / "frames" / name, folder / "images" / name)
    tracker = '{ kind = "external", command = ["false"] }'
    (folder / "bad.toml").write_text(tracker.strip("{} ").replace(", command", "\ncommand"))
    (folder / "init.toml").write_text(f"cam_from_model = {sequence.true_cam_from_world(0).matrix.tolist()}\n")
    for name in ("a.tum", "b.tum"):
        (folder / name).write_text("".join(f"{i}.0 {i} 0 0 0 0 0 1\n" for i in range(5)))
    write_ply(folder / "scan.ply", *fine_box(0.02))
    cv2.imwrite(str(folder / "board.png"), np.zeros((120, 160), np.uint8))
    shutil.copytree(TRIAL, folder / "organizer" / "sequences" / "trial")
    Challenge("c", 5.0, {"sequence-01": Hidden("trial", "flight-1")}).save(folder / "organizer")
    (folder / "team").mkdir()
    shutil.copy(folder / "a.tum", folder / "team" / "sequence-01.tum")
    score_submission(folder / "organizer", folder / "team").save(folder / "score.json")
    write(folder / "results", drawn(np.random.default_rng(0)))
    line = Commit(commit="1f3a", time="2026-03-01T12:00:00+00:00", subject="first", environment={}, metrics={})
    suite = SuiteIdentity(name="small", flights="these", how={})
    write_history(folder / "history.json", History(suite=suite, name="ci", environment={}, commits=[line]))
    return folder
