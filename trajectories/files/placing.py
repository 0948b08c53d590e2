"""Renames that replace nothing unseen: to a free name, or in exchange for what is checked afterwards.

A check before a rename leaves a moment in which somebody else may write the file. Here the file is first moved to where
nobody writes, then checked, and moved back when it must stay.
"""

import ctypes
import errno
import os
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

AT_FDCWD = -100
"""Relative paths are relative to the working folder, from `<fcntl.h>`."""
NOREPLACE, EXCHANGE = 1, 2
"""Flags of renameat2, from `<linux/fs.h>`."""
UNSUPPORTED = {errno.ENOSYS, errno.EINVAL, errno.ENOTSUP}
"""Errors of systems and file systems that lack these renames."""

Refuse = Callable[[Path], None]
"""Raises for a file or folder, by where it lies now, that must not be replaced."""


def put_file(made: Path, path: Path, refuse: Refuse) -> None:
    """Rename the file `made` to `path`; what was there is at `made` then, or, when `refuse` raises, where it was."""
    ours = _stamp(made)
    while True:
        try:
            return rename_new(made, path)
        except FileExistsError:
            pass
        try:
            exchanged = exchange(made, path)
        except FileNotFoundError:  # removed meanwhile
            continue
        break
    if not exchanged:
        refuse(path)
        made.replace(path)
        return None
    try:
        refuse(made)
    except BaseException:
        try:
            exchange(made, path)
        except FileNotFoundError:  # the new file was removed meanwhile
            give_back(made, path)
        else:
            if _stamp(made) != ours:  # somebody wrote to the new file meanwhile
                give_back(made, path)
        raise


def take_away(path: Path, to: Path, refuse: Refuse) -> None:
    """Rename a file or folder to the free name `to`; when `refuse` raises, it is back at `path`."""
    rename_new(path, to)
    try:
        refuse(to)
    except BaseException:
        give_back(to, path)
        raise


def give_back(there: Path, path: Path) -> None:
    """Rename `there` to `path`, or, where that was taken meanwhile, to the first free name `path.kept-N`."""
    name, number = path, 0
    while os.path.lexists(there):
        with suppress(FileExistsError):
            rename_new(there, name)
        number += 1
        name = path.with_name(f"{path.name}.kept-{number}")


def rename_new(source: Path, target: Path) -> None:
    """Rename to a free name; FileExistsError when something has it."""
    if not _renamed(source, target, NOREPLACE):
        if os.path.lexists(target):
            raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(target))
        source.rename(target)


def exchange(first: Path, second: Path) -> bool:
    """Exchange two files or folders at once; False where the system cannot, FileNotFoundError when one is missing."""
    return _renamed(first, second, EXCHANGE)


def _renamed(source: Path, target: Path, flag: int) -> bool:
    """Whether renameat2 did it; False where the system lacks it, OSError when it failed."""
    call = _renameat2()
    if call is None:
        return False
    if call(AT_FDCWD, os.fsencode(source), AT_FDCWD, os.fsencode(target), flag) == 0:
        return True
    number = ctypes.get_errno()
    if number in UNSUPPORTED:
        return False
    raise OSError(number, os.strerror(number), str(source), None, str(target))


@cache
def _renameat2() -> Any:
    """Linux's renameat2; None on other systems."""
    try:
        call = ctypes.CDLL(None, use_errno=True).renameat2
    except (AttributeError, OSError):
        return None
    call.argtypes = (ctypes.c_int, ctypes.c_char_p, ctypes.c_int, ctypes.c_char_p, ctypes.c_uint)
    return call


def _stamp(path: Path) -> tuple[int, ...]:
    about = path.lstat()
    return about.st_dev, about.st_ino, about.st_size, about.st_mtime_ns
