"""A suite ended at some moment, main process or workers: after the same command again all is as undisturbed.

In CI, the scores are ended at one stage of a run for each of those that are ended; with UAVBENCH_NIGHTLY=1, whole runs
and flights with videos, by turns, are at fifty random moments. Nothing is left in the output folder, in the temporary
folder or running.
"""

import contextlib
import os
import signal
import subprocess
import sys
import time
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from tests.bench.process_trees import as_from_a_terminal, command_line, wait_until, with_mark
from tests.bench.small_suites import FLOWN, small_suite

pytestmark = [pytest.mark.ci, pytest.mark.slow]
SIGNALS = (signal.SIGKILL, signal.SIGTERM, signal.SIGHUP, signal.SIGINT)
WHOM = ("main", "a worker", "all")
CASES = list(product(SIGNALS, WHOM))
NIGHTLY = bool(os.environ.get("UAVBENCH_NIGHTLY"))
STAGES = ("sequences/.box-*/frames/*", "results/*/*/record.json", "results/*/*/score.json")
"""Files that there are when a stage has begun."""
MOMENTS = 50 if NIGHTLY else len(STAGES)
COMMANDS = ("run", "fly") if NIGHTLY else ("score",)
OPTIONS = {"fly": ["--video"]}
FINAL = (
    "sequences/**/*", "results/*/*/*.csv", "results/*/*/*.tum", "results/*/*/record.json", "restarts/*/*/*/*.csv",
    "flights/*/*/*.csv", "flights/*/*/*.tum", "flights/*/*/score.json", "*.json",
)  # fmt: skip
"""Files that must be the same."""
LEFT_ALONE = ("times.csv", "seconds.json", "latency.json", "report.json", "flights.json")
"""Files of wall times, and the lists of reports, with the digests of the figures and pages that show them."""
PROGRAM = """
import os, subprocess, sys, tomllib
m = tomllib.load(open("init.toml", "rb"))["cam_from_model"]
w = (1 + m[0][0] + m[1][1] + m[2][2]) ** 0.5 / 2
q = [w, (m[2][1] - m[1][2]) / 4 / w, (m[0][2] - m[2][0]) / 4 / w, (m[1][0] - m[0][1]) / 4 / w]
pose = ",".join(repr(v) for v in [m[0][3], m[1][3], m[2][3], *q])
subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"], start_new_session=True)
open(os.path.join(os.environ["TMPDIR"], "own.txt"), "w").write("left for others to remove")
print("ready", flush=True)
for line in sys.stdin.buffer:
    kind, *rest = line.decode().strip().split(",")
    if kind == "frame":
        stamp, width, height, channels = map(int, rest)
        sys.stdin.buffer.read(width * height * channels)
        print(f"{stamp},ok,{pose}", flush=True)
"""
"""An external tracker that holds the initial pose, and leaves a process in a session of its own and a file."""


def final(folder):
    """Contents of all that must be the same: everything but wall times, what shows them, locks and records; and the
    names of the videos.
    """
    contents = {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for pattern in FINAL
        for path in sorted(folder.glob(pattern))
        if path.is_file() and path.name not in LEFT_ALONE
    }
    return contents | {path.relative_to(folder).as_posix(): b"" for path in folder.glob("videos/*/*/*")}


def start(command, suite, out, temporary):
    line = [sys.executable, "-m", "uavbench.bench.cli.main", command, str(suite), "--out", str(out), "--jobs", "2"]
    temporary.mkdir(exist_ok=True)
    return subprocess.Popen(
        [*line, *OPTIONS.get(command, [])],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        start_new_session=True,
        preexec_fn=as_from_a_terminal,
        env={**os.environ, "TMPDIR": str(temporary)},
    )


def children(pid):
    with contextlib.suppress(OSError):
        return [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]
    return []


def end(process, how, whom, rng):
    """Send a signal; a process may have ended by itself."""
    with contextlib.suppress(ProcessLookupError):
        if whom == "all":
            os.killpg(process.pid, how)
        elif whom == "main":
            process.send_signal(how)
        elif some := children(process.pid):
            os.kill(int(rng.choice(some)), how)


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    """Suite, output folder and seconds of each command."""
    folder = tmp_path_factory.mktemp("kill")
    (folder / "program.py").write_text(PROGRAM)
    program = f'program = {{ kind = "external", command = [{sys.executable!r}, "program.py"], mode = "stream" }}\n'
    run = small_suite(folder, 'rapid = { kind = "rapid" }\n' + program)
    run.write_text('protocols = ["reset"]\n' + run.read_text())
    flown = folder / "flown.toml"
    flown.write_text(FLOWN)
    done = {}
    for command in COMMANDS:
        begin, suite = time.monotonic(), flown if command == "fly" else run
        process = start(command, suite, folder / command, folder / "temporary")
        text, _ = process.communicate()
        assert process.returncode == 0, text.decode()
        done[command] = suite, folder / command, time.monotonic() - begin
    return done


@pytest.mark.parametrize("moment", range(MOMENTS))
def test_killed_and_resumed_is_as_undisturbed(undisturbed, tmp_path, moment):
    command = COMMANDS[moment % len(COMMANDS)]
    suite, expected, took_s = undisturbed[command]
    out, temporary = tmp_path / "out", tmp_path / "t"
    rng = np.random.default_rng(moment)
    how, whom = CASES[(5 * moment) % len(CASES)]
    process = start(command, suite, out, temporary)
    if NIGHTLY:
        time.sleep(float(rng.uniform(0.05, 1.0)) * took_s)
    else:
        assert wait_until(lambda: any(out.glob(STAGES[moment])))
    end(process, how, whom, rng)
    text, _ = process.communicate()
    if how != signal.SIGKILL and whom != "a worker":
        assert b"Traceback" not in text, text.decode()
    assert wait_until(lambda: not with_mark(str(temporary))), [command_line(p) for p in with_mark(str(temporary))]
    again = start(command, suite, out, temporary)
    text, _ = again.communicate()
    assert again.returncode == 0, text.decode()
    assert wait_until(lambda: not with_mark(str(temporary))), [command_line(p) for p in with_mark(str(temporary))]
    got, want = final(out), final(expected)
    assert got.keys() == want.keys()
    assert [name for name in want if got[name] != want[name]] == []
    assert not [p for p in out.rglob(".*") if not p.name.startswith(".lock")]
    assert not list(temporary.iterdir())
