"""Cache of the imports of source files, next to the kernels: parsing them takes half a second per process."""

import contextlib
import hashlib
import json
import platform
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path

from uavbench.trajectories.files.temporary_names import temporary
from uavbench.trajectories.sources import parsed_source

FILE = "imports.json"
MOST_KEPT = 5000
"""Most source files with cached imports, over a megabyte; the sources of all trackers are 300."""

BROKEN = (OSError, ValueError, TypeError, AttributeError, RecursionError)
"""Exceptions raised when reading a missing or damaged file."""


@contextlib.contextmanager
def remembered(place: Callable[[str], Path | None]) -> Iterator[None]:
    """Context with the cached imports of all processes, which stores the imports parsed within it.

    place returns the folder of a key, None if nothing can be cached. Imports are keyed by the content of a file.
    """
    folder = place(_key())
    if folder is not None:
        _recall(folder / FILE)
    known = len(parsed_source.known_imports)
    yield
    if folder is not None and len(parsed_source.known_imports) > known:
        _keep(folder / FILE)


@cache
def _key() -> str:
    """Hash of the import parser: of its source file and of Python."""
    how = parsed_source.content_of(Path(parsed_source.__file__)) + platform.python_version().encode()
    return hashlib.sha256(how).hexdigest()[:32]


@cache
def _recall(path: Path) -> None:
    with contextlib.suppress(*BROKEN):  # the imports are parsed and stored again
        kept = {key: _names(value) for key, value in json.loads(path.read_bytes()).items()}
        parsed_source.known_imports.update(kept)


def _names(kept: object) -> tuple[str, ...]:
    if not isinstance(kept, list) or not all(isinstance(name, str) for name in kept):
        raise TypeError("not names of modules")
    return tuple(kept)


def _keep(path: Path) -> None:
    newest = list(parsed_source.known_imports.items())[-MOST_KEPT:]
    with contextlib.suppress(OSError), temporary(path) as own:
        own.made.write_text(json.dumps(dict(newest)), encoding="utf-8")
        own.made.replace(path)  # in a folder of ours; whichever process is last, its imports are correct
