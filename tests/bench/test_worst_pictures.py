"""Pictures of the worst sequences: which, of which frame, and that they show both poses."""

import json
import re
import shutil
from dataclasses import replace

import cv2
import numpy as np
import pytest
from click.testing import CliRunner

from tests.bench.drawn_scores import make_score, write
from tests.reports.drawn import make_sequence, track
from uavbench.bench.cli.main import main
from uavbench.bench.gate.baseline import write_baseline
from uavbench.bench.gate.decision import Margins
from uavbench.bench.gate.paired_scores import Measured, read_side
from uavbench.bench.gate.worst_pictures import GAP_PX, WIDTH_PX, worsening, write_worst
from uavbench.bench.runner.output_folder import WORST
from uavbench.reports.scoring.score import score
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.tracker.protocol import TrackResult
from uavbench.trajectories.pose import Pose

NAMES = [f"arc-s{seed}" for seed in range(4)]
RUN = "hold@15hz"
LOST = TrackResult(status="lost")


def moved(result, metres):
    return replace(result, cam_from_world=Pose.exp([metres, 0, 0, 0, 0, 0]) @ result.cam_from_world)


@pytest.fixture(scope="module")
def drawn(tmp_path_factory):
    folder = tmp_path_factory.mktemp("drawn") / "arc"
    sequence = make_sequence(folder, 12)
    true = [TrackResult(status="ok", cam_from_world=sequence.true_cam_from_world(k)) for k in range(len(sequence))]
    return sequence, replace(track(sequence, "hold", 15), rows=tuple(true))


@pytest.fixture
def sides(drawn, tmp_path):
    """Base: 1 cm off everywhere. Head: s0 as base, s1 4 cm at frame 7, s2 without frames 5 to 10, s3 1.2 cm off."""
    sequence, true = drawn
    one = tuple(moved(row, 0.01) for row in true.rows)
    heads = {
        "arc-s0": one,
        "arc-s1": (*one[:7], moved(true.rows[7], 0.04), *one[8:]),
        "arc-s2": (*one[:5], *[LOST] * 6, *one[11:]),
        "arc-s3": tuple(moved(row, 0.012) for row in true.rows),
    }
    for side in ("base", "head"):
        for name in NAMES:
            shutil.copytree(sequence.folder, tmp_path / side / "sequences" / name)
            own = Sequence.load(tmp_path / side / "sequences" / name)
            results = replace(true, rows=heads[name] if side == "head" else one)
            folder = tmp_path / side / "results" / name / RUN
            results.save(folder)
            score(own, results).save(folder / "score.json")
        about = {"sequences": NAMES, "trackers": ["hold"], "rates_hz": [15.0], "flights": "these"}
        (tmp_path / side / "suite.json").write_text(json.dumps(about))
    return tmp_path / "head", tmp_path / "base"


def test_the_three_that_became_worst_are_shown_by_their_worst_frames(sides, tmp_path):
    text = write_worst(*sides, Margins(), tmp_path / "out")
    found = re.findall(r"\*\*arc, seed (\d)\*\*, `hold@15hz`: (.+); frame (\d+): (.+) before, (.+) after\.", text)
    assert [(seed, frame) for seed, _, frame, _, _ in found[:2]] == [("2", "5"), ("1", "7")] and found[2][0] == "3"
    assert found[0][4] == "no pose" and found[0][1].endswith("coverage 100 to 50 %")
    assert found[1][3].startswith("1.00 cm") and found[1][4].startswith("4.00 cm")
    shown = re.findall(r"!\[.*\]\((.+)\)", text)
    assert shown == [f"{WORST}/{k}.png" for k in (1, 2, 3)]
    for name in shown:
        picture = cv2.imread(str(tmp_path / "out" / name)).astype(int)
        left, right = picture[:, :WIDTH_PX], picture[:, WIDTH_PX + GAP_PX :]
        assert left.shape == right.shape
        green = [int(((p[..., 1] - p[..., 0] > 60) & (p[..., 1] - p[..., 2] > 60)).sum()) for p in (left, right)]
        assert green[0] > 100, "the baseline's model is drawn"
        assert (green[1] > 100) == (name != f"{WORST}/1.png"), "and that of the results where it has a pose"
        assert (tmp_path / "out" / name).stat().st_size < 150_000


def test_the_gate_writes_and_shows_them_and_those_of_last_time_go(sides, tmp_path):
    head, base = sides
    out = head / "gate"
    for shown in (3, 1):
        done = CliRunner().invoke(main, ["gate", str(head), "--baseline", str(base)])
        assert done.exit_code == 3, done.output  # four seeds
        text = (out / "gate.md").read_text()
        assert text.startswith("## uavbench gate: inconclusive") and text.count("![") == shown
        assert len(list((out / WORST).glob("*.png"))) == shown
        for name in NAMES[1:]:  # the frames of the others are not kept
            shutil.rmtree(head / "sequences" / name, ignore_errors=True)


def test_without_frames_or_with_a_baseline_in_one_file_there_is_none(sides, tmp_path):
    head, base = sides
    file = tmp_path / "baseline.json"
    write_baseline(read_side(base), file)
    assert write_worst(head, file, Margins(), tmp_path / "out") == ""
    scores = [make_score("s0", k, 0.01) for k in range(5)]
    bare = write(tmp_path / "bare", scores, sequences=1)
    assert write_worst(bare, bare, Margins(), tmp_path / "out") == ""
    assert not (tmp_path / "out").exists()


def test_what_became_worst_counts_in_units_of_its_margin():
    base = Measured(coverage=1.0, errors={"ATE": 0.01, "RPE 1 s": np.nan})
    margins = Margins(error=0.01, coverage=0.01)
    assert worsening(base, base, margins) == 0.0
    assert worsening(base, replace(base, errors={"ATE": 0.0101}), margins) == pytest.approx(1.0)
    assert worsening(base, replace(base, coverage=0.98), margins) == pytest.approx(2.0)
    assert worsening(base, replace(base, errors={"ATE": np.nan}), margins) == np.inf
    assert worsening(base, replace(base, crash="it fell over"), margins) == np.inf
    assert worsening(base, replace(base, errors={"ATE": 0.005}), margins) <= 0
    assert np.isfinite(worsening(base, replace(base, coverage=0.9), Margins(error=0.0, coverage=0.0)))
