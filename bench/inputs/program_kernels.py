"""Kernels that an external program compiles with numba, kept by the content of all of its files."""

from collections.abc import Callable, Iterable
from pathlib import Path

from uavbench.bench.inputs.named_files import MOST_BYTES, is_python
from uavbench.trajectories.kernels.cache import folder_of, key_of
from uavbench.trajectories.sources.parsed_source import content_of


def kernels_of_program(scripts: Iterable[Path], files: Callable[[], Iterable[Path]]) -> Path | None:
    """Folder for numba's cache of a program; None where none is needed or possible.

    scripts: the files that its command runs; files: finds all that it depends on, and is called if numba may be used.
    """
    if not any(map(_may_use_numba, scripts)):
        return None
    try:
        return folder_of(key_of("program", frozenset(files())))
    except OSError:
        return None


def _may_use_numba(path: Path) -> bool:
    """Whether a file is Python source that mentions numba, or a script that may start such a program."""
    if not path.is_file() or path.stat().st_size > MOST_BYTES:
        return False
    content = content_of(path)
    return b"numba" in content if is_python(path) else b"\0" not in content
