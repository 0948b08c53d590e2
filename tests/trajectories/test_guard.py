"""The guard of a program: whatever the program starts, and however its owner ends, nothing is left."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tests.bench.process_trees import FAMILY, MEMBERS, is_alive, noted, wait_until
from uavbench.trajectories.processes import guard as guarding
from uavbench.trajectories.processes.guard import Ended, Guard, finished, talk, talk_in
from uavbench.trajectories.processes.guard_process import children

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
from uavbench.trajectories.processes.guard import Ended, Guard, finished, talk, talk_in
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


def handles():
    return {path.name for path in Path("/proc/self/fd").iterdir()}


def test_a_guard_and_a_talk_leave_no_open_file_and_no_process_of_their_own(tmp_path):
    before = handles()
    with Guard("uavbench-test-") as guard:
        assert os.getpgid(guard.popen.pid) != os.getpgid(0), "what is sent to this group is not sent to it"
        with talk_in(guard, [sys.executable, "-I", "-S", "-c", "input()"], os.environ) as it:
            it.asks.write("end\n")
    assert guard.popen.returncode == 0, "it ends by itself"
    assert handles() == before


def test_without_room_for_a_folder_there_is_no_guard_and_nothing_of_it():
    before = handles()
    with pytest.raises(OSError, match="no temporary folder can be made in") as raised:
        Guard("no/such/folder/")
    assert handles() == before
    assert raised.value.errno is None


def test_after_a_killed_guard_nothing_is_left_as_soon_as_it_is_closed(tmp_path):
    note = tmp_path / "note"
    with Guard("uavbench-test-") as guard:
        start(guard, family(note, "\ntime.sleep(600)"))
        assert wait_until(lambda: len(noted(note)) == MEMBERS)
        guard.popen.kill()
    assert not [pid for pid in noted(note) if is_alive(pid)]
    assert not guard.folder.exists()


def test_where_both_processes_of_a_guard_are_killed_its_owner_removes_the_folder():
    with Guard("uavbench-test-") as guard:
        (child,) = children(guard.popen.pid)
        (guard.folder / "deep").mkdir()
        for pid in (guard.popen.pid, child):
            os.kill(pid, signal.SIGSTOP)
        for pid in (child, guard.popen.pid):
            os.kill(pid, signal.SIGKILL)
        assert guard.wait(60) == Ended(-signal.SIGKILL, 0.0)
    assert not guard.folder.exists()


def test_a_guard_that_hangs_is_killed(monkeypatch):
    monkeypatch.setattr("uavbench.trajectories.processes.guard.END_S", 0.5)
    with Guard("uavbench-test-") as guard:
        (child,) = children(guard.popen.pid)
        guard.popen.send_signal(signal.SIGSTOP)
    assert guard.popen.returncode == -signal.SIGKILL
    assert wait_until(lambda: not is_alive(child))
    assert wait_until(lambda: not guard.folder.exists())


def test_a_result_stays_when_the_guard_is_killed_afterwards():
    with Guard("uavbench-test-") as guard:
        start(guard, [sys.executable, "-I", "-S", "-c", "raise SystemExit(3)"])
        assert guard.wait(60) == Ended(3)
        guard.popen.kill()
    assert guard.wait(0.0) == Ended(3)


def test_a_long_environment_arrives_whole_and_files_are_of_any_size():
    """More than a socket holds: eight variables of 100 kB."""
    code = "import os; open('size', 'w').write(str(sum(len(v) for v in os.environ.values())))"
    code += "; open('large', 'wb').write(bytes(3 << 20))"
    with Guard("uavbench-test-") as guard:
        many = {f"LONG_{k}": "x" * 100_000 for k in range(8)}
        with Path(os.devnull).open("r+b") as null:
            guard.start([sys.executable, "-I", "-S", "-c", code], many, (null.fileno(),) * 3)
        assert guard.wait(60).code == 0
        assert int((guard.folder / "size").read_text()) >= 800_000
        assert (guard.folder / "large").stat().st_size == 3 << 20


def test_a_talk_is_in_its_folder_and_its_errors_are_ours(tmp_path, capfd):
    code = "import os, sys; print(os.getcwd(), flush=True); print('in doubt', file=sys.stderr, flush=True); input()"
    with talk([sys.executable, "-c", code], os.environ, tmp_path) as it:
        assert it.answers.readline().strip() == str(tmp_path.resolve())
        it.asks.write("end\n")
        it.asks.flush()
        assert it.answers.readline() == ""
    assert "in doubt" in capfd.readouterr().err


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


def test_processor_time_is_limited():
    with Guard("uavbench-test-") as guard:
        start(guard, [sys.executable, "-I", "-S", "-c", "while True: pass"], cpu_s=1)
        assert guard.wait(60).code == -signal.SIGXCPU


def test_a_lower_limit_that_is_there_already_stays():
    lower = "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (1 << 20, 1 << 20))"
    code = f"""
{lower}
import os
from pathlib import Path
from uavbench.trajectories.processes.guard_process import limit
limit(0, 2, 0)
print(resource.getrlimit(resource.RLIMIT_FSIZE))
"""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    with Guard("uavbench-test-") as guard:
        assert finished(guard, [sys.executable, "-c", code], environment).out.strip() == f"({1 << 20}, {1 << 20})"


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


def test_a_program_that_takes_too_long_is_given_up_then_and_not_before(monkeypatch):
    monkeypatch.setattr(guarding, "WAIT_S", 0.05)
    sleep = [sys.executable, "-c", "import sys, time; time.sleep(float(sys.argv[1]))"]
    with Guard("uavbench-test-") as guard:
        assert finished(guard, [*sleep, "0.3"], os.environ, timeout_s=600.0).code == 0
    begun = Guard("uavbench-test-")
    with begun, pytest.raises(TimeoutError, match=r"did not end within 0\.2 s"):
        finished(begun, [*sleep, "20"], os.environ, timeout_s=0.2)
    assert not begun.folder.exists()
