"""A baseline in one file: made by the command, never by hand, of the same flights, on frames rendered anew."""

import hashlib
import json
import math
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from tests.bench.drawn_scores import drawn, make_score, write
from uavbench.bench.cli.main import main
from uavbench.bench.config.suite import load_suite
from uavbench.bench.config.suite_files import suite_file
from uavbench.bench.gate.baseline import read_baseline, write_baseline
from uavbench.bench.gate.decision import Margins, gate, overall
from uavbench.bench.gate.paired_scores import FLOWN, Measured, Side, read_side
from uavbench.trajectories.errors import UserError

TRIAL = Path(__file__).parents[2] / "bench" / "trial" / "sequence"
RENDERED = """
title = "Of files"
rates_hz = [15.0]
sequences.mine.structure = { kind = "mesh", path = "house.obj" }
sequences.mine.environment = { kind = "studio" }
sequences.mine.flight.path = { kind = "waypoints", file = "way.csv" }
sequences.mine.flight.airframe = { kind = "file", path = "vehicle.toml" }
sequences.flown.structure = { kind = "box" }
sequences.flown.environment = { kind = "studio" }
sequences.flown.flight.path = { kind = "recorded", file = "flight.tum" }
trackers.hold = { kind = "hold" }
trackers.own = { kind = "external", command = ["sh", "own.sh"], input_files = ["weights.txt"] }
"""
RECORDED = """
title = "Of images"
rates_hz = [15.0]
trackers.hold = { kind = "hold" }
[recordings.mine]
rate_hz = 15.0
[recordings.mine.source]
kind = "files"
images_path = "images"
model_file = "house.obj"
camera_file = "camera.toml"
init_file = "init.toml"
"""
WIDE = Margins(error=0.2, resolution=1.0)
COMMITTED = suite_file("gate-small").parents[1] / "baselines" / "gate-small.json"


@pytest.fixture
def baseline(tmp_path):
    """A file made from a folder of scores, through the command."""
    write(tmp_path / "base", drawn(np.random.default_rng(0)))
    file = tmp_path / "baseline.json"
    result = CliRunner().invoke(main, ["gate", str(tmp_path / "base"), "--baseline", str(file), "--update"])
    assert result.exit_code == 0, result.output
    return file


@pytest.mark.parametrize(("factor", "verdict"), [(1.0, "pass"), (0.5, "pass"), (1.5, "fail")])
def test_it_is_compared_with_other_frames_of_the_same_flights(tmp_path, baseline, factor, verdict):
    scores = drawn(np.random.default_rng(1), factor=factor, spread=0.1, frames="rendered elsewhere")
    assert overall(gate(write(tmp_path / "head", scores), baseline, WIDE)) == verdict


def test_it_holds_what_the_folder_holds(tmp_path, baseline):
    of_file, of_folder = read_baseline(baseline, "these"), read_side(tmp_path / "base")
    assert of_file.runs.keys() == of_folder.runs.keys()
    for key, run in of_file.runs.items():
        assert run.errors == pytest.approx(of_folder.runs[key].errors, rel=1e-5)
        assert (run.coverage, run.how) == (of_folder.runs[key].coverage, of_folder.runs[key].how)


def test_made_again_it_is_the_same_to_the_byte(tmp_path, baseline):
    write_baseline(read_side(tmp_path / "base"), tmp_path / "again.json")
    assert (tmp_path / "again.json").read_bytes() == baseline.read_bytes()


def test_it_is_made_anew_over_its_own_file_and_over_no_other(tmp_path, baseline):
    write(tmp_path / "base", drawn(np.random.default_rng(3)))
    before = baseline.read_bytes()
    write_baseline(read_side(tmp_path / "base"), baseline)
    assert baseline.read_bytes() != before
    edited = json.dumps({**json.loads(before), "how": {"mine": 1}}).encode()
    for foreign in (edited, b"{}", b"[]", b"", b"my notes", b'{"sha256": null}', b"\xff"):
        baseline.write_bytes(foreign)
        with pytest.raises(UserError, match=re.escape(str(baseline))):
            write_baseline(read_side(tmp_path / "base"), baseline)
        assert baseline.read_bytes() == foreign


@pytest.mark.parametrize(("name", "sequence"), [("house", "house"), ("7", "7"), ("a-sx", "a")])
def test_a_sequence_without_a_seed_in_its_name_has_the_seed_0(tmp_path, name, sequence):
    about = {"sequences": [name], "trackers": ["lsd"], "rates_hz": [15.0], "flights": "these"}
    (tmp_path / "suite.json").write_text(json.dumps(about))
    make_score(name, 7, 0.01).save(tmp_path / "results" / name / "lsd@15hz" / "score.json")
    assert list(read_side(tmp_path).runs) == [("lsd@15hz", sequence, 0)]


def test_an_edited_file_is_refused(tmp_path, baseline):
    about = json.loads(baseline.read_text())
    about["runs"][0][4]["ATE"] *= 2
    baseline.write_text(json.dumps(about))
    with pytest.raises(UserError, match=r"is incomplete; move it away, and create it again with .*--update`"):
        gate(tmp_path / "base", baseline)
    baseline.write_text("{}")
    with pytest.raises(UserError, match="was edited or is incomplete"):
        gate(tmp_path / "base", baseline)


def test_other_flights_are_refused(tmp_path, baseline):
    head = write(tmp_path / "head", drawn(np.random.default_rng(1)), flights="others")
    with pytest.raises(UserError, match="flights have changed"):
        gate(head, baseline)


@pytest.fixture
def suites(tmp_path):
    """Folder of a suite that is rendered and one of recordings, with every file that their sequences name."""
    for name in ("model.obj", "camera.toml"):
        shutil.copy(TRIAL / name, tmp_path)
    (tmp_path / "model.obj").rename(tmp_path / "house.obj")
    (tmp_path / "house.obj").write_text("mtllib house.mtl\n" + (tmp_path / "house.obj").read_text())
    (tmp_path / "house.mtl").write_text("newmtl brick\nmap_Kd brick.png\n")
    shutil.copytree(TRIAL / "frames", tmp_path / "images")
    shutil.copy(TRIAL / "frames" / "000000.png", tmp_path / "brick.png")
    (tmp_path / "init.toml").write_text("cam_from_model = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 2], [0, 0, 0, 1]]\n")
    (tmp_path / "vehicle.toml").write_text('like = "crazyflie"\n')
    for name in ("way.csv", "flight.tum", "own.sh", "weights.txt"):
        (tmp_path / name).write_text("as at first\n")
    (tmp_path / "rendered.toml").write_text(RENDERED)
    (tmp_path / "recorded.toml").write_text(RECORDED)
    return tmp_path


OF_BOTH = {"house.obj", "house.mtl", "brick.png"}
FILES = {
    "rendered": OF_BOTH | {"way.csv", "flight.tum", "vehicle.toml"},
    "recorded": OF_BOTH | {"camera.toml", "init.toml", "images/000001.png"},
}


@pytest.mark.parametrize(("suite", "file"), [(suite, file) for suite in FILES for file in sorted(FILES[suite])])
def test_another_content_of_a_file_of_the_flights_makes_other_flights(suites, suite, file):
    before = load_suite(suites / f"{suite}.toml").flights
    with (suites / file).open("ab") as end:
        end.write(b"\n")
    assert load_suite(suites / f"{suite}.toml").flights != before


@pytest.mark.parametrize("suite", FILES)
def test_files_of_trackers_and_where_a_suite_lies_are_not_of_its_flights(suites, tmp_path_factory, suite):
    before = load_suite(suites / f"{suite}.toml").flights
    for name in ("own.sh", "weights.txt"):
        (suites / name).write_text("changed\n")
    moved = shutil.copytree(suites, tmp_path_factory.mktemp("elsewhere") / "suites")
    assert load_suite(moved / f"{suite}.toml").flights == before


@pytest.mark.parametrize(
    ("written", "same"),
    [("camera.horizontal_fov_deg = 65.0", True), ("camera.horizontal_fov_deg = 66", False),
     ("camera = { horizontal_fov_deg = 6.5e1 }", True)],
)  # fmt: skip
def test_a_number_written_in_another_way_makes_no_other_flights(suites, written, same):
    flights = []
    for text in ("camera.horizontal_fov_deg = 65", written):
        (suites / "rendered.toml").write_text(RENDERED + f"sequences.mine.{text}\n")
        flights.append(load_suite(suites / "rendered.toml").flights)
    assert (flights[0] == flights[1]) is same


def test_no_baseline_is_made_of_a_run_that_is_missing_or_crashed(tmp_path):
    scores = drawn(np.random.default_rng(0))
    folder = write(tmp_path / "base", [make_score("s0", 0, 0.01, status="crashed", errors=("boom",)), *scores[1:]])
    with pytest.raises(UserError, match="s0, seed 0: boom"):
        write_baseline(read_side(folder), tmp_path / "baseline.json")
    (folder / "results" / "s0-s0" / "lsd@15hz" / "score.json").unlink()
    with pytest.raises(UserError, match="s0, seed 0"):
        write_baseline(read_side(folder), tmp_path / "baseline.json")


def test_a_baseline_of_flights_tells_which_crashed_and_has_six_digits(tmp_path):
    flown = {"how": {FLOWN: True}, "errors": {"path error": 0.0123456789, "estimate error": math.nan}}
    runs = {
        ("a@1hz", "house", 3): Measured(coverage=0.0, crash="into the face", **flown),
        ("a@1hz", "cube", 4): Measured(coverage=1.0, **flown),
    }
    write_baseline(Side(runs, {}, "these"), tmp_path / "baseline.json")
    found = read_baseline(tmp_path / "baseline.json", "these")
    assert [(key, run.coverage, run.crash) for key, run in found.runs.items()] == [
        (("a@1hz", "cube", 4), 1.0, ""),
        (("a@1hz", "house", 3), 0.0, "into the face"),
    ]
    assert all(run.errors == {"path error": 0.0123457} for run in found.runs.values())
    assert (found.is_flown, found.flights, found.faults) == (True, "these", {})
    with pytest.raises(UserError, match="flights have changed"):
        read_baseline(tmp_path / "baseline.json", "")


@pytest.mark.parametrize(
    "body", [{"runs": [[1]], "how": {}}, {"runs": 5, "how": {}}, {"runs": [["a", "b", "x", 1, {}]]}]
)
def test_a_body_of_another_form_is_no_baseline(tmp_path, body):
    whole = {"flights": "these", **body}
    digest = hashlib.sha256(json.dumps(whole, sort_keys=True).encode()).hexdigest()
    (tmp_path / "baseline.json").write_text(json.dumps({"sha256": digest, **whole}))
    with pytest.raises(UserError, match=r"this is not a baseline \(.*create it again"):
        read_baseline(tmp_path / "baseline.json", "these")


def test_the_committed_baseline_is_of_the_suite_as_it_stands():
    suite = load_suite(suite_file("gate-small"))
    side = read_baseline(COMMITTED, suite.flights)
    assert {key[0] for key in side.runs} == {f"{label}@15hz" for label in suite.trackers}
    assert {f"{sequence}-s{seed}" for _, sequence, seed in side.runs} == {spec.name for spec in suite.sequences}
