"""Standard streams that can be written to, whatever the shell made of them: closed, or a file on a full disk.

The next file that is opened gets the lowest descriptor that is free. Where standard error is closed, that is 2, and
what native libraries say (OpenGL's, OpenCV's) goes into the midst of a user's file.
"""

import io
import os
import sys
from typing import Any, TextIO

NAMES = ("stdin", "stdout", "stderr")
"""Names in `sys` of the descriptors 0, 1 and 2."""


class Forgiving(io.FileIO):
    """Writer to a descriptor that takes what cannot be written for written, and keeps the first error."""

    lost: OSError | None = None

    def write(self, data: Any, /) -> Any:
        """Bytes that were written, or are lost; None where a descriptor that does not block would."""
        try:
            return super().write(data)
        except OSError as error:
            self.lost = self.lost or error
            return memoryview(data).nbytes


def open_closed_streams() -> None:
    """Open the null device in place of each standard stream that is closed; the others remain as they are.

    A descriptor that a script has opened a file of its own on stays that file's, and the stream has another one.
    """
    for number, name in enumerate(NAMES):
        missing = getattr(sys, name) is None
        if not missing and _is_open(number):
            continue
        opened = os.open(os.devnull, os.O_RDWR)  # gets the lowest number: this one, if it is closed
        os.set_inheritable(opened, opened == number)
        if missing:
            raw = io.FileIO(opened, "rb" if name == "stdin" else "wb", closefd=False)
            buffer = io.BufferedReader(raw) if name == "stdin" else io.BufferedWriter(raw)
            setattr(sys, name, io.TextIOWrapper(buffer, "utf-8", "backslashreplace"))


def _is_open(descriptor: int) -> bool:
    try:
        os.fstat(descriptor)
    except OSError:
        return False
    return True


def forgive_lost_output() -> Forgiving | None:
    """Make standard output and error streams to which no write fails; the writer of the output, which tells a loss.

    None where the output is no descriptor, as in a notebook. Closed streams are opened first.
    """
    open_closed_streams()
    sys.stderr = _forgiving(sys.stderr)
    sys.stdout = _forgiving(sys.stdout)
    raw = getattr(getattr(sys.stdout, "buffer", None), "raw", None)
    return raw if isinstance(raw, Forgiving) else None


def _forgiving(stream: TextIO) -> TextIO:
    """A text stream with a Forgiving writer; other kinds of stream as they are."""
    try:
        number = stream.fileno() if isinstance(stream, io.TextIOWrapper) else -1
    except (OSError, ValueError):  # of no descriptor, or closed
        number = -1
    if not isinstance(stream, io.TextIOWrapper) or not 0 <= number <= 2:
        return stream
    stream.flush()
    return io.TextIOWrapper(
        io.BufferedWriter(Forgiving(number, "wb", closefd=False)),
        encoding=stream.encoding,
        errors=stream.errors,
        line_buffering=stream.line_buffering or stream.write_through,  # as of `python -u`, which has no buffer
    )
