"""Atomic writing of files and folders, which overwrites only output of uavbench.

Proof of origin is a seal at the end of a file (`seals`), the digest of a file in the sealed list of its folder
(`listed`), or a job's record of what it wrote (`owning`).
"""

import errno
import json
import os
import stat
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from functools import wraps
from pathlib import Path
from typing import Concatenate, ParamSpec

from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.listed import Listed, file_digest, mark, tree
from uavbench.trajectories.files.seals import is_sealed, seal
from uavbench.trajectories.files.temporary_names import temporary

P = ParamSpec("P")
_owned: ContextVar[frozenset[Path]] = ContextVar("owned", default=frozenset())
_written: ContextVar[set[Path] | None] = ContextVar("written", default=None)
_unfinished: set[Path] = set()
"""Temporary folders of this process; files in them need no temporary name of their own."""


@contextmanager
def new_file(path: Path, *, sealed: bool = False, beside: Path | None = None) -> Iterator[Path]:
    """Temporary path next to `path`; renamed to it on success, removed on any error.

    sealed: append a seal, so that the file may be overwritten later, and so may `beside`, which has no seal of its own.
    UserError when `path` exists and was not written by uavbench.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    if not _unfinished.isdisjoint(path.parents):
        try:
            yield path
        except BaseException:
            path.unlink(missing_ok=True)
            raise
        return
    refuse_foreign_file(path)
    with temporary(path) as own:
        own.made.touch(mode=0o600, exist_ok=False)
        yield own.made
        if sealed:
            seal(own.made, beside)
        own.made.chmod(0o644)
        _sync(own.made)
        refuse_foreign_file(path)
        own.made.replace(path)
        _sync(path.parent)
    _note([path])


@contextmanager
def new_folder(path: Path, marker: str = "") -> Iterator[Path]:
    """Temporary folder next to `path`; replaces `path` on success, removed on any error.

    marker: JSON file of the folder that lists its files; without one an existing folder is never replaced. UserError
    when `path` holds a file that uavbench did not write, or that was edited since.
    """
    refuse_foreign(path, marker)
    path.parent.mkdir(parents=True, exist_ok=True)
    with temporary(path) as own:
        with _making(own.made):
            yield own.made
        if marker:
            mark(own.made, marker)
        for name in tree(own.made):
            _sync(own.made / name)
        own.made.chmod(0o755)
        _sync(own.made)
        _set_aside(path, own.replaced, marker)
        try:
            own.made.rename(path)
        except BaseException:
            if own.replaced.exists() and not path.exists():
                own.replaced.rename(path)
            raise
        _sync(path.parent)
    _note(path / name for name in tree(path))


def _set_aside(folder: Path, to: Path, marker: str) -> None:
    """Rename a folder, if there is one; UserError, with the folder back in place, when it holds a foreign file.

    Its files are checked after it was renamed: one that is put into it during the check would be deleted with the rest.
    """
    _refuse_link(folder)
    _refuse_no_folder(folder)
    if not folder.exists():
        return
    folder.rename(to)
    here, there = folder.absolute(), to.absolute()
    with owning(there / path.relative_to(here) for path in _owned.get() if path.is_relative_to(here)):
        name = next(foreign(to, marker), None)
    if name is not None:
        to.rename(folder)
        raise _foreign_error(folder, name)


@contextmanager
def new_parts(folder: Path, marker: str) -> Iterator[Path]:
    """Temporary folder in `folder`; on success its files move to `folder`, and those of the previous run are removed.

    marker: JSON file that lists them; while they are moved it carries no content hash. UserError, before anything is
    changed, naming a file in the way that uavbench did not write.
    """
    _refuse_no_folder(folder)
    folder.mkdir(parents=True, exist_ok=True)
    with temporary(folder / Path(marker).stem) as own:
        with _making(own.made):
            yield own.made
        _place(own.made, folder, marker)


def in_parts(
    marker: str,
) -> Callable[[Callable[Concatenate[Path, P], Path]], Callable[Concatenate[Path, P], Path]]:
    """Decorator of a function that writes into a folder and returns a path in it: it writes through `new_parts`."""

    def decorate(write: Callable[Concatenate[Path, P], Path]) -> Callable[Concatenate[Path, P], Path]:
        @wraps(write)
        def whole(folder: Path, /, *args: P.args, **options: P.kwargs) -> Path:
            with new_parts(folder, marker) as new:
                written = write(new, *args, **options)
            return folder / written.relative_to(new)

        return whole

    return decorate


def write_text(path: Path, text: str, *, sealed: bool = False) -> None:
    """Write `text` as UTF-8 atomically; see `new_file`."""
    with new_file(path, sealed=sealed) as new:
        new.write_text(text, encoding="utf-8", newline="\n")


def refuse_foreign(folder: Path, marker: str) -> None:
    """UserError when `folder` is not a folder, or has content not written by uavbench; names the first such file."""
    _refuse_link(folder)
    _refuse_no_folder(folder)
    for name in foreign(folder, marker):
        raise _foreign_error(folder, name)


def _foreign_error(folder: Path, name: str) -> UserError:
    return UserError(
        f"{folder}: contains {name}, which uavbench did not write or which was edited since; move it, or choose an "
        "empty or new folder"
    )


def _refuse_link(folder: Path) -> None:
    if folder.is_symlink():
        raise UserError(f"{folder}: is a link; name the folder itself, or a new one")


def _refuse_no_folder(folder: Path) -> None:
    if os.path.lexists(folder) and not folder.is_dir():
        raise UserError(f"{folder}: is a file; name a folder to write to")


def foreign(folder: Path, marker: str) -> Iterator[str]:
    """Names in a folder of files not written by uavbench."""
    if not folder.is_dir():
        return
    listed = Listed.of(folder / marker) if marker else Listed()
    for name in tree(folder):
        path = folder / name
        regular = not path.is_symlink() and _is_regular(path)
        if not ((regular and _is_ours(path)) or listed.holds(folder, name)):
            yield name


def refuse_foreign_file(path: Path) -> None:
    """UserError when `path` exists and is not an unmodified file of uavbench."""
    if not os.path.lexists(path):
        return
    if not _is_regular(path):
        raise UserError(f"{path}: is a folder, a link or a device; name a file to write to")
    if not _is_ours(path):
        raise UserError(f"{path}: exists and is not an unmodified file of uavbench; move it, or choose another name")


@contextmanager
def owning(paths: Iterable[Path]) -> Iterator[None]:
    """Allow writes in this context to overwrite these files, which are known to be ours by other means."""
    token = _owned.set(_owned.get() | {path.absolute() for path in paths})
    try:
        yield
    finally:
        _owned.reset(token)


@contextmanager
def noting() -> Iterator[set[Path]]:
    """Set of the files written in this context, filled as they are renamed."""
    written: set[Path] = set()
    token = _written.set(written)
    try:
        yield written
    finally:
        _written.reset(token)


def _note(paths: Iterable[Path]) -> None:
    if (written := _written.get()) is not None:
        written.update(path.absolute() for path in paths)


def _is_ours(path: Path) -> bool:
    return path.absolute() in _owned.get() or is_sealed(path)


def _is_regular(path: Path) -> bool:
    return stat.S_ISREG(path.lstat().st_mode)


@contextmanager
def _making(folder: Path) -> Iterator[None]:
    folder.mkdir(mode=0o700)
    _unfinished.add(folder)
    try:
        yield
    finally:
        _unfinished.discard(folder)


def _place(new: Path, folder: Path, marker: str) -> None:
    """Move the files of `new` to their places, the marker last."""
    mark(new, marker)
    names = [name for name in tree(new) if name != marker]
    listed = Listed.of(folder / marker)
    before = {name: file_digest(folder / name) for name in listed.files if listed.holds(folder, name)}
    with owning(folder / name for name in before):
        for name in (*names, marker):
            _refuse_foreign_place(folder, name)
        coming = {"files": {name: file_digest(new / name) for name in names}, "before": before}
        write_text(folder / marker, json.dumps(coming, indent=1, sort_keys=True) + "\n", sealed=True)
        for name in (*names, marker):
            target = folder / name
            target.parent.mkdir(parents=True, exist_ok=True)
            _sync(new / name)
            refuse_foreign_file(target)
            (new / name).replace(target)
        for name in before.keys() - set(names):
            (folder / name).unlink(missing_ok=True)
            with suppress(OSError):  # the last file of its folder
                (folder / name).parent.rmdir()
    for below in {(folder / name).parent for name in names} | {folder}:
        _sync(below)
    _note(folder / name for name in (*names, marker))


def _refuse_foreign_place(folder: Path, name: str) -> None:
    """UserError when a file `name` cannot be put into `folder`: which must be unused or an unmodified file of ours."""
    for above in (folder / name).parents:
        if above == folder:
            break
        if os.path.lexists(above) and not above.is_dir():
            raise UserError(f"{above}: exists and is not a folder; move it")
    refuse_foreign_file(folder / name)


def _sync(path: Path) -> None:
    """Flush a file or folder to disk, where the file system supports it; links are skipped."""
    if path.is_symlink():
        return
    handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
    try:
        os.fsync(handle)
    except OSError as error:
        if error.errno not in (errno.EINVAL, errno.ENOTSUP):
            raise
    finally:
        os.close(handle)


__all__ = [
    "foreign", "in_parts", "mark", "new_file", "new_folder", "new_parts", "noting", "owning", "refuse_foreign",
    "refuse_foreign_file", "tree", "write_text",
]  # fmt: skip
