"""Files of a user's plug-in: every file and distribution whose change may change its behaviour."""

import sys
from collections.abc import Iterable, Iterator
from functools import cache
from importlib.metadata import packages_distributions, version
from pathlib import Path
from typing import Any

from uavbench.bench.inputs.named_files import named_files
from uavbench.trajectories.source_files import digest, made_of, source_file

loaded: dict[str, frozenset[str]] = {}
"""Module of a plug-in -> the modules that its import loaded, by whatever way it names them."""


def plugin_key(cls: type) -> dict[str, Any]:
    """Hash of the files that a plug-in is made of, and the versions of the distributions that it imports.

    Files: its whole package, all modules of the user's that it imports or that its import loaded, and the files that
    their source names (`named_files`).
    """
    made = made_of([cls.__module__, *loaded.get(cls.__module__, ())])
    files = {*named_files(made.files), *_package(cls.__module__)}
    return {"files": digest(files), "distributions": _versions({cls.__module__.partition(".")[0], *made.others})}


def bench_key(cls: type) -> str:
    """Hash of the files of this package that a class of it is made of; the packages below have hashes of their own."""
    package = "uavbench.bench"
    own = made_of([cls.__module__], find=lambda name: source_file(name) if name.startswith(f"{package}.") else None)
    return digest(own.files)


def _package(module: str) -> Iterator[Path]:
    """All files of the package that a module lies in; its own file alone where there is no package."""
    file = getattr(sys.modules[module], "__file__", None)
    if file is None:
        return
    root = Path(file)
    while (root.parent / "__init__.py").is_file():
        root = root.parent
    yield from files_of(root, whole=True)


def files_of(path: Path, *, whole: bool) -> Iterator[Path]:
    """The path itself, or, where it is a folder and `whole`, all files in it but hidden and compiled ones."""
    if not (whole and path.is_dir()):
        yield path
        return
    for inner in sorted(path.rglob("*")):
        hidden = any(part == "__pycache__" or part.startswith(".") for part in inner.relative_to(path).parts)
        if not hidden and inner.is_file():
            yield inner


def _versions(names: Iterable[str]) -> dict[str, str]:
    """Versions of the distributions that give modules of these names."""
    owners = _distributions()
    return {owner: version(owner) for name in sorted(names) for owner in sorted(set(owners.get(name, ())))}


@cache
def _distributions() -> dict[str, list[str]]:
    return dict(packages_distributions())
