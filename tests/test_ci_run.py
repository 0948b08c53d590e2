"""`.ci/run` as it stands, with tools that do nothing but fail where they are told to: no fault is passed over."""

import os
import shutil
import signal
import subprocess
from pathlib import Path

import pytest

from tests.bench.process_trees import DEADLINE_S, is_alive, wait_until

ROOT = Path(__file__).parents[1]
TOOL = """#!/bin/bash
say="${0##*/} $*"
echo "$say" >&2
echo "0 jobs done"
case "$say" in *"${SLOW:-nothing}"* | *"${ALSO_SLOW:-nothing}"*) echo $$ >"$PIDS/${0##*/}" && exec sleep 1000 ;; esac
case "$say" in *"${FAILS:-nothing}"*) exit 7 ;; esac
case "$say" in
*"-m venv "*) mkdir -p "${!#}/bin" && cp "$0" "${!#}/bin/pip" && cp "$0" "${!#}/bin/uavbench" ;;
esac
"""
STEPS = [
    *("ruff check", "ruff format", "mypy", "lint-imports", "-m build", "pip install -q --disable-pip-version-check /"),
    *("uavbench list", "run run tiny", "run test -n 0 tests/scenes/test_croissant.py"),
    *("run test -n 0 tests/scenes/test_ifc.py", "run score gate-small", "run gate", "run test -m ci"),
]


@pytest.fixture
def started(tmp_path):
    """Starts `.ci/run` of a tree of such tools."""
    (tmp_path / ".ci").mkdir()
    shutil.copy(ROOT / ".ci" / "run", tmp_path / ".ci" / "run")
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        (tmp_path / name).touch()
    for name in ("src", "bench", "scenes", "trajectories", "tracker", "reports"):
        (tmp_path / name).mkdir()
    tools = tmp_path / ".venv" / "bin"
    tools.mkdir(parents=True)
    for tool in (tmp_path / "run", *(tools / name for name in ("python", "ruff", "mypy", "lint-imports"))):
        tool.write_text(TOOL)
        tool.chmod(0o755)

    def start(**variables):
        return subprocess.Popen(
            [tmp_path / ".ci" / "run"],
            env={**os.environ, "PIDS": str(tmp_path), "TMPDIR": str(tmp_path), **variables},
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
        )

    return start


def test_every_step_is_done_and_told(started):
    process = started()
    told = process.communicate(timeout=DEADLINE_S)[0]
    assert process.returncode == 0, told
    assert [step for step in STEPS if step not in told] == []
    assert told.splitlines()[-1].startswith("== done (")


@pytest.mark.parametrize("step", STEPS)
def test_a_step_that_fails_fails_the_whole_with_its_code_and_its_output(started, tmp_path, step):
    process = started(FAILS=step)
    told = process.communicate(timeout=DEADLINE_S)[0]
    assert process.returncode == 7, told
    assert step in told and "== done" not in told
    assert not list(tmp_path.glob("tmp.*"))


def test_what_runs_beside_the_tests_ends_with_the_whole(started, tmp_path):
    pids = tmp_path / "pids"
    pids.mkdir()
    process = started(SLOW="mypy", PIDS=str(pids), ALSO_SLOW="run test -m ci")
    assert wait_until(lambda: {path.name for path in pids.iterdir() if path.stat().st_size} == {"mypy", "run"})
    beside = int((pids / "mypy").read_text())
    os.killpg(process.pid, signal.SIGTERM)  # as a runner does: the steps beside are no part of this group
    told = process.communicate(timeout=DEADLINE_S)[0]
    assert process.returncode != 0, told
    assert wait_until(lambda: not is_alive(beside))
    assert not list(tmp_path.glob("tmp.*"))
