"""Untrusted files read by libraries in C++: in a child process, whose crash, hang or hunger for memory is an error."""

import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NoReturn

from uavbench.trajectories.errors import UserError, one_line
from uavbench.trajectories.files.limits import FileLimit
from uavbench.trajectories.files.reading import opened
from uavbench.trajectories.processes.guard import Ended, Guard

MOST_MEMORY_MB = 4096
"""Memory of a reader: an IFC model of 26 MB, 60,000 walls, takes 0.55 GB."""
MOST_CPU_S = 600
"""Processor time of a reader, s: an IFC model of 20,000 walls takes 24 s."""
MOST_FILE_MB = 512
"""Size of each file that a reader writes."""
LONGEST_S = 4 * MOST_CPU_S
"""Wall-clock time of a reader, s, for one that waits instead of working, or on a busy machine."""
REFUSED = 3
"""Exit code of a reader that names what is wrong in the last line of its standard error."""
LAST_BYTES = 2000
"""Bytes at the end of standard error that are looked at."""


@contextmanager
def read_apart(module: str, path: Path, limit: FileLimit) -> Iterator[Path]:
    """Context with the folder into which a reader, `python -m module`, has written what it found in a file.

    The file is the reader's standard input, and the folder its working directory. UserError as `opened`, with what the
    reader refuses, and when it crashes, or exceeds MOST_MEMORY_MB, MOST_CPU_S or MOST_FILE_MB.
    """
    own = {"PYTHONPATH": os.pathsep.join(filter(None, sys.path)), "OPENBLAS_NUM_THREADS": "1"}
    with Guard("uavbench-reading-") as guard:
        said = guard.folder / "said.txt"
        with opened(path, limit) as file, said.open("wb") as errors:
            guard.start(
                [sys.executable, "-P", "-X", "utf8", "-m", module],
                {**os.environ, **own},
                (file.fileno(), errors.fileno(), errors.fileno()),
                memory_mb=MOST_MEMORY_MB,
                file_mb=MOST_FILE_MB,
                cpu_s=MOST_CPU_S,
            )
            ended = guard.wait(LONGEST_S)
        if wrong := _wrong(ended, _end(said)):
            raise UserError(f"{path}: {wrong}")
        yield guard.folder


def refuse(message: str) -> NoReturn:
    """End a reader with what is wrong with its file."""
    print(one_line(message), file=sys.stderr, flush=True)
    os._exit(REFUSED)  # no destructor of a library can change it


def _end(path: Path) -> str:
    with path.open("rb") as file:
        file.seek(max(0, path.stat().st_size - LAST_BYTES))
        return file.read().decode("utf-8", "replace")


def _wrong(ended: Ended | None, said: str) -> str:
    """What is wrong with the file of a reader that has ended, or has not in time; "" if nothing is."""
    if ended is None or ended.code == -signal.SIGXCPU:
        return f"reading it takes more than {MOST_CPU_S} s; simplify it"
    if ended.used_mb or "bad_alloc" in said or "MemoryError" in said:
        return f"reading it takes more than {MOST_MEMORY_MB:,} MB of memory; simplify it"
    last = one_line(said.strip().rpartition("\n")[2])
    if ended.code == REFUSED:
        return last
    if ended.code < 0:
        return f"its reader crashed ({signal.strsignal(-ended.code)}); the file is damaged, export it again"
    return f"cannot be read ({last or f'exit code {ended.code}'}); export it again" if ended.code else ""
