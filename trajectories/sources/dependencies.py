"""Source files that a module depends on: its own and those of everything it imports, except installed libraries."""

import sys
from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from uavbench.trajectories.sources.module_files import Find, source_file
from uavbench.trajectories.sources.parsed_source import imports


@dataclass(frozen=True)
class MadeOf:
    """Editable source files, and the top-level names of all other modules that they import."""

    files: frozenset[Path]
    others: frozenset[str]


def sources(module: str) -> frozenset[Path]:
    """Files of a module and of all that it imports, except the interpreter's and installed libraries."""
    return made_of([module]).files


def made_of(modules: Iterable[str], scripts: Iterable[Path] = (), find: Find | None = None) -> MadeOf:
    """Source files of modules and of scripts, with everything that they import.

    Imports are parsed from the source, including those within functions; modules that cannot be found are skipped.
    Imports under TYPE_CHECKING are ignored, except in a package with `__getattr__`, where they name its lazy
    attributes: these count where the package itself is imported, not where a module of it is.
    """
    find = find or source_file
    found, others = set(scripts), set[str]()
    seen = {(name, True) for name in (*modules, *(name for path in found for name in imports(path, "__main__")))}
    waiting = list(seen)
    while waiting:
        name, asked = waiting.pop()
        needs = _each(parents(name), False)
        if (path := find(name)) is None:
            others.add(name.partition(".")[0])
        else:
            found.add(path)
            needs |= _each(imports(path, name, on_demand=asked), True)
        waiting += needs - seen
        seen |= needs
    return MadeOf(frozenset(found), frozenset(others - sys.stdlib_module_names))


@lru_cache(maxsize=100_000)
def parents(name: str) -> tuple[str, ...]:
    """Parent packages of a module, which are imported before it."""
    above, dot, _ = name.rpartition(".")
    return (above, *parents(above)) if dot else ()


@lru_cache(maxsize=20_000)
def _each(names: tuple[str, ...], asked: bool) -> frozenset[tuple[str, bool]]:
    return frozenset((name, asked) for name in names)
