"""Programs that start others in every way, and what is left of them."""

import os
import signal
import time
from pathlib import Path

DEADLINE_S = 600.0
"""A safety net: what is waited for comes by itself, sooner or later as the machine has other work."""

FAMILY = """
import os, subprocess, sys, time
NOTE = {note!r}
WRITE = '''
import os, sys, time
open(sys.argv[1], "a").write(f"{{os.getpid()}}\\\\n")
while True:
    open(sys.argv[1] + ".alive", "a").write("x")
    time.sleep(0.02)
'''
def child(**options):
    subprocess.Popen([sys.executable, "-I", "-S", "-c", WRITE, NOTE], **options)
open(NOTE, "a").write(f"{{os.getpid()}}\\n")
child()                              # a child
child(start_new_session=True)        # one with a session of its own
child(process_group=0)               # one with a process group of its own
if os.fork() == 0:                   # a daemon: forked twice, out of the session
    os.setsid()
    if os.fork() == 0:
        child()
        child(start_new_session=True)
        time.sleep(600)
    os._exit(0)
"""
"""A program that has six children and grandchildren; each notes its pid and goes on writing."""
MEMBERS = 6


def is_alive(pid):
    """Whether a process is there, and not only waiting to be taken note of."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def command_line(pid):
    """The command line of a process, its words parted by zeros; empty of one that is gone."""
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes()
    except OSError:
        return b""


def noted(note):
    """Pids in a note."""
    return [int(line) for line in note.read_text().split()] if note.exists() else []


def wait_until(condition):
    """Whether something becomes true within the deadline."""
    end = time.monotonic() + DEADLINE_S
    while not condition():
        if time.monotonic() > end:
            return False
        time.sleep(0.02)
    return True


def with_mark(mark):
    """Processes whose environment holds a mark."""
    found = []
    for path in Path("/proc").iterdir():
        if path.name.isdigit() and int(path.name) != os.getpid():
            try:
                if mark.encode() in (path / "environ").read_bytes() and is_alive(int(path.name)):
                    found.append(int(path.name))
            except OSError:
                continue
    return found


def as_from_a_terminal():
    """To be called in a new process: with the signals of a terminal, though the tests are a job in the background."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGHUP, signal.SIG_DFL)
