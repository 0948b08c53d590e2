"""Content hashes: a result is up to date when it carries the hash of all of its inputs."""

import hashlib
import json
import os
import platform
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import Field, fields, is_dataclass
from functools import cache
from pathlib import Path, PurePath
from typing import Any, NamedTuple

import numpy as np

from uavbench.bench.inputs.file_paths import is_file, names_a_file
from uavbench.bench.inputs.library_builds import READ_WITH, build, library_builds
from uavbench.bench.inputs.plugin_files import bench_key, files_of, meant_by, named_by_plugin, plugin_key
from uavbench.bench.inputs.process_environment import process_environment
from uavbench.tracker.run import plain
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.reading import read_json
from uavbench.trajectories.sources.digests import ask, asked_for, file_digest

PACKAGES = {"uavbench"}
INPUT_FILES = "input_files"
PLAIN = {float, int, str, bool, type(None)}
ROOT = Path(__file__).parents[2]
WORK = ROOT / "bench" / "runner" / "tasks.py"
"""Packages that every job uses."""


class Key(NamedTuple):
    """A content hash, and the files whose content it holds."""

    content_hash: str
    files: frozenset[Path]


def key_of(*parts: Any) -> Key:
    """The content hash of values with its files."""
    with asked_for() as files:
        found = content_hash(*parts)
    return Key(found, frozenset(files))


def content_hash(*parts: Any) -> str:
    """sha256 of values in canonical form: plug-ins by class and fields, files by their content."""
    text = json.dumps([canonical(part) for part in parts], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


def canonical(value: Any) -> Any:
    """JSON form of a value; a dataclass includes its class, and for a user's own class the hash of its source."""
    if type(value) in PLAIN:
        return value
    if is_dataclass(value) and not isinstance(value, type):
        return _looked_at(value, lambda: _of_plugin(value))
    if isinstance(value, Mapping):
        return {str(k): canonical(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [canonical(v) for v in value]
    if isinstance(value, np.ndarray):
        return [value.dtype.str, value.shape, hashlib.sha256(value.tobytes()).hexdigest()]
    return plain(value)


@contextmanager
def one_look() -> Iterator[None]:
    """Context that caches the canonical forms of plug-ins, since many jobs share them."""
    _looked.append({})
    try:
        yield
    finally:
        _looked.pop()


_looked: list[dict[int, tuple[Any, Any, set[Path]]]] = []
"""id of a plug-in -> the plug-in, which is thus kept alive, its canonical form and its files; so of the environment."""


def _looked_at(value: Any, form: Callable[[], Any]) -> Any:
    """The form of a value, once in a look."""
    if not _looked:
        return form()
    if id(value) not in _looked[-1]:
        with asked_for() as files:
            found = form()
        _looked[-1][id(value)] = (value, found, files)
    _, found, files = _looked[-1][id(value)]
    ask(files)
    return found


def _of_plugin(value: Any) -> dict[str, Any]:
    """Class, code, fields and files of a dataclass; a field that names a file is replaced by the file's content."""
    cls = type(value)
    form = {f.name: _of_field(value, f) for f in fields(cls)}
    form["class"] = f"{cls.__module__}:{cls.__qualname__}"
    top = cls.__module__.partition(".")[0]
    if cls.__module__.startswith("uavbench.bench."):
        form["code"] = bench_key(cls)
    elif top not in PACKAGES:
        form["code"] = plugin_key(cls)
    given = [*map(Path, getattr(value, INPUT_FILES, ())), *_meant(value)]
    form["entering"] = [file_form(path) for path in (*getattr(value, "entering_files", ()), *given)]
    form["variables"] = [os.environ.get(name, "") for name in getattr(value, "entering_variables", ())]
    for name, path in _paths(value):
        files = [*files_of(path, whole=top not in PACKAGES)]
        form[name] = [file_form(path) for path in files]
        given += files
    if INPUT_FILES in form:
        form[INPUT_FILES] = [Path(name).name for name in form[INPUT_FILES]]
    if top not in PACKAGES:
        form["named"] = sorted(map(file_form, _named_by(given)))
    return form


def _of_field(value: Any, field: Field[Any]) -> Any:
    """Canonical form of a field; None for one that is computed of the others and has none, such as a network."""
    try:
        return canonical(getattr(value, field.name, None))
    except UserError as error:
        if not field.init:
            return None
        cls = type(value)
        raise UserError(f"plug-in {cls.__module__}:{cls.__qualname__}: `{field.name}` {error}") from None


def _meant(value: Any) -> list[Path]:
    """Files that parameters of a user's plug-in name under other keys than those of `_paths` and `input_files`."""
    if type(value).__module__.partition(".")[0] in PACKAGES:
        return []
    known = {*map(Path, getattr(value, INPUT_FILES, ())), *(path for _, path in _paths(value))}
    return sorted(meant_by(value) - known)


def _paths(value: Any) -> Iterator[tuple[str, Path]]:
    """Fields of a dataclass that name files, with their paths."""
    for f in fields(value):
        given = getattr(value, f.name, None)
        if names_a_file(f.name) and given and isinstance(given, str | PurePath):
            yield f.name, Path(given)


def _named_by(given: Iterable[Path]) -> set[Path]:
    """Files that those given to a user's plug-in name."""
    files = set(filter(is_file, given))
    return named_by_plugin(files) - files


def file_form(path: Path) -> list[str]:
    """Name and content of a file, and the library that reads it; its whole path when it is missing or not readable.

    Of a folder the name alone: what counts of its files enters with them.
    """
    library = READ_WITH.get(path.suffix.lower())
    try:
        there = [path.name, "folder"] if path.is_dir() else [str(path), "no file"]
        form = [path.name, file_digest(path)] if is_file(path) else there
    except OSError:
        form = [str(path), "not readable"]
    return form if library is None else [*form, *build(library)]


def contents(value: Any) -> list[list[str]]:
    """Name and digest of each data file that specs and plug-ins name, in order; of a model those that it names, too.

    Of a folder, and of a file that is not there, the name alone: a suite may lie elsewhere on another machine.
    """
    if isinstance(value, Mapping | list | tuple):
        parts = value.values() if isinstance(value, Mapping) else value
        return [form for part in parts for form in contents(part)]
    if not is_dataclass(value) or isinstance(value, type):
        return []
    given = {f.name: getattr(value, f.name, None) for f in fields(value)}
    is_own = type(value).__module__.partition(".")[0] not in PACKAGES
    paths = [*(path for _, path in _paths(value)), *_meant(value)]
    named = (*paths, *getattr(value, "entering_files", ()), *(sorted(_named_by(paths)) if is_own else ()))
    forms = [[path.name, *(file_form(path)[1:2] if is_file(path) else ())] for path in named]
    return [*forms, *contents(given)]


def code_hash(*packages: str) -> str:
    """Hash of the sources of these packages, of the builds of the libraries, and of what the environment makes of them.

    See `process_environment`.
    """
    return content_hash(sources_hash(*packages), _looked_at(process_environment, process_environment))


@cache
def sources_hash(*packages: str) -> str:
    """Hash of the sources of these packages and of the builds of the libraries that they use."""
    python = ".".join(platform.python_version_tuple()[:2])
    under = [python, file_digest(WORK), _builds()]
    digest = hashlib.sha256(json.dumps(under).encode())
    for package in packages:
        for path in sorted((ROOT / package).rglob("*")):
            if path.is_file() and path.parent.name != "__pycache__":
                digest.update(path.relative_to(ROOT).as_posix().encode() + path.read_bytes())
    return digest.hexdigest()


@cache
def _builds() -> list[list[str]]:
    """Builds of the libraries, read once for all sets of packages."""
    return library_builds()


def carried_hash(path: Path) -> str | None:
    """Content hash stored in a JSON file; None when the file is missing or incomplete."""
    try:
        return str(read_json(path)["content_hash"])
    except (UserError, KeyError):
        return None
