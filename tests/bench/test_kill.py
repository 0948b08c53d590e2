"""kill -9 when a random part of a suite is written: after the same command again, all is as after an undisturbed run.

Three moments in CI; fifty with UAVBENCH_NIGHTLY=1.
"""

import contextlib
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from tests.bench.small_suites import small_suite

pytestmark = pytest.mark.slow
MOMENTS = 50 if os.environ.get("UAVBENCH_NIGHTLY") else 3


def final(folder):
    """All that must be the same: everything but wall times, locks and what tells of them."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for pattern in ("sequences/**/*", "results/*/*/*.csv", "results/*/*/*.tum", "results/*/*/record.json", "*.json")
        for path in sorted(folder.glob(pattern))
        if path.is_file() and path.name not in ("times.csv", "seconds.json")
    }


def start(suite, out):
    command = [sys.executable, "-m", "bench.cli", "score", str(suite), "--out", str(out), "--jobs", "2"]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, start_new_session=True)


def written(folder):
    """How many files there are, those included that are being written."""
    with contextlib.suppress(FileNotFoundError):  # one that was renamed meanwhile
        return sum(path.is_file() for path in folder.rglob("*"))
    return 0


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    folder = tmp_path_factory.mktemp("kill")
    suite = small_suite(folder, 'rapid = { kind = "rapid" }\n')
    process = start(suite, folder / "out")
    assert process.wait() == 0, process.stdout.read()
    return suite, folder / "out"


@pytest.mark.parametrize("moment", range(MOMENTS))
def test_killed_and_resumed_is_as_undisturbed(undisturbed, tmp_path, moment):
    suite, expected = undisturbed
    files = round(written(expected) * float(np.random.default_rng(moment).uniform(0.02, 0.9)))
    process = start(suite, tmp_path / "out")
    while written(tmp_path / "out") < files and process.poll() is None:
        time.sleep(0.002)
    os.killpg(process.pid, signal.SIGKILL)
    process.communicate()
    assert process.returncode == -signal.SIGKILL, "it was done before it was killed"
    assert final(tmp_path / "out") != final(expected)
    again = start(suite, tmp_path / "out")
    text, _ = again.communicate()
    assert again.returncode == 0, text.decode()
    got, want = final(tmp_path / "out"), final(expected)
    assert got.keys() == want.keys()
    assert [name for name in want if got[name] != want[name]] == []
    assert not [p for p in (tmp_path / "out").rglob(".*") if not p.name.startswith(".lock")]
