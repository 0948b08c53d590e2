"""Temporary names with an owner, and the removal of leftovers of killed processes.

`.NAME-uavbench-TOKEN.owner` is created before `.NAME-uavbench-TOKEN`: a dangling symbolic link whose target names the
token, the process and the whole NAME. Links are created atomically, so every name with a token belongs to the process
in its link; the link is removed last. Only names with the token of a dead process are ever removed. What a dead process
had set aside to replace it, and did not replace, since what it made is still there, is put back.
"""

import contextlib
import errno
import os
import re
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from uavbench.trajectories.errors import DISK_ERRORS
from uavbench.trajectories.files.folders import folder_for, make_folder
from uavbench.trajectories.files.machines import Machine
from uavbench.trajectories.files.placing import give_back

OWNER = re.compile(r"\..*-uavbench-([0-9a-f]{32})\.owner", re.DOTALL)
TEMPORARY = re.compile(r"\..*-uavbench-[0-9a-f]{32}(\..*)?", re.DOTALL)
LONGEST, LONGEST_SUFFIX = 40, 20
"""Characters of a name, and bytes of a suffix, that a temporary name repeats: it stays below 255 bytes."""
REPLACED = ".replaced"
"""Ending of the temporary name of what is replaced."""
OWNED = ".owner"
"""Ending of the name of an owner."""
LONGEST_OWNER = 1000
"""Maximum length of an owner file in bytes, where the file system has no links."""
_cleaned: set[Path] = set()
"""Folders whose leftovers this process has removed, which takes a listing of each."""


@dataclass(frozen=True)
class Temporary:
    """Temporary names next to a path that belong to this process: for the new content, and for what it replaces."""

    made: Path
    replaced: Path


@contextmanager
def temporary(path: Path, told: Path | None = None) -> Iterator[Temporary]:
    """Temporary names next to `path`, removed on exit; a disk error in the context names the path itself, or `told`.

    The folder is made if it is missing, and removed again where nothing comes in. The first time in a folder, leftovers
    of dead processes are removed from it.
    """
    with folder_for(path, told), _temporary(path, told) as own:
        yield own


@contextmanager
def _temporary(path: Path, told: Path | None) -> Iterator[Temporary]:
    clean_once(path.parent)
    token = secrets.token_hex(16)
    stem = f".{path.name[:LONGEST]}-uavbench-{token}"
    owner = path.with_name(stem + OWNED)
    keeps = path.suffix not in (OWNED, REPLACED) and len(os.fsencode(path.suffix)) <= LONGEST_SUFFIX
    own = Temporary(path.with_name(stem + path.suffix * keeps), path.with_name(stem + REPLACED))
    text = f"uavbench {Machine.here()} {os.getpid()} {start_ticks(os.getpid())} {token} {path.name}"
    try:
        _claim(owner, text)
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(told or path)) from None
    try:
        yield own
    except OSError as error:
        if error.errno in DISK_ERRORS:
            error.filename = str(error.filename or told or path).replace(str(own.made), str(told or path))
        raise
    finally:
        if os.path.lexists(own.made):  # else what was replaced has been
            give_back(own.replaced, path)
        if _remove(own.made) and _remove(own.replaced):
            owner.unlink(missing_ok=True)


def _claim(owner: Path, text: str, first: bool = True) -> None:
    """Create the link of an owner, or a file where the file system has no links."""
    try:
        owner.symlink_to(text)
    except FileNotFoundError:
        if not first and owner.parent.is_dir():  # where nothing can be created, as in `/proc`
            raise NotADirectoryError(errno.ENOTDIR, "no file can be made there") from None
        make_folder(owner.parent)  # another process has made it in vain, and removed it
        _claim(owner, text, first=False)
    except OSError as error:
        if error.errno not in (errno.EPERM, errno.ENOTSUP, errno.ENOSYS):
            raise
        owner.write_bytes(os.fsencode(text))


def is_temporary(name: str) -> bool:
    """Whether a name has the form of these temporary names."""
    return TEMPORARY.fullmatch(name) is not None


def clean_once(folder: Path) -> None:
    """Remove the leftovers in a folder, the first time that this process asks for it; a disk error is ignored."""
    if (absolute := folder.absolute()) in _cleaned:
        return
    _cleaned.add(absolute)
    with contextlib.suppress(OSError):  # a folder that may not be listed; what is to be written tells what is wrong
        remove_leftovers(folder, alone=False)


def remove_leftovers(folder: Path, *, alone: bool) -> None:
    """Remove temporary files of dead processes from a folder, not from its subfolders.

    What such a process had renamed in order to replace it goes back to its name (`give_back`), unless what it had made
    is gone: then that was put there. alone: no other process works there, so that owners on other machines are dead
    too. What may not be removed, as that of another user, stays. Safe to run concurrently.
    """
    try:
        names = os.listdir(folder)  # noqa: PTH208 - a folder of thousands of names
    except (FileNotFoundError, NotADirectoryError):
        return
    for name in names:
        found = OWNER.fullmatch(name)
        owner = None if found is None else Owner.of(folder / name, found[1])
        if owner is None or not owner.is_dead(folder, alone):
            continue
        stem = name.removesuffix(OWNED)
        with contextlib.suppress(OSError):  # it may not be changed, or another process was faster
            now = os.listdir(folder)  # noqa: PTH208 - the process may have ended since the first listing
            of_it = [other for other in now if other.startswith(stem) and other != name]
            if owner.path_name and {*of_it} > {stem + REPLACED}:
                give_back(folder / (stem + REPLACED), folder / owner.path_name)
            gone = [_remove(folder / other) for other in of_it]
            if all(gone):
                (folder / name).unlink()


@dataclass(frozen=True)
class Owner:
    """The process that an owner link names: its machine, number and start, and the path whose temporary names it has.

    path_name: name of the path, "" where an earlier version wrote the link.
    """

    machine: str
    pid: str
    start: str
    path_name: str

    @classmethod
    def of(cls, link: Path, token: str) -> "Owner | None":
        """The owner of this token; None where the link does not name it."""
        try:
            text = os.fsdecode(link.readlink()) if link.is_symlink() else os.fsdecode(link.read_bytes()[:LONGEST_OWNER])
            ours, machine, pid, start, named, *rest = text.split(" ", 5)
        except (OSError, ValueError):
            return None
        path_name = "".join(rest)
        if ours != "uavbench" or named != token or not pid.isdecimal() or path_name in (".", ".."):
            return None
        if "/" in path_name or "\0" in path_name:
            return None
        return cls(machine, pid, start, path_name)

    def is_dead(self, folder: Path, alone: bool) -> bool:
        """Whether the process that worked in a folder has ended; alone: those of other machines have."""
        if self.machine == str(Machine.here()):
            return start_ticks(int(self.pid)) != self.start
        return alone or Machine.of(self.machine).has_booted_since(folder)


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


def _remove(path: Path) -> bool:
    """Remove a file or folder; returns whether it is gone."""

    def make_writable(remove: object, name: str, error: object) -> None:
        """Retry with write permission within the folder; what another process has removed meanwhile is no error."""
        at = Path(name)
        with contextlib.suppress(OSError):
            if at != path:
                at.parent.chmod(0o700)
            if at.is_dir() and not at.is_symlink():
                at.chmod(0o700)
                shutil.rmtree(at, ignore_errors=True)
            else:
                at.unlink(missing_ok=True)

    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, onerror=make_writable)
    else:
        path.unlink(missing_ok=True)
    return not os.path.lexists(path)
