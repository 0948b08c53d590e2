"""Whatever ends the main process, nothing of it remains: no worker, no tracker, no daemon, no open pipe, no folder.

Some moments for each signal in CI; all of them with UAVBENCH_NIGHTLY=1.
"""

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.bench.process_trees import (
    DEADLINE_S,
    FAMILY,
    MEMBERS,
    as_from_a_terminal,
    command_line,
    is_alive,
    noted,
    wait_until,
    with_mark,
)
from tests.bench.small_suites import recorded_suite

pytestmark = pytest.mark.slow
SIGNALS = (signal.SIGKILL, signal.SIGTERM, signal.SIGHUP, signal.SIGINT)
MOMENTS = ("starting", "tracking", "a worker is killed too", "a guard is killed too")
KILLED_TOO = {"a worker is killed too": b"spawn_main", "a guard is killed too": b"guard_process"}
"""What the command line of a process holds that is killed a moment before the main process."""
CASES = [
    pytest.param(number, moment, id=f"{number.name} {moment}")
    for number in SIGNALS
    for moment in MOMENTS
    if os.environ.get("UAVBENCH_NIGHTLY") or moment == "tracking" or number == signal.SIGKILL
]


@pytest.fixture(scope="module")
def rendered(tmp_path_factory):
    """A suite whose tracker is a program with many children, its sequences there; and where it notes them."""
    folder = tmp_path_factory.mktemp("processes")
    note = folder / "note"
    (folder / "family.py").write_text(FAMILY.format(note=str(note)) + "\ntime.sleep(600)\n")
    tracker = f"family = {{ kind = 'external', command = [{sys.executable!r}, 'family.py'], timeout_s = 600 }}\n"
    suite = recorded_suite(folder, tracker.replace("'", '"'))
    assert run(suite, folder / "out", "render", "x", folder).wait() == 0
    return suite, folder / "out", note


def run(suite, out, verb, mark, temporary):
    command = [sys.executable, "-m", "uavbench.bench.cli.main", verb, str(suite), "--out", str(out), "--jobs", "2"]
    environment = {**os.environ, "UAVBENCH_MARK": mark, "TMPDIR": str(temporary)}
    return subprocess.Popen(
        command,
        env=environment,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        preexec_fn=as_from_a_terminal,
    )


@pytest.mark.parametrize(("number", "moment"), CASES)
def test_nothing_remains_of_a_main_process_that_is_ended(rendered, tmp_path, number, moment):
    suite, out, note = rendered
    note.unlink(missing_ok=True)
    mark = f"uavbench-mark-{number}-{moment}-{tmp_path.name}"
    main = run(suite, out, "track", mark, tmp_path)
    try:
        if moment == "starting":
            assert wait_until(lambda: len(with_mark(mark)) >= 3)  # some worker is beginning, too
        else:
            assert wait_until(lambda: len(noted(note)) >= MEMBERS)
        if moment in KILLED_TOO:
            of_it = [pid for pid in with_mark(mark) if KILLED_TOO[moment] in command_line(pid)]
            os.kill(of_it[0], signal.SIGKILL)
        main.send_signal(number)
        text, _ = main.communicate(timeout=DEADLINE_S)  # ends, so nobody holds the pipe
    finally:
        main.kill()
    if moment != "starting":  # while it loads its libraries a signal ends it as it ends any program
        assert main.returncode in (-number, 128 + number, 130), text.decode()
        assert "Traceback" not in text.decode()
    assert wait_until(lambda: not with_mark(mark))
    assert wait_until(lambda: not [pid for pid in noted(note) if is_alive(pid)])
    assert wait_until(lambda: not list(tmp_path.glob("uavbench-*")))
    written = note.with_name("note.alive").stat().st_size if note.with_name("note.alive").exists() else 0
    time.sleep(0.1)
    assert not note.with_name("note.alive").exists() or note.with_name("note.alive").stat().st_size == written


def test_what_nohup_ignores_stays_ignored(rendered, tmp_path):
    suite, out, note = rendered
    note.unlink(missing_ok=True)
    mark = f"uavbench-mark-nohup-{tmp_path.name}"
    code = "import os, signal, sys; signal.signal(signal.SIGHUP, signal.SIG_IGN); os.execv(sys.argv[1], sys.argv[1:])"
    command = [sys.executable, "-m", "uavbench.bench.cli.main", "track", str(suite), "--out", str(out), "--jobs", "2"]
    main = subprocess.Popen(
        [sys.executable, "-c", code, *command],
        env={**os.environ, "UAVBENCH_MARK": mark, "TMPDIR": str(tmp_path)},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        assert wait_until(lambda: len(noted(note)) >= MEMBERS)
        main.send_signal(signal.SIGHUP)
        alive = note.with_name("note.alive")
        before = alive.stat().st_size
        assert wait_until(lambda: alive.stat().st_size > before)
        assert is_alive(main.pid)
        (ignored,) = re.findall(r"SigIgn:\s*(\w+)", Path(f"/proc/{main.pid}/status").read_text())
        assert int(ignored, 16) >> (signal.SIGHUP - 1) & 1
    finally:
        main.kill()
        main.wait()
    assert wait_until(lambda: not with_mark(mark))
    assert wait_until(lambda: not [pid for pid in noted(note) if is_alive(pid)])


IN_A_CALLBACK = """
import ctypes, os, signal, time

def callback():
    os.kill(os.getpid(), signal.{signal})
    time.sleep(0)

def come_and_wait():
    ctypes.CFUNCTYPE(None)(callback)()  # what is raised in there is heard by nobody
    time.sleep(600)
"""


@pytest.mark.parametrize(
    ("number", "main", "code"),
    [
        ("SIGTERM", "from uavbench.bench.runner.processes import *\nend_when_told()\ncome_and_wait()\n", 143),
        (
            "SIGTERM",
            "from uavbench.bench.runner.processes import *\nend_when_told()\nin_worker(come_and_wait, ())\n",
            143,
        ),
        (
            "SIGHUP",
            "import click\nfrom uavbench.bench.cli.main import Group\n"
            "Group('g', [click.command(name='c')(come_and_wait)])(['c'])\n",
            130,
        ),
    ],
)
def test_a_signal_that_comes_in_a_callback_of_c_ends_the_process(number, main, code):
    script = IN_A_CALLBACK.format(signal=number) + main
    command = [sys.executable, "-c", script]
    done = subprocess.run(command, capture_output=True, text=True, check=False, preexec_fn=as_from_a_terminal)
    assert done.returncode == code, done.stderr
    assert "Traceback" not in done.stderr
    assert "ignored" not in done.stderr


CAUGHT = """
import os, signal, sys, time
import click
from uavbench.bench.cli.main import Group

def caught_by_a_library():
    for _ in range(2):  # as trimesh catches what is raised while it imports scipy
        try:
            os.kill(os.getpid(), signal.{signal})
            time.sleep(600)
        except BaseException:
            pass
    time.sleep(600)

def cleaning_up():
    try:
        os.kill(os.getpid(), signal.{signal})
        time.sleep(600)
    finally:
        try:
            raise ValueError("while it cleans up")
        except ValueError:
            time.sleep(0.3)
        time.sleep(0.3)
        print("cleaned up")

class Slow:
    def __del__(self):
        time.sleep(0.3)

def with_a_slow_finalizer():
    try:
        [Slow(), os.kill(os.getpid(), signal.{signal}), time.sleep(600)]  # it ends before any handler runs
    finally:
        time.sleep(0.3)
        print("cleaned up")

def told_otherwise():
    from uavbench.trajectories.errors import UserError
    try:
        os.kill(os.getpid(), signal.{signal})
        time.sleep(600)
    except BaseException as error:
        time.sleep(0.3)
        raise UserError("told otherwise") from None

Group("g", [click.command(name="c")({what})])(["c"])
"""


@pytest.mark.parametrize("number", ["SIGINT", "SIGTERM"])
@pytest.mark.parametrize(
    ("what", "ended"),
    [
        ("caught_by_a_library", (130, "", "uavbench: interrupted; run the same command again\n")),
        ("cleaning_up", (130, "cleaned up\n", "uavbench: interrupted; run the same command again\n")),
        ("with_a_slow_finalizer", (130, "cleaned up\n", "uavbench: interrupted; run the same command again\n")),
        ("told_otherwise", (2, "", "uavbench: told otherwise\n")),
    ],
)
def test_a_signal_that_a_library_catches_ends_the_command_and_disturbs_no_cleaning_up(number, what, ended):
    command = [sys.executable, "-c", CAUGHT.format(signal=number, what=what)]
    done = subprocess.run(
        command, capture_output=True, text=True, check=False, preexec_fn=as_from_a_terminal, timeout=60
    )
    assert (done.returncode, done.stdout, done.stderr) == ended


GUARDING = """
import os, signal, sys, time
from uavbench.bench.runner.processes import end_when_told, in_worker
from uavbench.trajectories.processes.guard import Guard

def guarding():
    guard = Guard("uavbench-guarding-")
    guard.start([sys.executable, "-c", "import time; time.sleep(600)"], os.environ, (0, 1, 1))
    if os.fork() == 0:
        time.sleep(600)
    os.kill(os.getpid(), signal.SIGTERM)  # before it is known to anything that would close it
    time.sleep(600)

end_when_told()
in_worker(guarding, ())
"""


def test_a_worker_that_is_ended_leaves_its_guards_to_remove_their_folders(tmp_path):
    environment = {**os.environ, "UAVBENCH_MARK": f"uavbench-mark-{tmp_path.name}", "TMPDIR": str(tmp_path)}
    command = [sys.executable, "-c", GUARDING]
    done = subprocess.run(command, env=environment, capture_output=True, check=False, preexec_fn=as_from_a_terminal)
    assert done.returncode == 143, done.stderr
    assert wait_until(lambda: not with_mark(environment["UAVBENCH_MARK"]))
    assert not list(tmp_path.glob("uavbench-*"))


INTERRUPTED = """
import os, signal, sys

class Interrupt:
    def find_spec(self, name, path=None, target=None):
        if name == {module!r}:
            os.kill(os.getpid(), signal.SIGINT)

if __name__ == {where!r}:
    sys.meta_path.insert(0, Interrupt())
"""


@pytest.mark.parametrize(
    ("where", "module", "main", "ended"),
    [
        ("__main__", "uavbench.bench.cli.suite", "from uavbench.bench.cli.__main__ import main; main()", (-2, "")),
        (
            "__mp_main__",  # a spawned worker's name of it
            "uavbench.bench.runner.graph",
            "from uavbench.bench.runner.executors import SpawnPool; pool = SpawnPool(1)\n"
            "    print(pool.submit(int, '7').result()); pool.shutdown()",
            (0, "7\n"),
        ),
    ],
)
def test_an_interrupt_while_modules_are_imported_prints_no_traceback(tmp_path, where, module, main, ended):
    script = tmp_path / "script.py"
    script.write_text(INTERRUPTED.format(module=module, where=where) + f"if __name__ == '__main__':\n    {main}\n")
    command = [sys.executable, script]
    done = subprocess.run(command, capture_output=True, text=True, check=False, preexec_fn=as_from_a_terminal)
    assert (done.returncode, done.stdout, done.stderr) == (*ended, "")


def test_a_hang_up_of_all_leaves_the_account_of_semaphores():
    script = """
import multiprocessing, os, signal, time
from pathlib import Path
from uavbench.bench.runner.executors import SpawnPool
pool = SpawnPool(1)
for child in Path(f"/proc/self/task/{os.getpid()}/children").read_text().split():
    os.kill(int(child), signal.SIGHUP)
assert pool.submit(int, "7").result() == 7
pool.shutdown()
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
