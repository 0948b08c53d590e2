"""Files that sources and scripts name: data, modules, further scripts; a superset of those used.

A name is looked up in the folder of the source, in the parent folder, and in folders there that the source also names,
so that both `HERE / "data" / "weights.npy"` and `"data/weights.npy"` are found; a source that is a link has the folders
of the link and of the file. A whole path is that of a file of the user. Scripts in languages other than Python may
also name programs on PATH; a program also names the libraries that it is linked with, and a model its materials,
textures and buffers.
"""

import os
import re
from collections.abc import Iterable, Iterator
from fnmatch import fnmatchcase
from functools import lru_cache
from itertools import islice
from pathlib import Path

from uavbench.bench.inputs.elsewhere import linked_with, named_anywhere, whole_paths
from uavbench.bench.inputs.file_paths import is_file
from uavbench.scenes.model_files.referenced_files import parts_of
from uavbench.trajectories.sources.dependencies import made_of
from uavbench.trajectories.sources.digests import stamp
from uavbench.trajectories.sources.module_files import Find, among, is_ours, source_file
from uavbench.trajectories.sources.parsed_source import texts

MOST_BYTES = 1 << 20
"""Largest script or settings file that is searched for names; longer files count as data."""
LONGEST_NAME = 255
"""Longest file name on Linux (NAME_MAX)."""
MOST_FOLDERS = 64
"""Most folders in which the names of one source are looked up."""
WORD = re.compile(r"[\w.+@%~*-]+(?:/[\w.+@%~*-]+)*")
"""Part of a text that may be a file name or a glob pattern."""
PATTERN = re.compile(r"[^*]*\*(?!\*)[^*]*(?:\*(?!\*)[^*]*)*\.\w+")
"""Glob patterns with a suffix: `*.npy`, but neither `*` nor recursive patterns."""
FILLED_IN = re.compile(r"%[-+#0]*\d*(?:\.\d+)?[diouxXeEfFgGcrsa]|\{[^{}]*\}")
"""What `%` and `format` replace by a value: `%03d`, `{}`, `{k:03d}`."""
MODULE_OF = re.compile(r"((?:[^\W\d]\w*\.)+)\*?")
"""Name of a package, a point, and a module that is known at run time only, as in `f"backends.{name}"`."""
MODULES = (".py", "/__init__.py", "/__main__.py")
OTHER_SOURCES = (".js", ".mjs", ".cjs", ".ts", ".lua", ".rb", ".m", ".jl", ".R")
OTHER_MODULES = ("", "/index", "/init")
"""Endings of other languages, and what is before them in the files of their modules: `require("./lib/track")`."""


def named_files(sources: Iterable[Path], find: Find = source_file) -> set[Path]:
    """Files that the user's sources name, and those that they name and import in turn; find: locates modules."""
    known = set(sources)
    waiting = [*known]
    while waiting:
        new = set(map(_without_detours, _named_by(waiting.pop()))) - known
        scripts = [path for path in new if is_python(path)]
        here = among(folders_of(*scripts))
        new |= made_of((), scripts, lambda name, here=here: here(name) or find(name)).files - known  # type: ignore[misc]
        known |= new
        waiting += new
    return known


def is_python(path: Path) -> bool:
    """Whether a file is Python source, by its ending or its first line."""
    if path.suffix == ".py":
        return True
    try:
        with path.open("rb") as file:
            first = file.readline(256)
    except OSError:
        return False
    return first.startswith(b"#!") and b"python" in first


def folders_of(*files: Path) -> list[Path]:
    """Folders of files, and of the files that those among them are links to."""
    return list(dict.fromkeys(path.parent for file in files for path in (file, file.resolve())))


def named_from(folder: Path, sources: Iterable[Path]) -> set[Path]:
    """Files in a folder, or in a folder there, that the user's Python sources name with their endings."""
    words: set[str] = set()
    for source in sources:
        words |= _words(source, stamp(source)) if is_python(source) and not is_ours(source) else frozenset()
    inside = [folder / name for name in sorted(words & _names_in(folder)) if (folder / name).is_dir()]
    named = [word for word in words if Path(word).suffix]
    return {path for place in (folder, *inside[:MOST_FOLDERS]) for word in named if is_file(path := place / word)}


def _without_detours(path: Path) -> Path:
    """The path without `a/..`, unless that is another file because `a` is a link; else paths of circles would grow."""
    short = Path(os.path.normpath(path))
    return short if short == path or (is_file(short) and short.samefile(path)) else path.resolve()


def _named_by(source: Path) -> Iterator[Path]:
    """Files that one source names."""
    words = frozenset() if is_ours(source) else _words(source, stamp(source))
    packages: list[str] = []
    if is_python(source):
        given = frozenset() if is_ours(source) else _texts(source)
        packages = [found[1].replace(".", "/") for found in map(MODULE_OF.fullmatch, given) if found]
        yield from (path for text in given for path in whole_paths(text))
    else:
        yield from named_anywhere(_text(source))
        yield from linked_with(source)
        yield from parts_of(source)
    endings = [*MODULES, *(f"{end}{source.suffix}" for end in OTHER_MODULES if source.suffix in OTHER_SOURCES)]
    folders = list(dict.fromkeys(path for folder in folders_of(source) for path in (folder, folder.parent)))
    for folder in folders:  # grows within the loop
        there = _names_in(folder)
        for package in packages:
            yield from _fitting(folder, there, f"{package}*.py")
        for word in sorted(words):
            for name in (word, f"{source.stem}{word}", *(_of_module(word) + end for end in endings)):
                first = name.partition("/")[0]
                if (first in there or first == "..") and is_file(folder / name):
                    yield folder / name
            more = (place for place in _inside(folder, there, word) if place not in folders)
            folders += islice(more, max(0, MOST_FOLDERS - len(folders)))
            if PATTERN.fullmatch(word):
                yield from _fitting(folder, there, word)


def _of_module(word: str) -> str:
    """Path of a module without its ending: `lib/track` of `lib.track`, and of `./lib/track`."""
    return word.removeprefix("./").replace(".", "/")


def _inside(folder: Path, there: frozenset[str], word: str) -> Iterator[Path]:
    """Folders in a folder that a word names, also as a package, as in `files("mine.data")`."""
    for name in dict.fromkeys((word, word.replace(".", "/"))):
        if name.partition("/")[0] in there and word not in (".", "..") and (folder / name).is_dir():
            yield folder / name


def _fitting(folder: Path, there: frozenset[str], pattern: str) -> Iterator[Path]:
    """Files of a folder whose names match a pattern."""
    if "/" in pattern:
        yield from filter(is_file, folder.glob(pattern))
    else:
        yield from (folder / name for name in there if fnmatchcase(name, pattern) and is_file(folder / name))


def _names_in(folder: Path) -> frozenset[str]:
    try:
        return frozenset(path.name for path in folder.iterdir())
    except OSError:
        return frozenset()


@lru_cache(maxsize=10_000)
def _words(path: Path, _: tuple[int, ...]) -> frozenset[str]:
    """Possible file names in a source: for Python the string literals and their words, else all words."""
    given = _texts(path) if is_python(path) else frozenset({_text(path)})
    words = {text for text in given if not text.startswith("/")}
    for word in {word for text in given for word in WORD.findall(text)}:
        parts = word.split("/")
        words |= {"/".join(parts[k:]) for k in range(len(parts))}  # after $HERE/, or in an f-string
    return frozenset(word for word in words - {"", ".", ".."} if len(word) <= LONGEST_NAME)


def _texts(path: Path) -> frozenset[str]:
    """The string literals of a Python source, also with `*` for each value that `%` or `format` fills in."""
    given = texts(path)
    return given | {FILLED_IN.sub("*", text) for text in given}


def _text(path: Path) -> str:
    """Content of a short text file; "" for any other file."""
    try:
        if path.stat().st_size > MOST_BYTES:
            return ""
        text = path.read_bytes().decode()
    except (OSError, UnicodeDecodeError):
        return ""
    return "" if "\0" in text else text
