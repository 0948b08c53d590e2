"""Atomic writing of files and folders, which overwrites only output of uavbench of the same kind (`origin`)."""

import errno
import json
import os
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from functools import partial, wraps
from pathlib import Path
from typing import Concatenate, ParamSpec

from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.folders import make_folder
from uavbench.trajectories.files.listed import Listed, Marker, file_digest, is_file_of, mark, tree
from uavbench.trajectories.files.origin import (
    foreign,
    foreign_error,
    owning,
    owning_renamed,
    refuse_foreign,
    refuse_foreign_file,
    refuse_no_folder,
    refuse_within_whole,
)
from uavbench.trajectories.files.placing import put_file, rename_new, take_away
from uavbench.trajectories.files.seals import seal
from uavbench.trajectories.files.temporary_names import clean_once, temporary

P = ParamSpec("P")
_written: ContextVar[set[Path] | None] = ContextVar("written", default=None)
_unfinished: set[Path] = set()
"""Temporary folders of this process; files in them need no temporary name of their own."""


@contextmanager
def new_file(path: Path, *, kind: str = "", beside: Path | None = None) -> Iterator[Path]:
    """Temporary path next to `path`; renamed to it on success, removed on any error.

    kind: what the file is (`camera calibration`); it is sealed as that, so that the same kind may overwrite it later,
    and `beside`, which has no seal of its own. UserError when `path` exists and is not an unmodified file of this kind.
    """
    if not _unfinished.isdisjoint(path.parents):
        make_folder(path.parent)
        try:
            yield path
        except BaseException:
            path.unlink(missing_ok=True)
            raise
        return
    refuse_foreign_file(path, kind)
    with temporary(path) as own:
        own.made.touch(mode=0o600, exist_ok=False)
        yield own.made
        if kind:
            seal(own.made, kind, beside)
        own.made.chmod(0o644)
        _sync(own.made)
        put_file(own.made, path, lambda at: refuse_foreign_file(path, kind, at))
        _sync(path.parent)
    _note([path])


@contextmanager
def new_folder(path: Path, marker: Marker | None = None) -> Iterator[Path]:
    """Temporary folder next to `path`; replaces `path` on success, removed on any error.

    marker: lists the files of the folder; without one only an empty folder is replaced. UserError when `path` holds a
    file that uavbench did not write as part of a folder of this kind, or that was edited since, and when it lies in a
    folder that is checked as a whole.
    """
    refuse_within_whole(path)
    clean_once(path.parent)  # first, because it may put back what a killed process had set aside
    refuse_foreign(path, marker)
    with temporary(path) as own:
        with _making(own.made):
            yield own.made
        if marker is not None:
            mark(own.made, marker)
        names = list(tree(own.made))
        for name in names:
            _sync(own.made / name)
        own.made.chmod(0o755)
        for below in {own.made, *((own.made / name).parent for name in names)}:
            _sync(below)
        _set_aside(path, own.replaced, marker)
        try:
            rename_new(own.made, path)
        except FileExistsError:
            raise _made_meanwhile(path) from None
        _sync(path.parent)
    _note(path / name for name in tree(path))


def _made_meanwhile(folder: Path) -> UserError:
    return UserError(f"{folder}: was made by something else meanwhile; choose another folder")


def _set_aside(folder: Path, to: Path, marker: Marker | None) -> None:
    """Rename a folder, if there is one; UserError, with the folder back in place, when it holds a foreign file.

    Its files are checked after it was renamed: one that is put into it during the check would be deleted with the rest.
    """
    refuse_no_folder(folder)
    if not folder.exists():
        return

    def refuse(at: Path) -> None:
        with owning_renamed(folder, at):
            for name in foreign(at, marker):
                if marker is None:  # it was empty, or not there, when the writing began
                    raise _made_meanwhile(folder)
                raise foreign_error(folder, name, marker, at)

    take_away(folder, to, refuse)


@contextmanager
def new_parts(folder: Path, marker: Marker) -> Iterator[Path]:
    """Temporary folder in `folder`; on success its files move to `folder`, and those of the previous run are removed.

    marker: lists them; while they are moved it carries no content hash. UserError, before anything is changed, naming a
    file in the way that uavbench did not write as a part of this kind, or a folder, this or one above, that is checked
    as a whole.
    """
    refuse_within_whole(folder / marker.name)
    if not folder.is_dir():  # a link to a folder may be named
        refuse_no_folder(folder)
    with temporary(folder / Path(marker.name).stem, folder) as own:
        with _making(own.made):
            yield own.made
        _place(own.made, folder, marker)


def in_parts(
    marker: Marker,
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


def write_text(path: Path, text: str, *, kind: str = "") -> None:
    """Write `text` as UTF-8 atomically; see `new_file`."""
    with new_file(path, kind=kind) as new:
        new.write_text(text, encoding="utf-8", newline="\n")


@contextmanager
def full_disk_told(path: Path) -> Iterator[None]:
    """Context in which numpy writes arrays into a file: its error of a short write, which has no number, gets one."""
    try:
        yield
    except OSError as error:
        if error.errno is not None:
            raise
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path)) from error


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


@contextmanager
def _making(folder: Path) -> Iterator[None]:
    folder.mkdir(mode=0o700)
    _unfinished.add(folder)
    try:
        yield
    finally:
        _unfinished.discard(folder)


def _place(new: Path, folder: Path, marker: Marker) -> None:
    """Move the files of `new` to their places, the marker last."""
    mark(new, marker)
    names = [name for name in tree(new) if name != marker.name]
    listed = Listed.of(folder, marker)
    before = {name: file_digest(folder / name) for name in listed.files if listed.holds(folder, name)}
    with owning(folder / name for name in before):
        for name in (*names, marker.name):
            _refuse_foreign_place(folder, name, marker.kind)

    def refuse(at: Path, name: str) -> None:
        if name not in before or not is_file_of(at, before[name]):
            refuse_foreign_file(folder / name, marker.kind, at)

    coming = {"files": {name: file_digest(new / name) for name in names}, "before": before}
    write_text(folder / marker.name, json.dumps(coming, indent=1, sort_keys=True) + "\n", kind=marker.kind)
    for name in (*names, marker.name):
        target = folder / name
        target.parent.mkdir(parents=True, exist_ok=True)
        _sync(new / name)
        put_file(new / name, target, partial(refuse, name=name))
    for name in before.keys() - set(names):
        (new / name).parent.mkdir(parents=True, exist_ok=True)
        with suppress(FileNotFoundError, UserError):  # removed or changed meanwhile
            take_away(folder / name, new / name, partial(refuse, name=name))
        with suppress(OSError):  # the last file of its folder
            (folder / name).parent.rmdir()
    for below in {(folder / name).parent for name in names} | {folder}:
        _sync(below)
    _note(folder / name for name in (*names, marker.name))


def _refuse_foreign_place(folder: Path, name: str, kind: str) -> None:
    """UserError when a file `name` cannot be put into `folder`: which must be unused or an unmodified file of ours."""
    for above in (folder / name).parents:
        if above == folder:
            break
        if os.path.lexists(above) and not above.is_dir():
            raise UserError(f"{above}: exists and is not a folder; move it")
    refuse_foreign_file(folder / name, kind)


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
