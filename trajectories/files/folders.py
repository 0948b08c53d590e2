"""Folders made for what is written into them: told where they cannot be, removed where nothing came in."""

import errno
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from itertools import takewhile
from pathlib import Path
from tempfile import TemporaryFile, gettempdir


class _Tried(Exception):
    """A file could be made."""


def try_place(path: Path) -> None:
    """Make a nameless file where a long command will write `path`, and leave nothing; OSError where it cannot be.

    For commands that work, or let a user work, before they write.
    """
    with suppress(_Tried), folder_for(path):
        try:
            TemporaryFile(dir=path.parent).close()
        except FileNotFoundError:  # of a file system without new files, as /proc
            raise NotADirectoryError(errno.ENOTDIR, "no file can be made there", str(path)) from None
        raise _Tried


@contextmanager
def folder_for(path: Path, told: Path | None = None) -> Iterator[None]:
    """The folder of `path`, made with those above it; of those made, empty ones are removed when the context fails.

    NotADirectoryError of `told`, by default of the path, when a file stands where a folder should be, or when the file
    system has no new folders, as `/proc`.
    """
    missing = list(takewhile(lambda above: not os.path.lexists(above), path.parents))
    try:
        _make(path, told)
        yield
    except BaseException:
        for each in missing:
            with suppress(OSError):  # one that is not empty, as other processes write into it, or that was not made
                each.rmdir()
        raise


def _make(path: Path, told: Path | None) -> None:
    try:
        make_folder(path.parent)
    except (FileNotFoundError, FileExistsError, NotADirectoryError):
        above = next((each for each in path.parents if os.path.lexists(each)), path.parent)
        why = "no folder can be made there" if above.is_dir() else f"{above} is not a folder"
        raise NotADirectoryError(errno.ENOTDIR, why, str(told or path)) from None


def make_folder(folder: Path) -> None:
    """Make a folder and those above it where they are missing."""
    folder.mkdir(parents=True, exist_ok=True)


def temporary_folder() -> Path | None:
    """Temporary folder of this user's caches, into which nobody else can write; None where there can be none."""
    own = Path(gettempdir()) / f"uavbench-kernels-{os.getuid()}"
    with suppress(OSError):
        own.mkdir(mode=0o700, exist_ok=True)
        about = own.lstat()
        if stat.S_ISDIR(about.st_mode) and about.st_uid == os.getuid() and not about.st_mode & 0o077:
            return own
    return None
