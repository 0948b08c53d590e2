"""A suite ended at some moment, main process or workers: after the same command again all is as undisturbed.

In CI, the scores are ended at one stage of a run for each of those that are ended; with UAVBENCH_NIGHTLY=1, a whole run
is at fifty random moments.
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

from tests.bench.process_trees import as_from_a_terminal, wait_until
from tests.bench.small_suites import small_suite

pytestmark = [pytest.mark.ci, pytest.mark.slow]
SIGNALS = (signal.SIGKILL, signal.SIGTERM, signal.SIGHUP, signal.SIGINT)
WHOM = ("main", "a worker", "all")
CASES = list(product(SIGNALS, WHOM))
NIGHTLY = bool(os.environ.get("UAVBENCH_NIGHTLY"))
STAGES = ("sequences/.box-*/frames/*", "results/*/*/record.json", "results/*/*/score.json")
"""Files that there are when a stage has begun."""
MOMENTS = 50 if NIGHTLY else len(STAGES)
LEFT_ALONE = ("times.csv", "seconds.json", "latency.json", "report.json")
"""Files of wall times, and the list of a report, with the digests of the figures that show them."""


def final(folder):
    """All that must be the same: everything but wall times, what shows them, locks and records."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for pattern in ("sequences/**/*", "results/*/*/*.csv", "results/*/*/*.tum", "results/*/*/record.json", "*.json")
        for path in sorted(folder.glob(pattern))
        if path.is_file() and path.name not in LEFT_ALONE
    }


def start(suite, out):
    verb = "run" if NIGHTLY else "score"
    command = [sys.executable, "-m", "uavbench.bench.cli.main", verb, str(suite), "--out", str(out), "--jobs", "2"]
    return subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        start_new_session=True,
        preexec_fn=as_from_a_terminal,
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
    folder = tmp_path_factory.mktemp("kill")
    suite = small_suite(folder, 'rapid = { kind = "rapid" }\n')
    begin = time.monotonic()
    process = start(suite, folder / "out")
    assert process.wait() == 0, process.stdout.read()
    return suite, folder / "out", time.monotonic() - begin


@pytest.mark.parametrize("moment", range(MOMENTS))
def test_killed_and_resumed_is_as_undisturbed(undisturbed, tmp_path, moment):
    suite, expected, took_s = undisturbed
    rng = np.random.default_rng(moment)
    how, whom = CASES[(5 * moment) % len(CASES)]
    process = start(suite, tmp_path / "out")
    if NIGHTLY:
        time.sleep(float(rng.uniform(0.05, 1.0)) * took_s)
    else:
        assert wait_until(lambda: any((tmp_path / "out").glob(STAGES[moment])))
    end(process, how, whom, rng)
    text, _ = process.communicate()
    if how != signal.SIGKILL and whom != "a worker":
        assert b"Traceback" not in text, text.decode()
    again = start(suite, tmp_path / "out")
    text, _ = again.communicate()
    assert again.returncode == 0, text.decode()
    got, want = final(tmp_path / "out"), final(expected)
    assert got.keys() == want.keys()
    assert [name for name in want if got[name] != want[name]] == []
    assert not [p for p in (tmp_path / "out").rglob(".*") if not p.name.startswith(".lock")]
