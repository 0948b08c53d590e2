"""`uavbench fly` as a user runs it: what it writes, what it does not do twice, and what it refuses."""

import csv
import json
import os
import re
import shutil
from dataclasses import replace

import cv2
import numpy as np
import pytest
from click.testing import CliRunner

from tests.bench.conftest import in_one_process
from tests.bench.small_suites import FLOWN, LOOP
from tests.reports.test_flight_score import flown as scored
from tests.reports.test_flight_score import path as along
from uavbench.bench.cli.main import main
from uavbench.bench.closed_loop.latency import Constant, Lognormal
from uavbench.bench.config.suite import load_suite
from uavbench.bench.config.suite_files import suite_file
from uavbench.bench.filming.video import ending_of, write_video
from uavbench.bench.runner.extent import current_folders, extents
from uavbench.bench.runner.jobs import plan_flights
from uavbench.bench.third_party.registry import absent
from uavbench.reports.closed_loop.measures import FlightScore
from uavbench.trajectories.errors import UserError


def suite(folder, text=FLOWN):
    path = folder / "few.toml"
    path.write_text(text)
    return path


def uavbench(*arguments):
    return CliRunner().invoke(main, list(map(str, arguments)))


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    folder = tmp_path_factory.mktemp("flights")
    run = uavbench("fly", suite(folder), "--out", folder / "out", "--jobs", 1, "--video")
    assert run.exit_code == 0, run.output
    return folder, run


def test_flights_end_in_a_table_scores_and_figures(done):
    folder, run = done
    out = folder / "out"
    assert "| box | truth@15hz | 1 | 1 |" in run.output
    about = json.loads((out / "flights.json").read_text())
    assert [score["label"] for score in about["scores"]] == ["hold", "truth"]
    with (out / "tables" / "flights.csv").open() as handle:
        rows = list(csv.DictReader(handle))
    assert [row["status"] for row in rows] == ["completed", "completed"]
    score = FlightScore.load(out / "flights" / "box-s0" / "truth@15hz" / "score.json")
    assert score.success and score.tracker_rms_m < 1e-12
    assert 0 < score.coverage <= 1
    assert (out / "figures" / "flights" / "box-s0_truth@15hz.png").stat().st_size > 10_000
    page = (out / "index.html").read_text()
    named = re.findall(r'(?:src|href)="([^"#]+)"', page)
    assert len({name for name in named if name.endswith(".png")}) == 3
    assert all((out / name).is_file() for name in named)
    assert "Every flight was completed" in page
    assert "| hold@15hz | truth@15hz | 1 | 0 | 0 |" in (out / "tables" / "pairs.md").read_text()


def test_a_second_run_redoes_nothing_and_a_changed_loop_flies_again(done):
    folder, _ = done
    again = uavbench("fly", folder / "few.toml", "--out", folder / "out", "--jobs", 1, "--video")
    assert again.exit_code == 0
    assert "0 jobs done, 7 were fresh" in again.stderr
    changed = plan_flights(load_suite(suite(folder, FLOWN.replace("20.0", "30.0"))), folder / "out")
    suite(folder)
    assert not any(job.fresh for job in changed)


@pytest.mark.parametrize(("change", "told"), [
    ((LOOP, ""), "has no table [loop]"),
    (("ms = 20.0", "s = 0.02"), "loop.latency.s: unknown key"),
    (("corridor_m", "coridor_m"), "did you mean 'corridor_m'"),
    (("corridor_m = 0.4", "corridor_m = -1.0"), "loop.corridor_m"),
    (("corridor_m = 0.4", 'sensors = ["imu"]'), "no sensor can hold the vehicle"),
    (("corridor_m = 0.4", "gnss_outages_s = [[3.0, 1.0]]"), "not an interval"),
    (("corridor_m = 0.4", "gnss_outages_s = [[0.1, 0.2]]"), "no sequence has GNSS"),
    (('"hand-pilot", duration_s = 0.3', '"recorded", file = "few.toml"'), "recorded motion"),
])  # fmt: skip
def test_mistakes_are_told_before_the_start(tmp_path, change, told):
    assert change[0] in FLOWN
    run = uavbench("fly", suite(tmp_path, FLOWN.replace(*change)), "--out", tmp_path / "out")
    assert run.exit_code == 2
    assert told in run.output
    assert not (tmp_path / "out" / "flights").exists()


def test_an_empty_loop_has_the_defaults(tmp_path):
    loop = load_suite(suite(tmp_path, FLOWN.replace(LOOP, "[loop]\n"))).loops[""]
    assert loop.latency == Constant(50.0) and loop.estimator == "filter"


@pytest.mark.parametrize("name", ["fly-box", "fly-bridge", "fly-facade", "fly-latency", "fly-baselines"])
def test_the_suites_of_flights_fly_every_tracker_on_every_seed(name, tmp_path):
    loaded = load_suite(suite_file(name))
    jobs = plan_flights(loaded, tmp_path)
    pilots = (len(loaded.trackers) - len(absent(loaded.trackers))) * len(loaded.loops)
    assert len([job for job in jobs if job.verb == "fly"]) == len(loaded.sequences) * pilots


def test_a_video_shows_every_frame_from_the_camera_and_from_outside(done):
    folder, _ = done
    for run in ("hold@15hz", "truth@15hz"):
        frames = list(csv.DictReader((folder / "out" / "flights" / "box-s0" / run / "frames.csv").open()))
        video = cv2.VideoCapture(str(folder / "out" / "videos" / "box-s0" / run / "flight.webm"))
        shown = []
        while (read := video.read())[0]:
            shown.append(read[1])
        assert len(shown) == len(frames)
        assert {picture.shape for picture in shown} == {(480, 640 + 640, 3)}
        camera, outside = shown[-1][:, :640], shown[-1][:, 640:]
        green = (camera[..., 1] > 150) & (camera[..., 2] < 120)
        assert green.sum() > 100  # the model at the estimate
        moved = np.abs(outside.astype(int) - shown[0][:, 640:]).max(axis=2) > 60
        assert 0 < moved[40:].sum() < 0.2 * moved.size  # the vehicle, and nothing else


@pytest.mark.parametrize(("off_m", "flight", "told"), [
    (0.08, {}, "completed"),
    (0.1, {}, "completed, but up to 0.10 m off its path"),
    (0.1, {"status": "crashed", "why": "it tilted"}, "crashed: it tilted"),
])  # fmt: skip
def test_a_video_ends_with_how_the_flight_did(off_m, flight, told):
    """`completed` alone would stand for a success; the corridor is 9 cm wide."""
    assert ending_of(scored(flown_path=along(planned_p_m=[0.0, off_m, 0.0]), **flight)) == told


def test_a_video_is_written_without_a_word_of_native_libraries(done, tmp_path, capfd):
    folder, _ = done
    spec = load_suite(folder / "few.toml").sequences[0]
    flight = folder / "out" / "flights" / "box-s0" / "truth@15hz"
    write_video(spec, flight, tmp_path / "video", "x", lambda *_: os.write(2, b"."))
    frames = (flight / "frames.csv").read_text().count("\n") - 1
    assert capfd.readouterr() == ("", "." * frames), "and what others write is shown again"


def test_a_dry_run_tells_the_frames_that_are_flown_and_about_their_megabytes(done, tmp_path):
    folder, _ = done
    plans = (plan_flights(load_suite(folder / "few.toml"), out) for out in (folder / "out", tmp_path))
    told = (extents((job.work for job in jobs), current_folders(jobs)) for jobs in plans)
    flown, planned = ({each.name: each for each in flights}["box truth@15hz"] for flights in told)
    frames = list(csv.DictReader((folder / "out" / "flights" / "box-s0" / "truth@15hz" / "frames.csv").open()))
    assert flown.frames == planned.frames == len(frames)
    assert (flown.measured, planned.measured) == (True, False)
    assert 0.5 < planned.bytes / flown.bytes < 2.0


def test_a_shard_makes_its_videos_too(tmp_path, monkeypatch):
    planned = []
    monkeypatch.setattr("uavbench.bench.runner.commands.dry_run", lambda jobs, *_: planned.append(jobs) or "")
    command = ("fly", suite(tmp_path), "--out", tmp_path / "out", "--shard", "1/1", "--dry-run")
    for more in ((), ("--video",)):
        assert uavbench(*command, *more).exit_code == 0
    assert [{job.verb for job in jobs} for jobs in planned] == [{"fly", "score"}, {"fly", "score", "video"}]


def test_the_gate_compares_flights(done, tmp_path):
    """The same again has too few seeds for a pass; a flight that crashes where it did not fails."""
    folder, _ = done
    same = uavbench("gate", folder / "out", "--baseline", folder / "out", "--out", tmp_path / "same")
    assert same.exit_code == 3, same.output
    found = json.loads((tmp_path / "same" / "gate.json").read_text())["findings"]
    assert {f["metric"] for f in found} == {
        "success", "path error", "path error, typical", "estimate error", "estimate error, typical"
    }  # fmt: skip
    assert {f["tracker"] if "tracker" in f else f["run"] for f in found} == {"hold@15hz", "truth@15hz"}
    file = tmp_path / "baseline.json"
    assert uavbench("gate", folder / "out", "--baseline", file, "--update").exit_code == 0
    assert uavbench("gate", folder / "out", "--baseline", file, "--out", tmp_path / "file").exit_code == 3
    worse = tmp_path / "worse"
    shutil.copytree(folder / "out", worse)
    path = worse / "flights" / "box-s0" / "truth@15hz" / "score.json"
    crashed = replace(FlightScore.load(path), status="crashed", why="it came too close", success=False)
    path.unlink()
    crashed.save(path)
    for baseline in (folder / "out", file):
        told = uavbench("gate", worse, "--baseline", baseline, "--out", tmp_path / "worse-gate")
        assert told.exit_code == 1, told.output
        assert "it came too close" in told.output


def test_the_gate_refuses_flights_of_another_suite(done, tmp_path):
    folder, _ = done
    other = tmp_path / "other"
    shutil.copytree(folder / "out", other)
    about = json.loads((other / "suite.json").read_text())
    del about["made_by"]
    (other / "suite.json").unlink()
    (other / "suite.json").write_text(json.dumps({**about, "flights": "of another loop"}))
    told = uavbench("gate", other, "--baseline", folder / "out", "--out", tmp_path / "gate")
    assert told.exit_code == 2 and "different flights" in told.output


VARIANTS = LOOP + '[loops.filter]\n[loops.camera]\nestimator = "camera"\ncorridor_m = 0.2\n'


INTO = """
[sequences.into]
structure = { kind = "box" }
environment = { kind = "studio" }
flight.path = { kind = "orbit", distance_m = 0.01, height_m = 0.2 }
sensors = [{ kind = "imu" }]
camera = { width = 160, height = 120, horizontal_fov_deg = 65.0 }
"""


def test_each_loop_is_flown_with_what_all_share_and_what_cannot_be_flown_is_told_beside(tmp_path):
    text = FLOWN.replace(LOOP, VARIANTS).replace('hold = { kind = "hold" }\n', "") + INTO
    run = in_one_process("fly", suite(tmp_path, text), "--out", tmp_path / "out")
    assert run.exit_code == 2, run.output
    assert "FAILED fly into-s0 truth@15hz+filter" in run.output
    assert "FAILED fly into-s0 truth@15hz+camera" in run.output
    about = json.loads((tmp_path / "out" / "flights.json").read_text())
    assert len(about["scores"]) == 2 and len(about["failed"]) == 2
    scores = {
        name: FlightScore.load(tmp_path / "out" / "flights" / "box-s0" / f"truth@15hz+{name}" / "score.json")
        for name in ("filter", "camera")
    }
    loops = load_suite(tmp_path / "few.toml").loops
    assert (loops["filter"].corridor_m, loops["camera"].corridor_m) == (0.4, 0.2)
    assert loops["camera"].latency == loops["filter"].latency == Constant(20.0)
    assert scores["filter"].estimate_nees is not None and scores["camera"].estimate_nees is None
    assert scores["camera"].estimate_rms_m > 0
    assert "truth@15hz+camera" in run.output


def test_a_loop_keeps_what_all_share_of_a_table_that_it_names_too(tmp_path):
    shared = "[loop]\nfilter = { gate = 0.9, imu_scale = 3.0 }\ncrash = { stray_m = 7.0 }\n" + (
        'latency = { kind = "constant", ms = 20.0 }\n'
        "[loops.a]\nfilter = { imu_scale = 2.0 }\ncrash.tilt_deg = 60.0\nlatency = { ms = 5.0 }\n"
        '[loops.b]\nlatency = { kind = "lognormal" }\n'
    )
    loops = load_suite(suite(tmp_path, FLOWN.replace(LOOP, shared))).loops
    assert (loops["a"].filter.gate, loops["a"].filter.imu_scale) == (0.9, 2.0)
    assert (loops["a"].crash.stray_m, loops["a"].crash.tilt_deg) == (7.0, 60.0)
    assert loops["a"].latency == Constant(5.0)
    assert loops["b"].latency == Lognormal() and loops["b"].filter.imu_scale == 3.0


def test_a_mistake_in_one_loop_is_told_with_its_name(tmp_path):
    text = FLOWN.replace(LOOP, VARIANTS.replace("corridor_m = 0.2", "coridor_m = 0.2"))
    run = uavbench("fly", suite(tmp_path, text), "--out", tmp_path / "out")
    assert "loops.camera.coridor_m: unknown key" in run.output


def test_without_a_loop_nothing_is_planned(tmp_path):
    with pytest.raises(UserError, match="fly-box"):
        plan_flights(load_suite(suite_file("tiny")), tmp_path)
