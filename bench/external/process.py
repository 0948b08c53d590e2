"""Runs a program in its own folder, without a shell, with limits on time and memory; kills its processes at the end."""

import fcntl
import os
import select
import shutil
import signal
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from types import TracebackType

from uavbench.bench.external.isolation import EVERYWHERE, PASSED_IN, THREADS, WITHIN, isolated
from uavbench.bench.external.rows import TrackerFault
from uavbench.trajectories.errors import one_line
from uavbench.trajectories.processes.guard import Guard

PASSED_ON = ("PATH", "HOME", "LD_LIBRARY_PATH", "PYTHONPATH", "CUDA_VISIBLE_DEVICES", *THREADS)
"""The only environment variables that are passed to a program."""
PIPE_BYTES = 1 << 20
MAX_LINE_BYTES = 1 << 14
MAX_FILE_MB = 1024
LAST_BYTES = 2000
"""Bytes at the end of standard error in which its last line is looked for."""
GONE_S = 2.0
"""Time in s within which a program must end after closing its output."""


class Process:
    """A running program; on exit of the context its whole process tree is killed.

    files: files that an isolated program may read besides its folder; None: not isolated. kernels: folder of numba's
    cache, by default numba's own choice.
    """

    def __init__(
        self,
        command: Sequence[str],
        guard: Guard,
        *,
        memory_mb: int,
        piped: bool,
        files: Sequence[Path] | None = None,
        kernels: Path | None = None,
    ) -> None:
        if shutil.which(command[0]) is None:
            raise TrackerFault("cannot-start", "command", f"{command[0]!r} is not an executable program")
        self.guard, self.popen = guard, guard.popen
        self.memory_mb, self._folder, self._buffer = memory_mb, guard.folder, bytearray()
        self.stdin: int | None = None
        self.stdout: int | None = None
        (guard.folder / "tmp").mkdir()
        passed_on: Sequence[str] = PASSED_ON
        own = {"TMPDIR": str(guard.folder / "tmp"), **EVERYWHERE}
        own |= {} if kernels is None else {"NUMBA_CACHE_DIR": str(kernels)}
        if files is not None:
            command, passed_on, own = isolated(command, guard.folder, files), PASSED_IN, WITHIN
        environment = {name: os.environ[name] for name in passed_on if name in os.environ} | own
        theirs = [self._input(piped), self._output(piped), _open(guard.folder / "stderr.txt")]
        self._errors = os.open(guard.folder / "stderr.txt", os.O_RDONLY)
        try:
            files_of = (theirs[0], theirs[1], theirs[2])
            guard.start(command, environment, files_of, memory_mb=memory_mb, file_mb=MAX_FILE_MB)
        finally:
            for handle in theirs:
                os.close(handle)

    def _input(self, piped: bool) -> int:
        """The program's end of its standard input; our end is stored."""
        if not piped:
            return os.open(os.devnull, os.O_RDONLY)
        theirs, self.stdin = os.pipe()
        _ready(self.stdin)
        return theirs

    def _output(self, piped: bool) -> int:
        """The program's end of its standard output; our end is stored."""
        if not piped:
            return _open(self._folder / "stdout.txt")
        self.stdout, theirs = os.pipe()
        _ready(self.stdout)
        return theirs

    def __enter__(self) -> "Process":
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.kill()

    def kill(self) -> None:
        """Kill the program and its descendants."""
        self.guard.end()
        self.close_input()
        os.close(self._errors)
        if self.stdout is not None:
            os.close(self.stdout)
            self.stdout = None

    def close_input(self) -> None:
        """Close the program's standard input."""
        if self.stdin is not None:
            os.close(self.stdin)
            self.stdin = None

    def finish(self, timeout_s: float, where: str) -> None:
        """Wait for the program to exit; TrackerFault on timeout or a non-zero exit code."""
        self.close_input()
        ended = self.guard.wait(timeout_s)
        if ended is None:
            raise TrackerFault("hung", where, f"the program did not end within {timeout_s:g} s")
        if ended.code != 0 or ended.used_mb:
            raise self.crash(where)

    def send(self, parts: Sequence[bytes | memoryview], deadline: float, where: str) -> None:
        """Write all parts; TrackerFault when the program has ended, or does not read them by the deadline."""
        assert self.stdin is not None
        handle = self.stdin
        poll = select.poll()
        poll.register(handle, select.POLLOUT)
        for part in parts:
            view = memoryview(part).cast("B")
            while view:
                if not poll.poll(max(0.0, deadline - time.monotonic()) * 1e3):
                    raise TrackerFault("hung", where, "the program does not read its standard input")
                try:
                    view = view[os.write(handle, view) :]
                except BlockingIOError:
                    continue
                except BrokenPipeError:
                    raise self.crash(where) from None

    def line(self, deadline: float, where: str) -> str:
        """The program's next output line; TrackerFault when it has ended, on timeout, or when the line is not text."""
        while b"\n" not in self._buffer:
            if len(self._buffer) > MAX_LINE_BYTES:
                raise TrackerFault("malformed", where, f"a line longer than {MAX_LINE_BYTES} bytes")
            if not self._read(deadline - time.monotonic()):
                if self.guard.wait(0.0) is not None or time.monotonic() < deadline:
                    raise self.crash(where)
                raise TrackerFault("hung", where, "no answer before the timeout")
        text, _, self._buffer = self._buffer.partition(b"\n")
        try:
            return text.decode("utf-8")
        except UnicodeDecodeError:
            raise TrackerFault("malformed", where, f"the answer is not UTF-8 text: {bytes(text[:40])!r}") from None

    def said_more(self) -> str:
        """Output of the program after the lines already read; "" without any."""
        self._read(0.0)
        return self._buffer.decode("utf-8", errors="replace").strip()

    def discard(self) -> None:
        """Discard output of the program after the lines already read."""
        self._buffer.clear()

    def _read(self, timeout_s: float) -> bool:
        """Read the program's output; False at its end, or on timeout."""
        assert self.stdout is not None
        poll = select.poll()
        poll.register(self.stdout, select.POLLIN)
        if not poll.poll(max(0.0, timeout_s) * 1e3):
            return False
        with suppress(BlockingIOError):
            piece = os.read(self.stdout, PIPE_BYTES)
            self._buffer += piece
            return bool(piece)
        return True

    def crash(self, where: str) -> TrackerFault:
        """Fault of a program that has ended: its exit code and the last line of its standard error."""
        ended = self.guard.wait(GONE_S)
        if ended is None:
            how = "it closed its standard output but did not end"
        elif ended.used_mb:
            what = f"its processes used {ended.used_mb:.0f} MB in total, memory_mb is {self.memory_mb}"
            return TrackerFault("out-of-memory", where, what)
        elif ended.code < 0:
            how = f"it was killed by signal {_signal_name(-ended.code)}"
        elif ended.code == 127:
            return TrackerFault("cannot-start", where, f"it ended with exit code 127: {self.last_words()}")
        else:
            how = f"it ended with exit code {ended.code}"
        return TrackerFault("crashed", where, f"{how} (memory limit {self.memory_mb} MB): {self.last_words()}")

    def last_words(self) -> str:
        """The last line of the program's standard error, whatever the program did to the file's name."""
        first = max(0, os.fstat(self._errors).st_size - LAST_BYTES)
        lines = os.pread(self._errors, LAST_BYTES, first).decode("utf-8", errors="replace").strip().splitlines()
        return one_line(lines[-1])[:300] if lines else "nothing on standard error"


def _open(path: Path) -> int:
    return os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o644)


def _signal_name(number: int) -> str:
    """Name of a signal, or its number: real-time signals have no names."""
    try:
        return signal.Signals(number).name
    except ValueError:
        return str(number)


def _ready(pipe: int) -> None:
    """Enlarge the buffer of a pipe, and make our end non-blocking."""
    os.set_blocking(pipe, False)
    with suppress(OSError, AttributeError):
        fcntl.fcntl(pipe, fcntl.F_SETPIPE_SZ, PIPE_BYTES)
