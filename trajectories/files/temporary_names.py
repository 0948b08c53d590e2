"""Temporary names with an owner, and the removal of leftovers of killed processes.

`.NAME-uavbench-TOKEN.owner` is created before `.NAME-uavbench-TOKEN`: a dangling symbolic link whose target names the
token and the process. Links are created atomically, so every name with a token belongs to the process in its link; the
link is removed last. Only names with the token of a dead process are ever removed.
"""

import contextlib
import errno
import hashlib
import os
import re
import secrets
import shutil
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from uavbench.trajectories.errors import DISK_ERRORS

OWNER = re.compile(r"\..*-uavbench-([0-9a-f]{32})\.owner", re.DOTALL)
TEMPORARY = re.compile(r"\..*-uavbench-[0-9a-f]{32}(\..*)?", re.DOTALL)
LONGEST = 40
"""Characters of a name that its temporary name repeats, so that the whole stays below 255 bytes."""

LONGEST_OWNER = 200
"""Maximum length of the target of an owner link, in characters."""


@dataclass(frozen=True)
class Temporary:
    """Temporary names next to a path that belong to this process: for the new content, and for what it replaces."""

    made: Path
    replaced: Path


@contextmanager
def temporary(path: Path, told: Path | None = None) -> Iterator[Temporary]:
    """Temporary names next to `path`, removed on exit; a disk error in the context names the path itself, or `told`."""
    token = secrets.token_hex(16)
    stem = f".{path.name[:LONGEST]}-uavbench-{token}"
    owner = path.with_name(f"{stem}.owner")
    own = Temporary(path.with_name(stem + path.suffix[: LONGEST // 2]), path.with_name(f"{stem}.replaced"))
    text = f"uavbench {_machine()} {os.getpid()} {start_ticks(os.getpid())} {token}"
    try:
        owner.symlink_to(text)
    except OSError as error:
        if error.errno not in (errno.EPERM, errno.ENOTSUP, errno.ENOSYS):
            raise
        owner.write_text(text, encoding="ascii")  # file systems without links
    try:
        yield own
    except OSError as error:
        if error.errno in DISK_ERRORS:
            error.filename = str(error.filename or told or path).replace(str(own.made), str(told or path))
        raise
    finally:
        if _remove(own.made) and _remove(own.replaced):
            owner.unlink(missing_ok=True)


def is_temporary(name: str) -> bool:
    """Whether a name has the form of these temporary names."""
    return TEMPORARY.fullmatch(name) is not None


def remove_leftovers(folder: Path, *, alone: bool) -> None:
    """Remove temporary files of dead processes from a folder, not from its subfolders.

    alone: no other process works there, so that owners on other machines are dead too. Safe to run concurrently.
    """
    try:
        names = os.listdir(folder)  # noqa: PTH208 - a folder of thousands of names
    except (FileNotFoundError, NotADirectoryError):
        return
    for name in names:
        found = OWNER.fullmatch(name)
        if found is None or not _is_dead(folder / name, found[1], alone):
            continue
        of_it = [other for other in names if other.startswith(name.removesuffix(".owner")) and other != name]
        gone = [_remove(folder / other) for other in of_it]
        if all(gone):
            (folder / name).unlink(missing_ok=True)


def _is_dead(owner: Path, token: str, alone: bool) -> bool:
    """Whether this owner link names a process that has ended."""
    try:
        text = str(owner.readlink()) if owner.is_symlink() else owner.read_bytes()[:LONGEST_OWNER].decode("ascii")
        ours, machine, pid, start, named = text.split(" ")
    except (OSError, ValueError):
        return False
    if ours != "uavbench" or named != token or not pid.isdecimal():
        return False
    return alone if machine != _machine() else start_ticks(int(pid)) != start


def start_ticks(pid: int) -> str:
    """Start time of a process in kernel ticks, since its number may be reused; "" for a dead one."""
    try:
        text = Path(f"/proc/{pid}/stat").read_text(encoding="ascii", errors="replace")
    except OSError:
        return "" if Path("/proc/self/stat").exists() or not _answers(pid) else "running"
    state, *fields = text.rpartition(")")[2].split()
    return "" if state in "ZX" else fields[18]


def _answers(pid: int) -> bool:
    """Whether a process with this number exists, for systems without `/proc`."""
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        pass
    return True


@cache
def _machine() -> str:
    """Identifies this machine since its boot, and the namespace of its process numbers."""
    about = [socket.gethostname()]
    with contextlib.suppress(OSError):
        about.append(Path("/proc/sys/kernel/random/boot_id").read_text(encoding="ascii"))
        about.append(str(Path("/proc/self/ns/pid").readlink()))
    return hashlib.sha256("|".join(about).encode()).hexdigest()[:16]


def _remove(path: Path) -> bool:
    """Remove a file or folder; returns whether it is gone."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, onerror=_make_writable)
    else:
        path.unlink(missing_ok=True)
    return not os.path.lexists(path)


def _make_writable(remove: object, name: str, error: object) -> None:
    """Retry a removal with write permission; a file that another process has removed meanwhile is not an error."""
    with contextlib.suppress(OSError):
        Path(name).parent.chmod(0o700)
        if Path(name).is_dir() and not Path(name).is_symlink():
            Path(name).chmod(0o700)
            shutil.rmtree(name, ignore_errors=True)
        else:
            Path(name).unlink(missing_ok=True)
