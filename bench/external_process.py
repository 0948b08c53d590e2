"""A program at work in its own folder: no shell, limits on time and memory, and nobody left behind."""

import fcntl
import os
import select
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from types import TracebackType

from bench.external_rows import TrackerFault

LAUNCH = Path(__file__).parent / "external_launch.py"
PASSED_ON = (
    "PATH",
    "HOME",
    "LANG",
    "LC_ALL",
    "LD_LIBRARY_PATH",
    "PYTHONPATH",
    "CUDA_VISIBLE_DEVICES",
    "OMP_NUM_THREADS",
)
"""The only environment variables that a program gets of ours."""
PIPE_BYTES = 1 << 20
MAX_LINE_BYTES = 1 << 14


class Process:
    """A running program; leaving the context kills it and all it has started."""

    def __init__(self, command: Sequence[str], folder: Path, *, memory_mb: int, piped: bool) -> None:
        if shutil.which(command[0]) is None:
            raise TrackerFault("cannot-start", "command", f"{command[0]!r} is no program that can be run")
        environment = {name: os.environ[name] for name in PASSED_ON if name in os.environ}
        (folder / "tmp").mkdir()
        with (folder / "stderr.txt").open("wb") as stderr, (folder / "stdout.txt").open("wb") as stdout:
            self.popen = subprocess.Popen(
                [sys.executable, "-I", "-S", str(LAUNCH), str(memory_mb), *command],
                cwd=folder,
                env={**environment, "TMPDIR": str(folder / "tmp"), "PYTHONUNBUFFERED": "1"},
                stdin=subprocess.PIPE if piped else subprocess.DEVNULL,
                stdout=subprocess.PIPE if piped else stdout,
                stderr=stderr,
                start_new_session=True,
                bufsize=0,
            )
        self.memory_mb, self._folder, self._buffer = memory_mb, folder, bytearray()
        if piped:
            for pipe in (self.popen.stdin, self.popen.stdout):
                assert pipe is not None
                os.set_blocking(pipe.fileno(), False)
                with suppress(OSError, AttributeError):
                    fcntl.fcntl(pipe.fileno(), fcntl.F_SETPIPE_SZ, PIPE_BYTES)

    def __enter__(self) -> "Process":
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.kill()

    def kill(self) -> None:
        """End the program and its process group at once."""
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(self.popen.pid, signal.SIGKILL)
        self.popen.wait()
        for pipe in (self.popen.stdin, self.popen.stdout):
            if pipe is not None:
                with suppress(OSError):
                    pipe.close()

    def finish(self, timeout_s: float, where: str) -> None:
        """Wait for the program's own end; TrackerFault when it hangs or ends with an error."""
        if self.popen.stdin is not None:
            with suppress(OSError):
                self.popen.stdin.close()
        try:
            self.popen.wait(timeout_s)
        except subprocess.TimeoutExpired:
            raise TrackerFault("hung", where, f"the program did not end within {timeout_s:g} s") from None
        if self.popen.returncode != 0:
            raise self.crash(where)

    def send(self, parts: Sequence[bytes | memoryview], deadline: float, where: str) -> None:
        """Write all parts; TrackerFault when the program is gone, or does not read them by the deadline."""
        assert self.popen.stdin is not None
        handle = self.popen.stdin.fileno()
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
        """The next line that the program says; TrackerFault when it is gone, silent, or says no text."""
        while b"\n" not in self._buffer:
            if len(self._buffer) > MAX_LINE_BYTES:
                raise TrackerFault("malformed", where, f"a line longer than {MAX_LINE_BYTES} bytes")
            if not self._read(deadline - time.monotonic()):
                if self.popen.poll() is not None or time.monotonic() < deadline:
                    raise self.crash(where)
                raise TrackerFault("hung", where, "no answer came in time")
        text, _, self._buffer = self._buffer.partition(b"\n")
        try:
            return text.decode("utf-8")
        except UnicodeDecodeError:
            raise TrackerFault("malformed", where, f"the answer is not UTF-8 text: {bytes(text[:40])!r}") from None

    def said_more(self) -> str:
        """What the program has said beyond the lines taken, "" if nothing."""
        self._read(0.0)
        return self._buffer.decode("utf-8", errors="replace").strip()

    def _read(self, timeout_s: float) -> bool:
        """Take in what the program has said; False at its end, or when nothing came in time."""
        assert self.popen.stdout is not None
        poll = select.poll()
        poll.register(self.popen.stdout.fileno(), select.POLLIN)
        if not poll.poll(max(0.0, timeout_s) * 1e3):
            return False
        with suppress(BlockingIOError):
            piece = os.read(self.popen.stdout.fileno(), PIPE_BYTES)
            self._buffer += piece
            return bool(piece)
        return True

    def crash(self, where: str) -> TrackerFault:
        """The fault of a program that is gone, with how it ended and the last it said."""
        with suppress(subprocess.TimeoutExpired):
            self.popen.wait(2.0)
        code = self.popen.returncode
        if code is None:
            how = "it closed its standard output but did not end"
        elif code < 0:
            how = f"it was ended by signal {signal.Signals(-code).name}"
        else:
            how = f"it ended with exit code {code}"
        if code == 127:
            return TrackerFault("cannot-start", where, f"{how}: {self.last_words()}")
        return TrackerFault("crashed", where, f"{how} (memory limit {self.memory_mb} MB): {self.last_words()}")

    def last_words(self) -> str:
        """The last line on its standard error."""
        with (self._folder / "stderr.txt").open("rb") as handle:
            handle.seek(0, os.SEEK_END)
            handle.seek(max(0, handle.tell() - 2000))
            lines = handle.read().decode("utf-8", errors="replace").strip().splitlines()
        return lines[-1][:300] if lines else "no word on standard error"
