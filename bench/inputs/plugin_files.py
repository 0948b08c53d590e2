"""Files and distributions of a user's plug-in whose change may change its behaviour."""

import os
import re
import sys
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import fields
from functools import cache
from importlib.metadata import PackageNotFoundError, distribution, distributions
from pathlib import Path, PurePath
from typing import Any

from uavbench.bench.inputs.file_paths import is_file
from uavbench.bench.inputs.library_builds import ANY_FILE, recorded
from uavbench.bench.inputs.named_files import folders_of, is_python, named_files, named_from
from uavbench.trajectories.sources.dependencies import MadeOf, made_of
from uavbench.trajectories.sources.digests import digest
from uavbench.trajectories.sources.module_files import is_ours, source_file
from uavbench.trajectories.sources.parsed_source import texts

loaded: dict[str, frozenset[str]] = {}
"""Module of a plug-in -> the modules loaded by importing it."""
OF_THE_SHELL = {"_", "PWD", "OLDPWD", "SHLVL"}
"""Variables that a shell sets anew for each command or folder."""
REQUIRED = re.compile(r"[\w.-]+(?!.*\bextra\b)")
"""Name of a distribution in a requirement that is not of an extra."""
NAMED = re.compile(r"^Name:[ \t]*(\S+)", re.MULTILINE)
"""Name of a distribution in its metadata."""
MODULES = re.compile(r"^\"?([^/.,\"\n]+)(?:/[^\n]*|\.[^/\n]*)?\.(?:py|so)\"?,", re.MULTILINE)
"""Uppermost package, or module in none, of the Python and compiled files in a distribution's record."""
OWN = "uavbench"
"""This distribution, whose code is in the keys of jobs."""
declared: set[Path] = set()
"""Files that suites name as `input_files` of plug-ins."""


def plugin_key(cls: type) -> dict[str, Any]:
    """Hash of a plug-in's files, the variables that they name, and the distributions that it imports.

    Its files are its whole package, all user modules that it imports or that were loaded by importing it, and the files
    named in their source (`named_files`).
    """
    module = cls.__module__
    made = plugins_made_of([module, *loaded.get(module, ())], [module])
    return {
        "files": digest(made.files),
        "variables": variables_named_by(made.files),
        "distributions": _installed({module.partition(".")[0], *made.others}),
    }


def variables_named_by(files: Iterable[Path]) -> dict[str, str]:
    """Environment variables whose names are strings in users' sources, with their values."""
    names = (texts(path) for path in files if is_python(path) and not is_ours(path))
    set_ones = frozenset(os.environ) - OF_THE_SHELL
    return {name: os.environ[name] for name in sorted({name for found in names for name in found & set_ones})}


def plugins_made_of(modules: Iterable[str], plugins: Iterable[str]) -> MadeOf:
    """What modules import and name, and the whole packages of the modules of plug-ins."""
    made = made_of(modules)
    packages = (path for module in plugins for path in _package(module))
    return MadeOf(frozenset({*named_by_plugin(made.files), *packages}), made.others)


def named_by_plugin(files: Iterable[Path]) -> set[Path]:
    """Files of a user's plug-in, and those that they name, also from the folder in which the process runs."""
    found = named_files(files)
    return found | named_from(Path.cwd(), found)


def meant_by(plugin: Any) -> set[Path]:
    """Files that the texts among a user's plug-in's parameters name, under whatever key: `weights = "net.npy"`.

    They are looked up in the folder where the process runs, and in and above that of the source and in folders there,
    as what sources name.
    """
    words = {os.path.expanduser(word) for f in fields(plugin) for word in _texts_in(getattr(plugin, f.name, None))}  # noqa: PTH111, raises nothing
    source = source_file(type(plugin).__module__)
    folders = [] if source is None else folders_of(source)
    inside = (place for folder in folders for place in folder.iterdir() if place.is_dir())
    places = {Path.cwd(), *folders, *(folder.parent for folder in folders), *inside}
    return {path for place in places for word in words - {""} if is_file(path := place / word)}


def _texts_in(value: Any) -> Iterator[str]:
    """The texts of a parameter; nested plug-ins have their own."""
    if isinstance(value, str | PurePath):
        yield str(value)
    elif isinstance(value, Mapping):
        yield from _texts_in([*value.values()])
    elif isinstance(value, list | tuple | set | frozenset):
        yield from (word for part in value for word in _texts_in(part))


def bench_key(cls: type) -> str:
    """Hash of the files of `bench` that a class of this package depends on; lower packages have their own hashes."""
    package = "uavbench.bench"
    own = made_of([cls.__module__], find=lambda name: source_file(name) if name.startswith(f"{package}.") else None)
    return digest(own.files)


def _package(module: str) -> Iterator[Path]:
    """All files of a module's package; only its own file when it is in no package."""
    file = getattr(sys.modules[module], "__file__", None)
    if file is None:
        return
    root = Path(file)
    while (root.parent / "__init__.py").is_file():
        root = root.parent
    yield from files_of(root, whole=True)


def files_of(path: Path, *, whole: bool) -> Iterator[Path]:
    """The file itself, or, for a folder with `whole`, all files in it except hidden and compiled ones."""
    if not (whole and path.is_dir()):
        yield path
        return
    for inner in sorted(path.rglob("*")):
        hidden = any(part == "__pycache__" or part.startswith(".") for part in inner.relative_to(path).parts)
        if not hidden and inner.is_file():
            yield inner


def _installed(names: Iterable[str]) -> dict[str, list[str]]:
    """Versions and files of the distributions that provide modules of these names, and of those that they require."""
    owners = _distributions()
    waiting = [owner for name in names for owner in owners.get(name, ())]
    found: dict[str, list[str]] = {}
    while waiting:
        name = re.sub(r"[-_.]+", "-", waiting.pop()).lower()
        if name in found or name == OWN:
            continue
        try:
            there = distribution(name)
        except PackageNotFoundError:  # for another system, or left out
            continue
        found[name] = [there.version, *sorted(recorded(there, ANY_FILE).values())]
        waiting += [need[0] for line in there.requires or () if (need := REQUIRED.match(line))]
    return found


@cache
def _distributions() -> dict[str, list[str]]:
    """Names of the distributions that provide each uppermost package or module, in the order in which they are found.

    `packages_distributions` makes a path of each of their files, which takes a second.
    """
    owners: dict[str, list[str]] = defaultdict(list)
    for found in distributions():
        name = NAMED.search(found.read_text("METADATA") or found.read_text("PKG-INFO") or "")
        told = (found.read_text("top_level.txt") or "").split()
        if name is not None:
            for module in told or set(MODULES.findall(found.read_text("RECORD") or "")):
                owners[module].append(name[1])
    return dict(owners)
