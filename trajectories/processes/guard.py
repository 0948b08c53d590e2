"""A temporary folder and its processes, cleaned up when this process ends, even by kill -9.

A guard process (`guard_process`) owns both. It is the subreaper of all descendants of its program, so that daemons in
other sessions are killed too, and it detects the end of this process by its closed socket.
"""

import array
import json
import math
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TextIO

from uavbench.trajectories.processes import guard_process

SCRIPT = Path(guard_process.__file__)
START_S, END_S = 60.0, 20.0
"""Timeout for starting and stopping a guard, s; either usually takes a few hundredths of a second."""
WAIT_S = 3600.0
"""Polling interval for a program without timeout, s."""


@dataclass(frozen=True)
class Ended:
    """Exit code of a program, negative for a signal; the memory in MB at which it was killed, 0 if it was not."""

    code: int
    used_mb: float = 0.0


class Guard:
    """Context manager with a new, empty `folder`; on exit it kills its program and removes the folder.

    OSError when the folder cannot be created.
    """

    def __init__(self, prefix: str) -> None:
        self._socket, theirs = socket.socketpair()
        with theirs:
            self.popen = subprocess.Popen(
                [sys.executable, "-I", "-S", str(SCRIPT), str(theirs.fileno()), prefix],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                pass_fds=[theirs.fileno()],
                start_new_session=True,
            )
        self._received, self._gone = b"", False
        self._ended: Ended | None = None
        said = self._said(START_S)
        if said is None:
            self.close()
            raise OSError(f"no temporary folder can be made in {os.environ.get('TMPDIR', '/tmp')}")
        self.folder = Path(said["folder"])

    def __enter__(self) -> "Guard":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def start(
        self,
        command: Sequence[str],
        environment: Mapping[str, str],
        files: tuple[int, int, int],
        *,
        cwd: Path | None = None,
        memory_mb: int = 0,
        file_mb: int = 0,
        cpu_s: int = 0,
    ) -> None:
        """Start the program of this guard, of which there is one, in the guard's folder or in cwd.

        files: its standard input, output and error. memory_mb: limit of the address space of each process and of their
        total memory; file_mb: limit of a file's size; cpu_s: limit of the processor time of each process; 0 for no
        limit. A command that cannot be started has the exit code 127.
        """
        asked = {"command": list(command), "environment": dict(environment), "cwd": str(cwd or self.folder)}
        limits = {"memory_mb": memory_mb, "file_mb": file_mb, "cpu_s": cpu_s}
        line = json.dumps({**asked, **limits}).encode() + b"\n"
        rights = [(socket.SOL_SOCKET, socket.SCM_RIGHTS, array.array("i", files))]
        self._socket.settimeout(START_S)
        with suppress(OSError):  # `wait` reports a guard that has ended
            sent = self._socket.sendmsg([line], rights)
            self._socket.sendall(line[sent:])

    def wait(self, timeout_s: float) -> Ended | None:
        """Result of the program; None when it has not ended within timeout_s."""
        if self._ended is None and (said := self._said(timeout_s)) is not None:
            self._ended = Ended(**said)
        elif self._ended is None and self._gone:
            self._ended = Ended(-signal.SIGKILL)  # the guard was killed, and the program with it
        return self._ended

    def end(self) -> None:
        """Kill the program and its descendants."""
        self._socket.settimeout(END_S)
        with suppress(OSError):
            self._socket.sendall(b'{"end": true}\n')
            self.wait(END_S)

    def close(self) -> None:
        """Kill the program and its descendants, and remove the folder."""
        with suppress(OSError):  # a guard that is gone
            self._socket.shutdown(socket.SHUT_WR)
        try:
            self.popen.wait(END_S)
        except subprocess.TimeoutExpired:
            self.popen.kill()
            self.popen.wait()
        if self.popen.returncode < 0:  # the guard was killed; its child cleans up
            while not self._gone and self._said(END_S) is not None:
                pass
            if hasattr(self, "folder"):
                guard_process.remove(str(self.folder))
        self._socket.close()

    def _said(self, timeout_s: float) -> dict[str, Any] | None:
        """The guard's next message; None on timeout."""
        deadline = time.monotonic() + timeout_s
        while b"\n" not in self._received:
            self._socket.settimeout(max(1e-3, deadline - time.monotonic()))
            try:
                data = self._socket.recv(1 << 12)
            except TimeoutError:
                return None
            except OSError:
                data = b""
            if not data:
                self._gone = True
                return None
            self._received += data
        line, _, self._received = self._received.partition(b"\n")
        said: dict[str, Any] = json.loads(line)
        return said


@dataclass(frozen=True)
class Finished:
    """Exit code of a finished program, negative for a signal, and its output."""

    code: int
    out: str
    err: str

    @property
    def last(self) -> str:
        """The last line of standard error, or else of standard output, or else the exit code."""
        lines = (self.err.strip() or self.out.strip()).splitlines()
        return lines[-1] if lines else f"exit code {self.code}"


def finished(
    guard: Guard, command: Sequence[str], environment: Mapping[str, str], timeout_s: float = math.inf
) -> Finished:
    """Run a program in a guard's folder to its end, without input; it never outlives this process.

    TimeoutError when it has not ended within timeout_s; leaving the guard kills it.
    """
    deadline = time.monotonic() + timeout_s
    out, err = guard.folder / "stdout.txt", guard.folder / "stderr.txt"
    with Path(os.devnull).open("rb") as nothing, out.open("wb") as said, err.open("wb") as errors:
        guard.start(command, environment, (nothing.fileno(), said.fileno(), errors.fileno()))
    while (ended := guard.wait(min(WAIT_S, deadline - time.monotonic()))) is None:
        if time.monotonic() >= deadline:
            raise TimeoutError(f"did not end within {timeout_s:g} s")
    return Finished(ended.code, *(path.read_text(encoding="utf-8", errors="replace") for path in (out, err)))


@dataclass(frozen=True)
class Talk:
    """Standard input and output of a guarded program, as text."""

    asks: TextIO
    answers: TextIO


@contextmanager
def talk(command: Sequence[str], environment: Mapping[str, str], cwd: Path) -> Iterator[Talk]:
    """Context with a program and pipes for requests and answers; on exit it is killed with its descendants."""
    with Guard("uavbench-talk-") as guard, talk_in(guard, command, environment, cwd=cwd) as talking:
        yield talking


@contextmanager
def talk_in(
    guard: Guard, command: Sequence[str], environment: Mapping[str, str], *, cwd: Path | None = None, errors: int = 2
) -> Iterator[Talk]:
    """As `talk`, for a program of an existing guard; errors: file descriptor of its standard error."""
    (their_asks, asks), (answers, their_answers) = os.pipe(), os.pipe()
    guard.start(command, environment, (their_asks, their_answers, errors), cwd=cwd)
    os.close(their_asks)
    os.close(their_answers)
    with suppress(BrokenPipeError), os.fdopen(asks, "w") as to_it, os.fdopen(answers, errors="replace") as from_it:
        yield Talk(to_it, from_it)
