"""Looks of users' code at the file system: what it opens, lists and starts in this process, by Python's audit events.

A look belongs to the innermost source of a user on the stack, so that what a module caches for the whole process counts
for every plug-in that uses the module. Looks of this package's own code are none. Files that libraries open without
Python, as `cv2.imread` does, raise no event; nor are those of other processes seen, but their commands are.
"""

import glob
import os
import stat
import sys
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType
from typing import Any, NamedTuple

from uavbench.trajectories.sources.module_files import editable, is_ours

BENCH = f"{Path(__file__).parents[2]}{os.sep}"
"""Folder of the code that runs jobs, and that looks at files to compute their keys."""
WRITES = os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_APPEND
"""Flags of opening a file for what is written to it: a result, a log, a cache."""
OF_A_THREAD = ""
"""In place of a source: of a thread that runs a library's function alone."""


class Stamp(NamedTuple):
    """State of a file: size in bytes, times in ns, inode."""

    size: int
    mtime_ns: int
    ctime_ns: int
    inode: int


class Command(NamedTuple):
    """Words of a command, the folder where it was started, and its PYTHONPATH."""

    words: tuple[str, ...]
    folder: str
    python_path: str


@dataclass
class Looks:
    """What one source looked at, all by whole paths.

    files: those opened to be read, as they were when the last task that did so began to read them, None where there was
    none; opened: those of the current task; written: those made, or opened to be written; both: those that may have
    been read and written; lists: folders with the pattern by which their files were listed; commands: those started.
    """

    files: dict[str, Stamp | None] = field(default_factory=dict)
    opened: set[str] = field(default_factory=set)
    written: set[str] = field(default_factory=set)
    both: set[str] = field(default_factory=set)
    lists: set[tuple[str, str]] = field(default_factory=set)
    commands: set[Command] = field(default_factory=set)


by_source: dict[str, Looks] = {}
"""Source of a user -> its looks since this process started."""
_is_watching = False
_whose: dict[str, str | None] = {}
"""Name of a file of code -> the source of a user, `BENCH`, or None for libraries."""


def watch() -> None:
    """Note the looks of users' code from now on in this process."""
    global _is_watching
    if not _is_watching:
        _is_watching = True
        sys.addaudithook(_note)


def looks_of(sources: Iterable[str]) -> Looks:
    """All looks of sources, and of those that they imported in turn."""
    found = Looks()
    waiting = [OF_A_THREAD, *sources]
    done: set[str] = set()
    while waiting:
        source = waiting.pop()
        if source in by_source and source not in done:
            looks = by_source[source]
            found.files |= looks.files
            found.written |= looks.written
            found.both |= looks.both
            found.lists |= looks.lists
            found.commands |= looks.commands
            waiting += looks.files
        done.add(source)
    return found


def forget(files: Iterable[str]) -> None:
    """Take back looks at files, and those of threads: the next task begins."""
    for looks in list(by_source.values()):
        looks.opened.clear()
        for path in looks.files.keys() & files:
            looks.files.pop(path, None)  # another thread may have done so
    by_source.pop(OF_A_THREAD, None)


def stamp_of(path: str) -> Stamp | None:
    """Stamp of a regular file; None for what is none."""
    try:
        about = os.stat(path)  # noqa: PTH116, called at every first look
    except (OSError, ValueError):
        return None
    if not stat.S_ISREG(about.st_mode):
        return None
    return Stamp(about.st_size, about.st_mtime_ns, about.st_ctime_ns, about.st_ino)


def _note(event: str, arguments: tuple[Any, ...]) -> None:
    try:
        look = _LOOKS.get(event)
        if look is None:
            return
        caller = sys._getframe(1)
        source = _source_on(caller)
        if source is not None:
            look(by_source.setdefault(source, Looks()), caller, *arguments)
    except Exception:  # the call itself raises, in its own words; and as Python ends, no name is left here
        return


def _source_on(frame: FrameType | None) -> str | None:
    """The innermost source of a user on a stack; None where this package's own work comes first."""
    while frame is not None:
        name = frame.f_code.co_filename
        if name not in _whose:
            _whose[name] = _owner(name)
        whose = _whose[name]
        if whose is not None:
            return None if whose == BENCH else whose
        frame = frame.f_back
    return OF_A_THREAD


def _owner(name: str) -> str | None:
    if name.startswith(BENCH):
        return BENCH
    path = Path(name)
    return None if name.startswith("<") or is_ours(path) or not editable(path) else os.path.abspath(name)  # noqa: PTH100


def _whole(path: Any) -> str:
    """Whole path of a file name; TypeError for an open file's number, ValueError for what can be no name."""
    name = os.fsdecode(path)
    if "\0" in name:
        raise ValueError("null character")
    return os.path.abspath(name)  # noqa: PTH100, links count as they are named


def _opened(looks: Looks, _: FrameType, path: Any, __: Any, flags: int) -> None:
    name = _whole(path)
    if flags & WRITES:
        looks.written.add(name)
        return
    if flags & os.O_RDWR:
        looks.both.add(name)
    if name not in looks.opened:
        looks.opened.add(name)
        looks.files[name] = stamp_of(name)


def _loaded(looks: Looks, caller: FrameType, path: Any, *_: Any) -> None:
    if path is not None and os.sep in os.fsdecode(path):
        _opened(looks, caller, path, None, os.O_RDONLY)


def _imported(looks: Looks, caller: FrameType, _: Any, path: Any, *__: Any) -> None:
    """Of a compiled module alone: a source is opened, too."""
    _loaded(looks, caller, path)


def _connected(looks: Looks, caller: FrameType, path: Any) -> None:
    if stamp_of(_whole(path)):  # else it is made, or in memory
        _opened(looks, caller, path, None, os.O_RDWR)


def _made(looks: Looks, _: FrameType, path: Any, *__: Any) -> None:
    looks.written.add(_whole(path))


def _renamed(looks: Looks, _: FrameType, __: Any, path: Any, *___: Any) -> None:
    looks.written.add(_whole(path))


def _listed(looks: Looks, caller: FrameType, path: Any = None) -> None:
    if not _is_search(caller):
        looks.lists.add((_whole(os.curdir if path is None else path), "*"))


def _is_search(frame: FrameType | None) -> bool:
    """Whether a folder is listed in search of modules, or of a pattern, which has an event of its own."""
    names = set()
    while frame is not None:
        name = frame.f_code.co_filename
        if name.startswith("<frozen importlib") or f"{os.sep}importlib{os.sep}" in name:
            return True
        if not (name.endswith("glob.py") or Path(name).stem == "pathlib" or Path(name).parent.name == "pathlib"):
            break
        names.add(frame.f_code.co_name)
        frame = frame.f_back
    return bool(names) and not names & {"iterdir", "walk"}


def _globbed(looks: Looks, _: FrameType, folder: Any, pattern: Any) -> None:
    looks.lists.add((_whole(folder), os.fsdecode(pattern)))


def _globbed_below(looks: Looks, caller: FrameType, folder: Any, pattern: Any) -> None:
    _globbed(looks, caller, folder, f"**/{os.fsdecode(pattern)}")


def _globbed_by_text(looks: Looks, _: FrameType, text: Any, __: Any, root: Any, *___: Any) -> None:
    parts = Path(_whole(os.curdir if root is None else root), os.fsdecode(text)).parts
    first = next((k for k, part in enumerate(parts) if glob.has_magic(part)), len(parts) - 1)
    looks.lists.add((_whole(Path(*parts[:first])), str(Path(*parts[first:]))))


def _started(looks: Looks, _: FrameType, program: Any, words: Any, folder: Any, environment: Any) -> None:
    given: Mapping[str, str] = os.environ if environment is None else environment
    each = [words] if isinstance(words, str | bytes | os.PathLike) else [*words]
    each = each or [program]
    path = str(given.get("PYTHONPATH", ""))
    looks.commands.add(Command(tuple(map(os.fsdecode, each)), _whole(os.curdir if folder is None else folder), path))


def _started_by_shell(looks: Looks, caller: FrameType, text: Any) -> None:
    _started(looks, caller, None, ["sh", "-c", text], None, None)


_LOOKS: dict[str, Callable[..., None]] = {
    "open": _opened,
    "import": _imported,
    "ctypes.dlopen": _loaded,
    "sqlite3.connect": _connected,
    "os.mkdir": _made,
    "os.rename": _renamed,
    "os.listdir": _listed,
    "os.scandir": _listed,
    "glob.glob/2": _globbed_by_text,
    "pathlib.Path.glob": _globbed,
    "pathlib.Path.rglob": _globbed_below,
    "subprocess.Popen": _started,
    "os.system": _started_by_shell,
}
