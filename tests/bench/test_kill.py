"""A suite ended at random moments, main process or workers: after the same command again all is as undisturbed.

Three moments in CI, one for each of those that are ended; fifty with UAVBENCH_NIGHTLY=1.
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

from tests.bench.process_trees import wait_until, with_mark
from tests.bench.small_suites import small_suite

pytestmark = pytest.mark.slow
SIGNALS = (signal.SIGKILL, signal.SIGTERM, signal.SIGHUP, signal.SIGINT)
WHOM = ("main", "a worker", "all")
CASES = list(product(SIGNALS, WHOM))
MOMENTS = 50 if os.environ.get("UAVBENCH_NIGHTLY") else 3
LEFT_ALONE = ("times.csv", "seconds.json", "latency.json")
"""Files of wall times."""


def final(folder):
    """All that must be the same: everything but wall times, what shows them, locks and records."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for pattern in ("sequences/**/*", "results/*/*/*.csv", "results/*/*/*.tum", "results/*/*/record.json", "*.json")
        for path in sorted(folder.glob(pattern))
        if path.is_file() and path.name not in LEFT_ALONE
    }


def start(suite, out):
    """The command, its temporary files in a folder beside `out`."""
    temporary = out.parent / "temporary"
    temporary.mkdir(exist_ok=True)
    command = [sys.executable, "-m", "uavbench.bench.cli.main", "run", str(suite), "--out", str(out), "--jobs", "2"]
    return subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        start_new_session=True,
        env={**os.environ, "TMPDIR": str(temporary)},
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),  # a background job ignores it
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


def expect_nothing_left(temporary):
    """No process that was started with these temporary files, and none of them."""
    assert wait_until(lambda: not with_mark(f"TMPDIR={temporary}")), with_mark(f"TMPDIR={temporary}")
    assert wait_until(lambda: not list(temporary.iterdir())), list(temporary.rglob("*"))


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
    time.sleep(float(rng.uniform(0.05, 1.0)) * took_s)
    end(process, how, whom, rng)
    text, _ = process.communicate()
    expect_nothing_left(tmp_path / "temporary")
    if how != signal.SIGKILL and whom != "a worker":
        assert b"Traceback" not in text, text.decode()
    again = start(suite, tmp_path / "out")
    text, _ = again.communicate()
    assert again.returncode == 0, text.decode()
    expect_nothing_left(tmp_path / "temporary")
    got, want = final(tmp_path / "out"), final(expected)
    assert got.keys() == want.keys()
    assert [name for name in want if got[name] != want[name]] == []
    assert not [p for p in (tmp_path / "out").rglob(".*") if not p.name.startswith(".lock")]
