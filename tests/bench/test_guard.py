"""The guard of a program: whatever the program starts, and however its owner ends, nothing is left."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tests.bench.process_trees import FAMILY, MEMBERS, is_alive, noted, wait_until
from uavbench.bench.external.guard import Guard, finished, talk
from uavbench.bench.external.guard_process import children

STANDARD = (0, 1, 2)


def family(note, then):
    return [sys.executable, "-c", FAMILY.format(note=str(note)) + then]


def start(guard, command, **limits):
    with Path(os.devnull).open("r+b") as null:
        guard.start(command, os.environ, (null.fileno(),) * 3, **limits)


def test_the_end_of_a_program_is_the_end_of_all_it_has_started(tmp_path):
    note = tmp_path / "note"
    wait = f"\nwhile len(open(NOTE).read().split()) < {MEMBERS}: time.sleep(0.01)\nsys.exit(3)"
    with Guard("uavbench-test-") as guard:
        start(guard, family(note, wait))
        assert guard.wait(60).code == 3
        assert len(noted(note)) == MEMBERS
        assert not [pid for pid in noted(note) if is_alive(pid)]
        assert guard.folder.is_dir()
    assert not guard.folder.exists()


def test_a_program_is_ended_with_all_it_has_started(tmp_path):
    note = tmp_path / "note"
    with Guard("uavbench-test-") as guard:
        start(guard, family(note, "\ntime.sleep(600)"))
        assert guard.wait(0.01) is None
        assert wait_until(lambda: len(noted(note)) == MEMBERS)
        guard.end()
        assert not [pid for pid in noted(note) if is_alive(pid)]
        assert guard.wait(1).code == -signal.SIGKILL


@pytest.mark.parametrize(
    ("code", "last"),
    [
        ("print('out'); print('first\\nof the errors', file=sys.stderr); sys.exit(3)", "of the errors"),
        ("print('only this'); sys.exit(3)", "only this"),
        ("sys.exit(3)", "exit code 3"),
    ],
)
def test_what_a_program_said_is_told_with_its_code(code, last):
    with Guard("uavbench-test-") as guard:
        done = finished(guard, [sys.executable, "-c", f"import sys; {code}"], os.environ)
    assert done.code == 3
    assert done.last == last


def test_benchmarks_end_with_the_command_that_was_killed(tmp_path):
    note = tmp_path / "note"
    (tmp_path / "pytest.py").write_text(
        FAMILY.format(note=str(note)) + "\ntime.sleep(600)\n"
    )  # in place of the real one
    speed = "from uavbench.bench.speed.table import speed; speed('', None)"
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), *filter(None, sys.path)])}
    command = subprocess.Popen([sys.executable, "-c", speed], env=environment, stdin=subprocess.DEVNULL)
    try:
        assert wait_until(lambda: len(noted(note)) == MEMBERS)
    finally:
        command.kill()
        command.wait()
    assert wait_until(lambda: not [pid for pid in noted(note) if is_alive(pid)])


@pytest.mark.parametrize("moment", ["before", "during"])
def test_a_killed_owner_takes_all_with_it(tmp_path, moment):
    note, told = tmp_path / "note", tmp_path / "folder"
    code = f"""
import os, sys, time
from pathlib import Path
from uavbench.bench.external.guard import Guard, finished, talk
guard = Guard("uavbench-test-")
Path({str(told)!r}).write_text(f"{{guard.folder}} {{guard.popen.pid}}")
if {moment!r} == "during":
    guard.start({family(note, chr(10) + "time.sleep(600)")!r}, os.environ, (0, 1, 2))
time.sleep(600)
"""
    owner = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.DEVNULL, stdin=subprocess.DEVNULL)
    try:
        assert wait_until(lambda: told.exists() and " " in told.read_text())
        assert wait_until(lambda: moment == "before" or len(noted(note)) == MEMBERS)
    finally:
        owner.kill()
        owner.wait()
    folder, guard = told.read_text().split()
    assert wait_until(lambda: not is_alive(int(guard)))
    assert not [pid for pid in noted(note) if is_alive(pid)]
    assert not Path(folder).exists()


@pytest.mark.parametrize("killed", ["parent", "child"])
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
def test_a_guard_that_somebody_kills_leaves_nothing_either(tmp_path, killed, number):
    note = tmp_path / "note"
    with Guard("uavbench-test-") as guard:
        start(guard, family(note, "\ntime.sleep(600)"))
        assert wait_until(lambda: len(noted(note)) == MEMBERS)
        (child,) = children(guard.popen.pid)
        os.kill(guard.popen.pid if killed == "parent" else child, number)
        assert guard.wait(60).code == -signal.SIGKILL
    assert not [pid for pid in noted(note) if is_alive(pid)]
    assert not guard.folder.exists()
    assert wait_until(lambda: not is_alive(child))


def test_memory_is_limited_as_a_sum():
    one = "x = bytearray(60 << 20); import time; time.sleep(600)"
    many = f"""
import subprocess, sys, time
for _ in range(4):
    subprocess.Popen([sys.executable, "-I", "-S", "-c", {one!r}], start_new_session=True)
time.sleep(600)
"""
    with Guard("uavbench-test-") as guard:
        start(guard, [sys.executable, "-c", many], memory_mb=150)
        ended = guard.wait(60)
    assert ended.code == -signal.SIGKILL
    assert ended.used_mb > 150


def test_the_size_of_a_file_is_limited():
    with Guard("uavbench-test-") as guard:
        code = "open('small', 'wb').write(bytes(1 << 20)); open('large', 'wb').write(bytes(3 << 20))"
        start(guard, [sys.executable, "-I", "-S", "-c", code], file_mb=2)
        assert guard.wait(60).code != 0
        sizes = {path.name: path.stat().st_size for path in guard.folder.iterdir()}
    assert sizes["small"] == 1 << 20 and sizes["large"] <= 2 << 20


def test_memory_that_is_shared_counts_once():
    shared = """
import mmap, os, time
pages = mmap.mmap(-1, 60 << 20)
pages.write(bytes(60 << 20))
for _ in range(4):
    if os.fork() == 0:
        sum(pages[::4096])
        time.sleep(1)
        os._exit(0)
for _ in range(4):
    os.wait()
"""
    with Guard("uavbench-test-") as guard:
        start(guard, [sys.executable, "-I", "-S", "-c", shared], memory_mb=200)
        assert guard.wait(60).code == 0


def test_what_cannot_be_started_says_so(capfd):
    with Guard("uavbench-test-") as guard:
        guard.start(["no-such-program"], os.environ, STANDARD)
        assert guard.wait(60).code == 127
    assert "no-such-program: No such file" in capfd.readouterr().err


def test_a_program_is_asked_and_answers_until_it_is_left(tmp_path):
    code = "import os, sys\nfor line in sys.stdin: print(os.getpid(), line.strip()[::-1], flush=True)"
    with talk([sys.executable, "-c", code], os.environ, tmp_path) as it:
        it.asks.write("abc\n")
        it.asks.flush()
        pid, answer = it.answers.readline().split()
        assert answer == "cba"
    assert not is_alive(int(pid))
    with talk([sys.executable, "-c", "pass"], os.environ, tmp_path) as it:
        assert it.answers.readline() == ""
        it.asks.write("abc\n")  # nobody reads it
