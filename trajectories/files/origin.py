"""Proof that uavbench wrote what stands where it is to write, and errors that name what it did not write.

Proof is a seal of the same kind at the end of a file (`seals`), the digest of a file in the sealed list of its folder
(`listed`), or a job's record of what it wrote (`owning`).
"""

import os
import stat
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path

from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.listed import Listed, Marker, tree
from uavbench.trajectories.files.seals import sealed_kind

WHOLE = ("manifest.json", "record.json")
"""Markers of folders that are checked as a whole, sequences and results: in one, any other file would be foreign."""
_owned: ContextVar[frozenset[Path]] = ContextVar("owned", default=frozenset())


@contextmanager
def owning(paths: Iterable[Path]) -> Iterator[None]:
    """Allow writes in this context to overwrite these files, which are known to be ours by other means."""
    token = _owned.set(_owned.get() | {path.absolute() for path in paths})
    try:
        yield
    finally:
        _owned.reset(token)


@contextmanager
def owning_renamed(folder: Path, to: Path) -> Iterator[None]:
    """Allow in this context what is allowed for the files of a folder for those of a folder that it was renamed to."""
    here, there = folder.absolute(), to.absolute()
    with owning(there / path.relative_to(here) for path in _owned.get() if path.is_relative_to(here)):
        yield


def foreign(folder: Path, marker: Marker | None) -> Iterator[str]:
    """Names in a folder of files that uavbench did not write as part of a folder of this kind."""
    if not folder.is_dir():
        return
    listed = Listed.of(folder, marker) if marker else Listed()
    for name in tree(folder):
        path = folder / name
        ours = _is_regular(path) and (_is_owned(path) or (marker is not None and sealed_kind(path) == marker.kind))
        if not (ours or listed.holds(folder, name)):
            yield name


def refuse_foreign(folder: Path, marker: Marker | None) -> None:
    """UserError when `folder` is not a folder, or has content not written by uavbench as part of a folder of this kind.

    It names the first such file.
    """
    refuse_no_folder(folder)
    for name in foreign(folder, marker):
        raise foreign_error(folder, name, marker)


def foreign_error(folder: Path, name: str, marker: Marker | None, at: Path | None = None) -> UserError:
    """UserError about a file of a folder, `name`, that is not part of a folder of this kind; at: where it lies now."""
    advice = "move it, or choose an empty or new folder"
    found = sealed_kind((at or folder) / marker.name) if marker else None
    if marker is not None and found is not None and found != marker.kind:
        return UserError(f"{folder}: {_other(found, marker.kind)}; {advice}")
    if kind := sealed_kind((at or folder) / name):
        return UserError(f"{folder}: contains {name}, which uavbench wrote as `{kind}`; {advice}")
    return UserError(f"{folder}: contains {name}, which uavbench did not write or which was edited since; {advice}")


def refuse_within_whole(folder: Path) -> None:
    """UserError when a folder above is one that uavbench wrote and checks as a whole, which this one would spoil."""
    for above in folder.absolute().parents:
        for name in WHOLE:
            if sealed_kind(above / name) is not None:
                raise UserError(
                    f"{folder}: lies in {above}, which uavbench wrote and checks as a whole; name a folder outside it"
                )


def refuse_no_folder(folder: Path) -> None:
    """UserError when something other than a folder exists under this name."""
    if folder.is_symlink():
        raise UserError(f"{folder}: is a link; name the folder itself, or a new one")
    if os.path.lexists(folder) and not folder.is_dir():
        raise UserError(f"{folder}: is a file; name a folder to write to")


def refuse_foreign_file(path: Path, kind: str = "", at: Path | None = None) -> None:
    """UserError when `path` exists and is not an unmodified file of uavbench, sealed as of this kind.

    at: where the file lies now, if it was renamed for the check.
    """
    now = at or path
    if not os.path.lexists(now):
        return
    if not _is_regular(now):
        raise UserError(f"{path}: is a folder, a link or a device; name a file to write to")
    if _is_owned(path):
        return
    found = sealed_kind(now)
    if found is None:
        raise UserError(f"{path}: exists and is not an unmodified file of uavbench; move it, or choose another name")
    if not kind or found != kind:
        raise UserError(f"{path}: {_other(found, kind)}; move it, or choose another name")


def _other(found: str, kind: str) -> str:
    """What is wrong with a product of the kind `found` in the place of one of `kind`."""
    if not found:
        return "was written by an earlier version of uavbench, which did not record what it is"
    return f"was written by uavbench as `{found}`" + (f", not as `{kind}`" if kind else "")


def _is_owned(path: Path) -> bool:
    return path.absolute() in _owned.get()


def _is_regular(path: Path) -> bool:
    return stat.S_ISREG(path.lstat().st_mode)
