"""The main job as a user runs it, on a suite of a few frames: first the command line in a process of its own."""

import json
import os
import signal
import subprocess
import sys

import pytest
from click.testing import CliRunner

from tests.bench.conftest import in_one_process, sketch
from tests.bench.process_trees import DEADLINE_S, wait_until
from tests.bench.small_suites import SMALL
from uavbench.bench.cli.main import main

SUITE = """
title = "A few frames"
rates_hz = [15.0, 5.0]
seeds = [0, 1]

[sequences.box]
structure = { kind = "box" }
environment = { kind = "studio" }
flight.path = { kind = "hand-pilot", duration_s = 0.6 }
camera = { width = 320, height = 240, horizontal_fov_deg = 65.0 }
effects = [{ kind = "noise" }]

[trackers]
hold = { kind = "hold" }
lsd = { kind = "lsd" }
"""


SIGNALS = [signal.SIGINT, signal.SIGKILL, *([signal.SIGTERM] if os.environ.get("UAVBENCH_NIGHTLY") else [])]
"""tests/bench/test_kill.py sends SIGTERM in CI."""


def command(*arguments):
    return [sys.executable, "-m", "uavbench.bench.cli.main", *map(str, arguments)]


def uavbench(*arguments):
    return subprocess.run(command(*arguments), capture_output=True, text=True, check=False)


def contents(folder, *patterns):
    return {str(p.relative_to(folder)): p.read_bytes() for pattern in patterns for p in sorted(folder.glob(pattern))}


def ground_truth_and_estimates(folder):
    return contents(folder, "sequences/*/*.*", "sequences/*/frames/*", "results/*/*/frames.csv", "results/*/*/*.tum")


def scores_but_times(folder):
    """Each score, without what tells how long trackers took on this machine."""
    kept = {}
    for path in sorted(folder.glob("results/*/*/score.json")):
        about = json.loads(path.read_text())
        kept[str(path.relative_to(folder))] = {
            key: value for key, value in about.items() if key not in ("latency", "deadline_misses", "replay", "made_by")
        }
    assert kept
    return kept


def finished(folder):
    """What each finished sequence holds, by its name."""
    return {p.name: contents(p, "*.*", "frames/*") for p in folder.glob("sequences/*") if not p.name.startswith(".")}


def half_written(folder):
    return [p for p in folder.rglob(".*") if p.name != ".lock"]


@pytest.fixture(scope="module")
def suite(tmp_path_factory):
    path = tmp_path_factory.mktemp("suite") / "few.toml"
    path.write_text(SUITE)
    return path


@pytest.fixture(scope="module")
def done(suite, tmp_path_factory):
    out = tmp_path_factory.mktemp("done") / "out"
    run = uavbench("run", suite, "--out", out, "--jobs", 2)
    assert run.returncode == 0, run.stderr
    return out, run


def test_a_run_ends_with_the_score_table_and_the_path_of_the_report(done):
    out, run = done
    assert "lsd" in run.stdout
    assert run.stdout.strip().endswith(str(out / "index.html"))
    assert (out / "index.html").is_file()
    assert len(json.loads((out / "scores.json").read_text())["scores"]) == 8
    assert not half_written(out)


def test_a_second_run_redoes_nothing(suite, done):
    out, _ = done
    before = {p: p.stat().st_mtime_ns for p in out.rglob("*") if p.is_file() and p.name not in {"suite.json", ".lock"}}
    run = in_one_process("run", suite, "--out", out)
    assert run.exit_code == 0
    assert "0 jobs done" in run.stderr
    assert all(p.stat().st_mtime_ns == t for p, t in before.items())


def test_the_same_suite_gives_the_same_truth_and_scores_elsewhere(suite, done, tmp_path):
    out, _ = done
    run = in_one_process("score", suite, "--out", tmp_path / "again")
    assert run.exit_code == 0, run.stderr
    assert ground_truth_and_estimates(out) == ground_truth_and_estimates(tmp_path / "again")
    assert scores_but_times(out) == scores_but_times(tmp_path / "again")


@pytest.mark.ci
@pytest.mark.parametrize("how", SIGNALS)
def test_an_interrupted_run_is_resumed_to_the_same_end(suite, done, tmp_path, how):
    out = tmp_path / "out"
    process = subprocess.Popen(
        command("score", suite, "--out", out),
        stderr=subprocess.PIPE,
        start_new_session=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),  # a background job ignores it
    )
    assert wait_until(lambda: list(out.glob("sequences/.box-*/frames/*.png")) or finished(out))
    if how is signal.SIGKILL:
        os.killpg(process.pid, how)
    else:
        process.send_signal(how)
    error = process.communicate(timeout=DEADLINE_S)[1].decode()
    assert process.returncode == (-signal.SIGKILL if how is signal.SIGKILL else 130), error
    assert finished(out).items() <= finished(done[0]).items()  # under its final name nothing is ever in part
    if how is not signal.SIGKILL:
        assert "Traceback" not in error
        assert not half_written(out)
    resumed = uavbench("score", suite, "--out", out)
    assert resumed.returncode == 0, resumed.stderr
    assert not half_written(out)
    assert ground_truth_and_estimates(out) == ground_truth_and_estimates(done[0])


def test_mistakes_end_with_code_2_and_no_traceback(suite, done, tmp_path):
    other = tmp_path / "other"
    other.mkdir()
    (other / "thesis.tex").touch()
    bad = tmp_path / "bad.toml"
    bad.write_text(SUITE.replace("duration_s", "durations"))
    blocked = tmp_path / "file"
    blocked.touch()
    for arguments, told in [
        (["run", tmp_path / "none.toml"], "no such file"),
        (["run", bad], "durations"),
        (["run", suite, "--out", other], "holds something other"),
        (["run", suite, "--out", blocked], "not a folder"),
    ]:
        run = CliRunner().invoke(main, [*map(str, arguments)])
        assert run.exit_code == 2, run.output
        assert told in run.stderr
    assert [p.name for p in other.iterdir()] == ["thesis.tex"]
    run = uavbench("run", "papr")  # and so in a process of its own
    assert (run.returncode, "Traceback" in run.stderr) == (2, False), run.stderr
    assert "did you mean 'paper'" in run.stderr


def test_what_was_damaged_is_made_again_to_the_same_end(suite, done, tmp_path):
    out = tmp_path / "out"
    subprocess.run(["cp", "-r", done[0], out], check=True)
    whole = ground_truth_and_estimates(out)
    image = out / "sequences" / "box-s1" / "frames" / "000003.png"
    image.write_bytes(image.read_bytes()[:-100])
    table = out / "results" / "box-s0" / "lsd@15hz" / "frames.csv"
    table.write_bytes(b"?" * table.stat().st_size)
    run = in_one_process("score", suite, "--out", out)
    assert run.exit_code == 0, run.stderr
    assert "11 jobs done, 7 were fresh" in run.stderr  # a sequence with four runs and scores, and a run with its score
    assert ground_truth_and_estimates(out) == whole


def test_a_users_file_in_a_folder_of_results_is_named_and_nothing_is_done(suite, done, tmp_path):
    out = tmp_path / "out"
    subprocess.run(["cp", "-r", done[0], out], check=True)
    (out / "results" / "box-s0" / "lsd@15hz" / "notes.txt").write_text("mine")
    run = in_one_process("run", suite, "--out", out)
    assert run.exit_code == 2
    assert "notes.txt" in run.stderr
    assert "Traceback" not in run.stderr
    assert (out / "results" / "box-s0" / "lsd@15hz" / "notes.txt").read_text() == "mine"


def test_what_failed_is_in_the_report_and_what_did_not_is_scored(tmp_path):
    path, out = tmp_path / "mixed.toml", tmp_path / "out"
    away = SUITE[SUITE.index("[sequences.box]") : SUITE.index("[trackers]")]
    away = away.replace("[sequences.box]", "[sequences.away]\nmount = { yaw_deg = 180.0 }")
    text = SUITE.replace("[trackers]", away + "[trackers]").replace("[0, 1]", "[0]").replace(", 5.0", "")
    text = 'protocols = ["reset", "anchors"]\nstart = { kind = "picked-points", click_sigma_px = 0.5 }\n' + text
    text += 'quits = { kind = "external", command = ["false"] }\n'
    text += 'gone = { kind = "external", command = ["no-such-program-anywhere"] }\n'
    path.write_text(text)
    run = in_one_process("run", path, "--out", out)
    assert run.exit_code == 2
    assert f"report: {out / 'index.html'}" in run.stdout
    causes = [line.split(":")[0] for line in run.stderr.splitlines() if line.startswith("FAILED")]
    assert causes[0] == f"FAILED render away-s0 of {path}"  # its model is out of the first view
    assert "Traceback" not in run.stderr
    assert [p.name for p in (out / "sequences").iterdir()] == ["box-s0"]
    assert not any("away" in cause for cause in causes[1:])
    assert "jobs that need what failed" in run.stderr
    told = json.loads((out / "scores.json").read_text())
    assert set(told["unrendered"]) == {"away-s0"}
    for name in ("summary.md", "summary.tex", "summary_one_column.tex", "details.md", "protocols.tex"):
        assert "FAILED: no run on away-s0" in (out / "tables" / name).read_text(), name
    assert "FAILED: no run on away-s0" in in_one_process("tables", out, "--columns", "coverage").stdout
    statuses = {(s["label"], s["status"]) for s in told["scores"]}
    assert statuses == {("hold", "complete"), ("lsd", "complete"), ("quits", "crashed"), ("gone", "missing")}
    page = (out / "index.html").read_text()
    for shown in ("away-s0", "not rendered", "no-such-program-anywhere"):
        assert shown in page
    protocols = (out / "tables" / "protocols.csv").read_text().splitlines()
    rows = {line.split(",")[0]: line.split(",")[1:] for line in protocols[1:]}
    assert rows["gone@15hz"] == [""] * 12
    assert all(float(value) >= 0 for value in rows["hold@15hz"][::3])
    restarts = out / "restarts" / "box-s0" / "hold@15hz"
    records = {p: json.loads((restarts / p / "record.json").read_text()) for p in ("reset", "anchors")}
    assert records["anchors"]["given_rows"] == [0]
    failed = records["reset"]["failed_rows"]
    assert records["reset"]["given_rows"] == [0, *(k + 1 for k in failed if k < 9)]
    assert (out / "figures" / "anchors.pdf").exists()
    started = json.loads((out / "results" / "box-s0" / "hold@15hz" / "record.json").read_text())["start"]
    assert started["parameters"]["click_sigma_px"] == 0.5


def test_two_runs_do_not_share_a_folder(suite, tmp_path):
    out = tmp_path / "out"
    first = subprocess.Popen(command("render", suite, "--out", out, "--jobs", 1), stderr=subprocess.DEVNULL)
    try:
        assert wait_until((out / "suite.json").exists)
        first.send_signal(signal.SIGSTOP)  # it stays at work until the second has looked
        second = uavbench("render", suite, "--out", out)
    finally:
        first.kill()
        first.wait()
    assert second.returncode == 2
    assert "another uavbench process uses it" in second.stderr


SELF_WRITTEN = """
import pathlib
script = pathlib.Path(__file__)
script.write_bytes(script.read_bytes())
raise SystemExit("it ends")
"""


def test_a_suite_whose_every_run_fails_has_a_report_and_what_was_written_meanwhile_is_done_again(tmp_path):
    """The program writes itself, to the same content; and no figure has anything to draw."""
    program = tmp_path / "program.py"
    program.write_text(SELF_WRITTEN)
    path = tmp_path / "suite.toml"
    path.write_text(
        SMALL.replace(
            'hold = { kind = "hold" }', f'it = {{ kind = "external", command = ["{sys.executable}", "program.py"] }}'
        )
    )
    done = in_one_process("run", path, "--out", tmp_path / "out", "--figures", "all")
    assert done.exit_code == 1
    assert (tmp_path / "out" / "index.html").is_file()
    assert "it ends" in done.stderr
    assert not (tmp_path / "out" / "failures.txt").exists()
    assert "changed while jobs that use it ran: program.py" in done.stderr
    program.write_text('raise SystemExit("it ends")')
    with pytest.MonkeyPatch.context() as patched:
        sketch(patched)
        again = in_one_process("run", path, "--out", tmp_path / "out")
    assert "2 were fresh" in again.stderr, "the sequences"
    last = in_one_process("run", path, "--out", tmp_path / "out")
    assert last.stderr.startswith("0 jobs done")
