"""Files of modules by their names, and whether a user may edit them: all but the interpreter's and libraries."""

import importlib.util
import sys
import sysconfig
from collections.abc import Callable, Iterable
from contextlib import suppress
from functools import cache
from importlib.machinery import ModuleSpec, PathFinder
from pathlib import Path

OURS = (Path(__file__).parents[2],)

INSTALLED = tuple(Path(sysconfig.get_path(name)).resolve() for name in ("stdlib", "platstdlib", "purelib", "platlib"))

LIBRARIES = ("site-packages", "dist-packages")
"""Names of library folders, in this environment or in another one on the path."""

Find = Callable[[str], Path | None]
"""Maps the name of a module to its source file; None for installed, built-in and missing modules."""


def source_file(name: str) -> Path | None:
    """File of a module of this project or the user; None when it is installed, built in, or missing.

    Its source, or the library of a compiled module. The module is not imported.
    """
    top = name.partition(".")[0]
    above = getattr(sys.modules.get(top), "__file__", None)
    if _is_of_python(top) or (above is not None and not _may_be_edited(above)):
        return None
    spec = None if name in sys.modules else _spec(name)
    path = getattr(sys.modules.get(name), "__file__", None) or (spec.origin if spec and spec.has_location else None)
    return _path(path) if path is not None and _may_be_edited(path) else None


def among(folders: Iterable[Path]) -> Find:
    """Finder of modules in folders, as by an interpreter with these on its path."""
    roots = tuple(folders)

    def find(name: str) -> Path | None:
        inside = name.replace(".", "/")
        places = (root / f"{inside}{ending}" for root in roots for ending in (".py", "/__init__.py"))
        return next((place for place in places if place.is_file()), None)

    return find


@cache
def editable(path: Path) -> bool:
    """Whether a file belongs neither to the interpreter nor to an installed library."""
    return is_ours(path) or not _installed((path.resolve() if path.is_symlink() else path).parent)


def is_ours(path: Path) -> bool:
    """Whether a file belongs to this project's packages."""
    return _is_ours(path.parent)


def _is_of_python(top: str) -> bool:
    """Whether a name is that of a module of the interpreter, and of no file that users have before it on the path."""
    if top not in sys.stdlib_module_names:
        return False
    file = getattr(sys.modules.get(top), "__file__", None)
    return not _may_be_edited(file) if file else top in sys.modules or top not in _before_pythons(tuple(sys.path))


@cache
def _before_pythons(path: tuple[str, ...]) -> frozenset[str]:
    """Names of the modules in the folders of a path that come before the interpreter's own."""
    found: set[str] = set()
    for folder in map(Path, path):
        if _installed(folder):
            break
        with suppress(OSError):
            there = [inner for inner in folder.iterdir() if inner.suffix == ".py" or (inner / "__init__.py").is_file()]
            found.update(inner.stem for inner in there)
    return frozenset(found)


@cache
def _is_ours(folder: Path) -> bool:
    return any(ours in (folder, *folder.parents) for ours in OURS)


@cache
def _path(file: str) -> Path:
    return Path(file)


def _may_be_edited(file: str) -> bool:
    return editable(_path(file))


@cache
def _installed(folder: Path) -> bool:
    """Whether a folder is one of the interpreter's or of installed libraries, or lies in one."""
    own = folder.resolve()
    return any(above in INSTALLED or above.name in LIBRARIES for above in (own, *own.parents))


def _spec(name: str) -> ModuleSpec | None:
    parent, _, last = name.rpartition(".")
    places: Iterable[str] | None = None
    try:
        if not parent:
            return importlib.util.find_spec(name)
        if parent in sys.modules:
            places = getattr(sys.modules[parent], "__path__", None)
        else:
            above = _spec(parent)
            places = above.submodule_search_locations if above else None
        return None if places is None else PathFinder.find_spec(name, [*places])
    except KeyError:  # a namespace package that is not imported
        spec = ModuleSpec(name, None, is_package=True)
        spec.submodule_search_locations = [str(Path(place, last)) for place in places or ()]
        return spec
    except (ImportError, AttributeError, ValueError):  # sys.modules may hold anything
        return None
