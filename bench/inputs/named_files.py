"""Files that a user's program names without importing them: those in a shell script, and linked libraries.

Nothing is run to find them; more are found rather than fewer.
"""

import os
import re
import shutil
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path

from uavbench.bench.inputs.plugin_files import is_file
from uavbench.trajectories.source_files import stamp

SYSTEM = ("/usr", "/bin", "/sbin", "/lib", "/lib64", "/etc", "/nix", "/gnu", "/dev", "/proc", "/sys")
"""Where no program of the user's lies whose change a result would follow."""
LONGEST_SCRIPT = 1 << 18
"""Bytes: what is longer is data."""
LARGEST_PROGRAM = 1 << 28
"""Bytes of a program that are searched for the names of its libraries."""
WORD = re.compile(r"[^\s\"'`$(){}\[\];|&<>=,:*?!#\\]+")
ELF = b"\x7fELF"
RUN_PATH = re.compile(rb"\0((?:/|\$ORIGIN|\$\{ORIGIN\})[\x20-\x7e]{0,4095})(?=\0)")


def named_in_script(path: Path) -> Iterator[Path]:
    """Files that a text in another language than Python names: beside it, by a whole path, or as a program on PATH."""
    if is_file(path) and not of_system(path):
        for word in _words(path, stamp(path)):
            yield from _meant(word, path)


def linked_with(path: Path) -> tuple[Path, ...]:
    """Shared libraries that a program of the user's names, in its folder, in `lib` beside that, or on its run path."""
    try:
        return _linked(path, stamp(path)) if is_file(path) and not of_system(path) else ()
    except OSError:
        return ()


def whole_paths(text: str) -> Iterator[Path]:
    """Files of the user's that a text names by their whole paths."""
    words = map(Path, WORD.findall(text))
    return (path for path in words if path.is_absolute() and is_file(path) and not of_system(path))


def of_system(path: Path) -> bool:
    """Whether a path is of what the system has installed, links not followed."""
    return os.path.normpath(path.absolute()).startswith(tuple(f"{folder}/" for folder in SYSTEM))


@lru_cache(maxsize=1000)
def _words(path: Path, _: tuple[int, ...]) -> frozenset[str]:
    """Words of a text; none of what cannot be read, is too long or is no text."""
    try:
        with path.open("rb") as file:
            data = file.read(LONGEST_SCRIPT + 1)
    except OSError:
        return frozenset()
    text = "" if len(data) > LONGEST_SCRIPT or b"\0" in data else data.decode("utf-8", "replace")
    return frozenset(WORD.findall(text))


def _meant(word: str, script: Path) -> Iterator[Path]:
    """Files that a word may mean: what follows a variable in it is taken from the script's folder."""
    parts = word.split("/")
    for first in range(len(parts)):
        name = "/".join(parts[first:])
        if name and is_file(there := script.parent / name) and not of_system(there):
            yield Path(os.path.normpath(there))
    if len(parts) == 1 and (at := shutil.which(word)) and not of_system(Path(at)):
        yield Path(at).absolute()


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
