"""`--dry-run` tells frames, seconds and megabytes of each sequence or flight, and what its path does not reach."""

import json

import pytest
from click.testing import CliRunner

from uavbench.bench.cli.main import main
from uavbench.bench.config.suite import load_suite
from uavbench.bench.runner.extent import current_folders, extents, shortfalls
from uavbench.bench.runner.jobs import plan, plan_flights
from uavbench.trajectories.simulation.summary import FlightSummary

SUITE = """
title = "Paces"
seeds = [0, 1, 2]
rates_hz = [5.0]
[sequences.timed]
structure = { kind = "box" }
environment = { kind = "indoor" }
flight.path = { kind = "orbit", duration_s = 30.0 }
[sequences.hasty]
rate_hz = 10.0
structure = { kind = "box" }
environment = { kind = "indoor" }
flight.path = { kind = "orbit", speed_m_s = 1.5 }
annotations = ["depth"]
[sequences.never]
structure = { kind = "box" }
environment = { kind = "indoor" }
flight.path = { kind = "orbit", duration_s = 2.0 }
[sequences.pilot]
structure = { kind = "box" }
environment = { kind = "indoor" }
flight.path = { kind = "hand-pilot", duration_s = 4.0 }
[trackers]
hold = { kind = "hold" }
"""


@pytest.fixture
def suite(tmp_path):
    (tmp_path / "paces.toml").write_text(SUITE)
    return tmp_path / "paces.toml"


def test_the_dry_run_tells_how_much_each_sequence_is(suite, tmp_path):
    done = CliRunner().invoke(main, ["render", str(suite), "--out", str(tmp_path / "out"), "--dry-run"])
    assert done.exit_code == 2, done.output
    assert "3 of 12 sequences cannot be made: never; the reasons are above" in done.stderr
    rows = {line.split()[0]: line.split() for line in done.output.split("each sequence")[1].splitlines()[1:]}
    assert rows["timed"][1:4] == ["3", "451", "30.0"]
    assert rows["hasty"][1:3] == ["3", str(int(10 * float(rows["hasty"][3])) + 1)]
    assert rows["pilot"][1:5] == ["3", "61", "4.0", "-"]
    megabytes = {name: float(rows[name][5]) for name in ("timed", "hasty", "pilot")}
    assert megabytes["timed"] == pytest.approx(451 * 640 * 480 * 0.98e-6, rel=0.1)
    assert rows["all"][2:4] == ["12", str(3 * (451 + 61 + int(rows["hasty"][2])))]
    assert "hasty: path orbit: at most 0.56 of the requested 1.5 m/s" in done.output
    assert "never: path orbit: duration_s 2: 7.85 m from rest to rest take" in done.output
    assert not (tmp_path / "out").exists()


def test_the_time_of_a_sequence_counts_the_pixels_of_all_cameras(suite):
    """Time beyond that of one frame is proportional to images: two more of a quarter each, half as much again."""
    camera = "{ width = 320, height = 240, horizontal_fov_deg = 60.0 }"
    turned = {"left": 9.0, "right": -9.0}
    two = ", ".join(f"{{ name = '{name}', camera = {camera}, mount.yaw_deg = {yaw} }}" for name, yaw in turned.items())
    rig = suite.with_name("rig.toml")
    rig.write_text(
        "title = 'Rig'\nseeds = [0]\nrates_hz = [5.0]\n"
        + "".join(
            f"[sequences.{name}]\nstructure = {{ kind = 'box' }}\nenvironment = {{ kind = 'indoor' }}\n"
            f"flight.path = {{ kind = 'hand-pilot', duration_s = {seconds} }}\ncameras = [{cameras}]\n"
            for name, seconds, cameras in [("short", 4.0, ""), ("long", 8.0, ""), ("rig", 8.0, two)]
        )
        + "[trackers]\nhold = { kind = 'hold' }\n"
    )
    short, long, several = (
        job.weight for job in plan(load_suite(rig), rig.parent / "out", last="render") if job.verb == "render"
    )
    assert several - long == pytest.approx(0.5 * 2 * (long - short))


LOOP = """
[loop]
estimator = "truth"
time_limit_s = 10.0
[loops.soon]
latency = { kind = "constant", ms = 20.0 }
[loops.late]
latency = { kind = "constant", ms = 200.0 }
"""


def test_the_dry_run_of_flights_tells_how_much_each_flight_is(suite, tmp_path):
    suite.write_text(SUITE + LOOP)
    command = ["fly", str(suite), "--out", str(tmp_path / "out"), "--dry-run"]
    plain, filmed = (CliRunner().invoke(main, [*command, *more]) for more in ([], ["--video"]))
    assert plain.exit_code == filmed.exit_code == 2, plain.output
    assert "6 of 24 flights cannot be made: never hold@5hz+soon, never hold@5hz+late;" in plain.stderr
    told, told_filmed = (each.stdout.split("each flight")[1].splitlines()[1:] for each in (plain, filmed))
    rows, filmed_rows = (
        {" ".join(line.split()[:2]): line.split()[2:] for line in lines} for lines in (told, told_filmed)
    )
    assert rows["pilot hold@5hz+soon"][:4] == ["3", "21", "4.0", "-"]
    assert rows["timed hold@5hz+late"][:3] == ["3", "51", "10.0"]  # by its time limit
    hasty = 3 * (1 + int(5 * float(rows["hasty hold@5hz+soon"][2])))
    assert rows["all flights"][:2] == ["24", str(2 * (3 * (51 + 21) + hasty))]
    assert [line.split(":")[0] for line in told if ": " in line] == ["hasty", "never"]
    assert float(filmed_rows["all flights"][3]) > 5 * float(rows["all flights"][3])
    assert not (tmp_path / "out").exists()


def test_a_dry_run_of_a_suite_without_mistakes_succeeds(suite, tmp_path):
    suite.write_text(SUITE.replace("duration_s = 2.0", "duration_s = 30.5") + LOOP)
    for verb in ("render", "fly"):
        done = CliRunner().invoke(main, [verb, str(suite), "--out", str(tmp_path / "out"), "--dry-run"])
        assert (done.exit_code, "cannot be made" in done.output) == (0, False), done.output


def test_a_dry_run_of_flights_tells_those_that_cannot_be_flown(suite, tmp_path):
    suite.write_text(SUITE + LOOP + "[sequences.never.flight.airframe]\nkind = 'file'\npath = 'none.toml'\n")
    suite.write_text(suite.read_text().replace("duration_s = 2.0", "duration_s = 30.5"))
    done = CliRunner().invoke(main, ["fly", str(suite), "--out", str(tmp_path / "out"), "--dry-run"])
    assert done.exit_code == 2 and "none.toml: no such file" in done.stdout
    assert "6 of 24 flights cannot be made: never hold@5hz+soon" in done.stderr


def test_a_dry_run_of_flights_tells_sensors_that_cannot_serve_the_loop(suite, tmp_path):
    given = "[sequences.pilot]\nsensors = [{ kind = 'imu' }, { kind = 'gnss' }]\n"
    text = SUITE.partition("[sequences.timed]")[0] + given + SUITE.partition("[sequences.pilot]\n")[2]
    outages = """
[loop]
gnss_outages_s = [[0.0, 100.0]]
sensors = ["imu", "gnss"]
"""
    for lines, told in (
        (outages, "pilot: no sensor can hold the vehicle: imu, gnss alone, without GNSS during the whole flight"),
        (LOOP, "pilot: sensors: Lidar2d cannot be read in flight"),
    ):
        suite.write_text(text.replace("'gnss' }", "'lidar-2d' }" if lines is LOOP else "'gnss' }") + lines)
        done = CliRunner().invoke(main, ["fly", str(suite), "--out", str(tmp_path / "out"), "--dry-run"])
        assert done.exit_code == 2 and told in done.stdout, done.output


def test_a_dry_run_refuses_what_the_command_would(suite, tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "thesis.txt").write_text("mine")
    for verb, text in (("run", SUITE), ("fly", SUITE + LOOP)):
        suite.write_text(text)
        done = CliRunner().invoke(main, [verb, str(suite), "--out", str(tmp_path / "out"), "--dry-run"])
        assert (done.exit_code, "thesis.txt" in done.output) == (2, True)
    suite.write_text(SUITE)
    assert "no table [loop]" in CliRunner().invoke(main, ["fly", str(suite), "--dry-run"]).output


def test_what_is_rendered_is_weighed_and_what_is_outdated_estimated(suite, tmp_path):
    jobs = plan(load_suite(suite), tmp_path / "out", last="render")
    hashes = {job.marker.parent.name: job.content_hash for job in jobs}
    for name, carried in (("timed-s1", hashes["timed-s1"]), ("pilot-s0", hashes["pilot-s1"])):
        folder = tmp_path / "out" / "sequences" / name
        folder.mkdir(parents=True)
        (folder / "sequence.json").write_text(json.dumps({"content_hash": carried}).ljust(1000))
    works = [job.work for job in jobs]
    found = {each.name: each for each in extents(works, current_folders(jobs))}
    assert (found["timed"].bytes, found["timed"].measured) == (1000.0, True)
    assert not found["hasty"].measured
    assert not found["pilot"].measured and found["pilot"].bytes > 1e7
    assert found["never"].problem


def test_a_flight_without_its_video_is_no_measure_of_both(suite, tmp_path):
    suite.write_text(SUITE + LOOP)
    jobs = plan_flights(load_suite(suite), tmp_path / "out", "report", "page", video=True)
    (fly,) = (job for job in jobs if job.name == "fly pilot-s0 hold@5hz+soon")
    fly.marker.parent.mkdir(parents=True)
    fly.marker.write_text(json.dumps({"content_hash": fly.content_hash}))
    assert current_folders(jobs) == {fly.marker.parent}
    found = {each.name: each for each in extents((job.work for job in jobs), current_folders(jobs))}
    filmed, other = found["pilot hold@5hz+soon"], found["pilot hold@5hz+late"]
    assert not filmed.measured and filmed.bytes == other.bytes


def test_a_render_tells_what_was_not_reached(tmp_path):
    slow = FlightSummary(
        path="orbit", duration_s=14.7, duration_asked_s=None, speed_asked_m_s=1.5, speed_planned_m_s=0.88,
        nearly_still_s=3.0, length_m=8.0, speed_flown_m_s=0.87,
    )  # fmt: skip
    for name, flight in (("slow", slow.to_json()), ("fine", slow.to_json() | {"speed_planned_m_s": 1.5})):
        (tmp_path / name).write_text(json.dumps({"name": name, "flight": flight}))
    (tmp_path / "recording").write_text(json.dumps({"name": "recording"}))
    (line,) = shortfalls(tmp_path / name for name in ("slow", "fine", "recording"))
    assert line.startswith("slow: path orbit: at most 0.88 of the requested 1.5 m/s, 14.7 s, its first 3.0 s")
