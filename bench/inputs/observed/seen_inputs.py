"""Record of the inputs that a job was seen to use beyond its key, and whether they are as they were.

What counts is a user's: no file of the installation or the system, of a cache, of temporary files or the suite's
folder, none that a job wrote itself, and none that is gone when it ends. In a name, `//` is where a folder of Python's
search path ends, or the current one: such a folder may be moved.
"""

import glob
import os
import sys
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

from uavbench.bench.inputs.command_files import command_files
from uavbench.bench.inputs.elsewhere import linked_with, of_system
from uavbench.bench.inputs.file_paths import is_file
from uavbench.bench.inputs.observed import looks
from uavbench.trajectories.sources.digests import file_digest
from uavbench.trajectories.sources.module_files import editable, is_ours

ABSENT, CHANGED = "no file", "changed while it was in use"
"""In place of a digest: of a file that was looked for, and of one of which nobody knows what the job has read."""
MOST_LISTED = 1000
"""Most files of a list that count by their content; a longer one is a dataset, of which a job opens what it reads."""
MOVABLE = "//"
INSTALLED = tuple(f"{Path(place)}{os.sep}" for place in {sys.prefix, sys.base_prefix})


@dataclass(frozen=True)
class SeenInputs:
    """Inputs of a job that only its run shows.

    files: digests by name; lists: folder, pattern, and the names that fit, where the job itself wrote none of these.
    """

    files: Mapping[str, str] = field(default_factory=dict)
    lists: tuple[tuple[str, str, tuple[str, ...]], ...] = ()

    @classmethod
    def read(cls, about: Mapping[str, Any]) -> "SeenInputs":
        """Those of a JSON object, as `asdict` makes it."""
        lists = tuple((str(folder), str(pattern), tuple(names)) for folder, pattern, names in about["lists"])
        return cls(dict(about["files"]), lists)

    def are_unchanged(self, root: Path) -> bool:
        """Whether files and lists are as they were; root: the suite's folder, which counts for none."""
        return all(_state(_path(name)) == state for name, state in self.files.items()) and all(
            {*_names(_path(folder), pattern, root)} == {*names} for folder, pattern, names in self.lists
        )


def seen_inputs(known: Iterable[Path], root: Path, begin_ns: int) -> SeenInputs:
    """Inputs of a task that just ended, or of its plug-ins earlier in this process, which its key does not hold.

    known: files of the key, among them the sources of its plug-ins; root: the suite's folder; begin_ns: its time when
    the task began; what was written since is the task's own. None where they cannot be told: the task is done anyway.
    """
    try:
        return _seen(known, root, begin_ns)
    except Exception:  # of a file system, or of names that nobody thought of
        return SeenInputs()


def _seen(known: Iterable[Path], root: Path, begin_ns: int) -> SeenInputs:
    keyed = {os.path.abspath(path) for path in known}  # noqa: PTH100, links count as they are named
    seen = looks.looks_of(keyed)
    libraries = (linked for path in seen.files if ".so" in path for linked in linked_with(Path(path)))
    files = {str(path): looks.stamp_of(str(path)) for path in (*_of_commands(seen.commands), *libraries)} | seen.files

    def is_own(path: str) -> bool:
        then = files.get(path) or looks.stamp_of(path)
        return path in seen.written or (then is not None and then.ctime_ns > begin_ns)

    listed = {(at, pattern): _names(Path(at), pattern, root) for at, pattern in seen.lists if _counts(Path(at), root)}
    # Where a job writes what it lists, as logs with a number, each job would make the others stale.
    listed = {at: names for at, names in listed.items() if not any(is_own(f"{at[0]}{os.sep}{name}") for name in names)}
    for (at, pattern), names in listed.items():
        if len(names) <= MOST_LISTED and not (pattern == "*" and at in _search_path()):
            files = {path: looks.stamp_of(path) for path in _inside(at, names)} | files

    # The digests are of now: whether a file was another one when it was opened, its stamp tells.
    used = [path for path in files if path not in keyed and not is_own(path) and _counts(Path(path), root)]
    places = _movable(keyed)
    digests = {_name(path, places): state for path in used if (state := _read(path, files[path], path in seen.both))}
    lists = sorted((_name(at, places), pattern, tuple(sorted(names))) for (at, pattern), names in listed.items())
    looks.forget({*keyed, *filter(is_own, files)})
    return SeenInputs(dict(sorted(digests.items())), tuple(lists))


def _inside(folder: str, names: Iterable[str]) -> Iterator[str]:
    """Whole paths of the files among names in a folder."""
    paths = (f"{folder}{os.sep}{name}" for name in names)
    return (path for path in paths if looks.stamp_of(path))


def _of_commands(commands: Iterable[looks.Command]) -> set[Path]:
    """Files that commands run, get, name and import; those of one program together: it may be started every frame."""
    together: dict[tuple[str, str, str], list[str]] = {}
    for words, folder, python_path in commands:
        given = together.setdefault((words[0], folder, python_path), [])
        given += [str(path) if is_file(path := Path(folder, word)) else word for word in words[1:]]
    found: set[Path] = set()
    for (program, folder, python_path), given in together.items():
        places = (Path(folder, place) for place in python_path.split(os.pathsep) if place)
        found.update(command_files([program, *given], [Path(folder), *places]))
    return found


def _counts(path: Path, root: Path) -> bool:
    """Whether a file or folder is a user's."""
    others = (os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"), *_temporary())  # noqa: PTH111
    apart = any(path.is_relative_to(other) for other in others) or "__pycache__" in path.parts or _is_in(path, root)
    try:
        return not (apart or of_system(path) or str(path).startswith(INSTALLED) or is_ours(path) or not editable(path))
    except (OSError, RuntimeError):  # a name that is too long, a folder that may not be entered, a circle of links
        return False


def _is_in(path: Path, root: Path) -> bool:
    """Whether a path is in a folder, by its name or behind links."""
    return path.is_relative_to(root.absolute()) or Path(os.path.realpath(path)).is_relative_to(os.path.realpath(root))


def _temporary() -> tuple[str, ...]:
    """The folder of temporary files, unless users' modules are there, as of a project that is tried out."""
    folder = tempfile.gettempdir()
    return () if any(Path(place).is_relative_to(folder) for place in _search_path()) else (folder,)


def _read(path: str, then: looks.Stamp | None, may_be_written: bool) -> str:
    """What a task has read of a file that had this stamp then; "" of one that it has made, written or removed."""
    now = looks.stamp_of(path)
    if now == then:
        return _state(Path(path))
    return "" if now is None or then is None or may_be_written else CHANGED


def _state(path: Path) -> str:
    """Digest of a regular file: a pipe would be waited for."""
    try:
        return file_digest(path) if is_file(path) else ABSENT
    except OSError:
        return ABSENT


def _names(folder: Path, pattern: str, root: Path) -> list[str]:
    """Names in a folder that fit a pattern, but those of hidden files, of compiled ones and of the suite's folder."""
    found = (name for name in _fitting(folder, pattern) if "__pycache__" not in Path(name).parts)
    inside = _is_in(root, folder)
    return [name for name in found if not (inside and _is_in(folder / name, root))]


def _fitting(folder: Path, pattern: str) -> list[str]:
    parts = Path(pattern).parts
    if "**" not in parts:
        return glob.glob(pattern, root_dir=folder)  # noqa: PTH207, which needs no folder that is there
    try:  # not by glob, which follows links in circles
        paths = list(folder.glob(os.path.join(*parts, *(["*"] if parts[-1] == "**" else []))))  # noqa: PTH118, a text
    except (ValueError, NotImplementedError):  # a pattern that pathlib takes for none, as a whole path
        return []
    names = [path.relative_to(folder) for path in paths]
    return [str(name) for name in names if not any(part.startswith(".") for part in name.parts)]


def _search_path() -> tuple[str, ...]:
    """Users' folders from which modules are imported, and the current one; the deepest first."""
    return _sorted_folders(_current(), tuple(place for place in sys.path if isinstance(place, str)))


def _current() -> str:
    try:
        return os.getcwd()  # noqa: PTH109, a text
    except OSError:  # it was removed
        return os.sep


@cache
def _sorted_folders(current: str, path: tuple[str, ...]) -> tuple[str, ...]:
    places = {os.path.join(current, place) for place in ("", *path)}  # noqa: PTH118
    users = {os.path.normpath(place) for place in places if not f"{place}{os.sep}".startswith(INSTALLED)}
    return tuple(sorted(users, key=lambda place: (-len(place), place)))


def _movable(keyed: Iterable[str]) -> list[str]:
    """The current folder, and those of the search path that hold a file of the key: others may be of this process."""
    known = tuple(keyed)
    places = _search_path()
    return [at for at in places if at == _current() or any(path.startswith(f"{at}{os.sep}") for path in known)]


def _name(path: str, places: Iterable[str]) -> str:
    place = next((place for place in places if path.startswith(f"{place}{os.sep}")), None)
    return path if place is None else f"{place}{MOVABLE}{path[len(place) + 1 :]}"


def _path(name: str) -> Path:
    then, _, inside = name.partition(MOVABLE)
    now = _search_path()
    places = [Path(place, inside) for place in now] if inside and then not in now else []
    return next((path for path in places if os.path.exists(path)), Path(name))  # noqa: PTH110, raises nothing
