"""Refuses to read a file that is not as uavbench wrote it: by the list of a folder above it, or by its own seal.

Files that no sealed list names, as users' own, are read as they are.
"""

import os
from functools import lru_cache
from itertools import islice
from pathlib import Path
from typing import NamedTuple

from uavbench.trajectories.errors import DamagedFileError
from uavbench.trajectories.files.listed import Listed
from uavbench.trajectories.files.seals import is_seal_broken

LISTS = ("manifest.json", "record.json", "report.json", "flights.json", "package.json")
"""Markers of the folders that are read again: of sequences, of results and flights, of reports, and of challenges."""
LEVELS = 4
"""Levels from a file up to the list that names it: `SEQUENCE/cameras/NAME/frames/000000.png` has the most."""
MOST_KNOWN = 100_000
"""Files of which a process remembers that they are whole, about 50 MB: those of 400 runs with their sequences."""


class Stamp(NamedTuple):
    """What changes whenever a file is written: device, inode, size in bytes, mtime and ctime in ns."""

    device: int
    inode: int
    size: int
    mtime_ns: int
    ctime_ns: int


def refuse_damaged(path: Path) -> None:
    """DamagedFileError when a file is not as a sealed list above says, or when the seal of a JSON file is broken."""
    stamp = _stamp(str(path))
    if stamp is None:
        return
    whole = path.absolute()
    if path.suffix == ".json" and _is_seal_broken(str(whole), stamp):
        raise _damaged(path)
    for folder in islice(whole.parents, LEVELS):
        for marker in LISTS:
            listed_at = _stamp(where := f"{folder}/{marker}")
            if listed_at is None or where == str(whole):
                continue
            if folder == whole.parent and _is_seal_broken(where, listed_at):
                raise _damaged(Path(where))
            name = whole.relative_to(folder).as_posix()
            if name in _list(where, listed_at).files and not _is_held(where, listed_at, name, stamp):
                raise _damaged(path)


def _damaged(path: Path) -> DamagedFileError:
    return DamagedFileError(
        f"{path}: is damaged, or was edited since uavbench wrote it; make it again with the command that wrote it, as "
        "`uavbench run` for a suite"
    )


def _stamp(path: str) -> Stamp | None:
    try:
        about = os.stat(path)  # noqa: PTH116 - for every file that is read, twenty names are looked up
    except (OSError, ValueError):
        return None
    return Stamp(about.st_dev, about.st_ino, about.st_size, about.st_mtime_ns, about.st_ctime_ns)


@lru_cache(MOST_KNOWN)
def _is_held(marker: str, listed_at: Stamp, name: str, stamp: Stamp) -> bool:
    return _list(marker, listed_at).holds(Path(marker).parent, name)


@lru_cache(1024)
def _list(marker: str, stamp: Stamp) -> Listed:
    return Listed.read(Path(marker))


@lru_cache(MOST_KNOWN)
def _is_seal_broken(path: str, stamp: Stamp) -> bool:
    return is_seal_broken(Path(path))
