"""User files that a script names by whole paths or on PATH, and libraries that a program is linked with."""

import os
import re
import shutil
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path

from uavbench.bench.inputs.file_paths import is_file
from uavbench.trajectories.sources.digests import stamp

SYSTEM = ("/usr", "/bin", "/sbin", "/lib", "/lib64", "/etc", "/nix", "/gnu", "/dev", "/proc", "/sys")
"""System folders; programs in them are not tracked as inputs."""
LARGEST_PROGRAM = 1 << 28
"""Number of bytes of a program that are searched for the names of its libraries."""
WORD = re.compile(r"[^\s\"'`$(){}\[\];|&<>=,:*?!#\\]+")
ELF = b"\x7fELF"
RUN_PATH = re.compile(rb"\0((?:/|\$ORIGIN|\$\{ORIGIN\})[\x20-\x7e]{0,4095})(?=\0)")


def named_anywhere(text: str) -> Iterator[Path]:
    """User files that a script names by absolute paths, or as programs on PATH."""
    yield from whole_paths(text)
    found = (shutil.which(word) for word in {*WORD.findall(text)} if "/" not in word)
    yield from (Path(at).absolute() for at in found if at and not of_system(Path(at)))


def linked_with(path: Path) -> tuple[Path, ...]:
    """Shared libraries that a user's program names, in its folder, in a `lib` folder beside it, or on its run path."""
    try:
        return _linked(path, stamp(path)) if is_file(path) and not of_system(path) else ()
    except OSError:
        return ()


def whole_paths(text: str) -> Iterator[Path]:
    """User files that a text names by their whole paths, or from the user's home."""
    words = (Path(os.path.expanduser(word)) for word in (text, *WORD.findall(text)))  # noqa: PTH111, raises nothing
    return (path for path in words if path.is_absolute() and is_file(path) and not of_system(path))


def of_system(path: Path) -> bool:
    """Whether a path is in a system folder; links are not followed."""
    return os.path.normpath(path.absolute()).startswith(tuple(f"{folder}/" for folder in SYSTEM))


@lru_cache(maxsize=1000)
def _linked(path: Path, _: tuple[int, ...]) -> tuple[Path, ...]:
    with path.open("rb") as file:
        if file.read(4) != ELF:
            return ()
        data = ELF + file.read(LARGEST_PROGRAM)
    here = str(path.resolve().parent)
    places = [here, f"{here}/../lib"]
    for text in RUN_PATH.findall(data):
        told = os.fsdecode(text).replace("${ORIGIN}", here).replace("$ORIGIN", here)
        places += told.split(":")
    found: list[Path] = []
    for place in dict.fromkeys(map(os.path.normpath, places)):
        folder = Path(place)
        if of_system(folder / "x") or not folder.is_dir():
            continue
        libraries = (each for each in sorted(folder.iterdir()) if ".so" in each.name and is_file(each))
        found += [each for each in libraries if os.fsencode(each.name) in data]
    return tuple(found)
