"""Source files that a module depends on: its own and those of everything it imports, except installed libraries."""

import ast
import hashlib
import importlib.util
import sys
import sysconfig
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache, lru_cache
from importlib.machinery import ModuleSpec, PathFinder
from pathlib import Path

OURS = (Path(__file__).parents[1],)
INSTALLED = tuple(Path(sysconfig.get_path(name)).resolve() for name in ("stdlib", "platstdlib", "purelib", "platlib"))
LIBRARIES = ("site-packages", "dist-packages")
"""Names of library folders, in this environment or in another one on the path."""

known_imports: dict[str, tuple[str, ...]] = {}
"""Imported names by content of the source file, its package, and whether lazy attributes count."""

_digested: dict[Path, tuple[int, ...]] = {}
"""Every file of which a digest was asked, with its stamp at that time."""
_asking: list[set[Path]] = []
"""Files of which a digest was asked since, for each context that collects them."""
_told_apart: dict[Path, set[Path]] = {}
"""Files whose digests are told apart, with the set of those that were asked for since."""

Find = Callable[[str], Path | None]
"""Maps the name of a module to its source file; None for installed, built-in and missing modules."""


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


def digest(files: Iterable[Path]) -> str:
    """sha256 over the names and contents of files and the names of their folders, not over the tree's location."""
    each = sorted(("/".join(path.parts[-2:]), _content(path)) for path in files)
    return hashlib.sha256(repr(each).encode()).hexdigest()


def file_digest(path: Path) -> str:
    """sha256 of a file's content, read again only when the file has changed; OSError when it cannot be read."""
    ask((path,))
    now = stamp(path)
    _digested[path] = now
    found = _digest(path, now)
    if path in _told_apart:
        _told_apart[path].add(path)
        return f"{found} told apart"
    return found


def touched() -> frozenset[Path]:
    """Files that were written or removed since their last digest, even where they have the same content again."""
    return frozenset(path for path, then in _digested.items() if _stamp_or_none(path) != then)


@contextmanager
def told_apart(paths: Iterable[Path]) -> Iterator[set[Path]]:
    """Context in which the digests of these files differ from those of their content: those that are asked for in it.

    A file that was removed has no digest, and is not among these.
    """
    asked: set[Path] = set()
    _told_apart.update(dict.fromkeys(paths, asked))
    try:
        yield asked
    finally:
        _told_apart.clear()


@contextmanager
def asked_for() -> Iterator[set[Path]]:
    """Context that collects the files of which a digest is asked in it."""
    _asking.append(set())
    try:
        yield _asking[-1]
    finally:
        _asking.pop()


def ask(paths: Iterable[Path]) -> None:
    """Count files as asked for, whose digests are known from before."""
    for asked in _asking:
        asked.update(paths)


def stamp(path: Path) -> tuple[int, ...]:
    """Stamp that changes with a file: modification times, size and inode."""
    about = path.stat()
    return about.st_mtime_ns, about.st_ctime_ns, about.st_size, about.st_ino, about.st_dev


def _stamp_or_none(path: Path) -> tuple[int, ...] | None:
    try:
        return stamp(path)
    except OSError:
        return None


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


def imports(path: Path, name: str, *, on_demand: bool = True) -> tuple[str, ...]:
    """Names of all modules that the source file of the module `name` may import; on_demand: lazy ones too."""
    return _imports(path, stamp(path), name, on_demand)


def imports_in(code: str) -> tuple[str, ...]:
    """Names of all modules that a Python program may import; none where the text is no Python."""
    return _imports_in(_tree(code.encode(errors="replace")), [], on_demand=True)


def texts(path: Path) -> frozenset[str]:
    """All string literals of a source file; `*` stands for each value of an f-string."""
    return _texts(path, stamp(path))


def is_ours(path: Path) -> bool:
    """Whether a file belongs to this project's packages."""
    return _is_ours(path.parent)


@cache
def _is_ours(folder: Path) -> bool:
    return any(ours in (folder, *folder.parents) for ours in OURS)


def parsed(path: Path) -> ast.Module:
    """Syntax tree of a source file; empty where it cannot be parsed."""
    return _tree(content_of(path))


def content_of(path: Path) -> bytes:
    """Bytes of a file, none where it cannot be read."""
    try:
        return path.read_bytes()
    except OSError:
        return b""


def _tree(content: bytes) -> ast.Module:
    try:
        return ast.parse(content)
    except (SyntaxError, ValueError):
        return ast.Module([], [])


@lru_cache(maxsize=100_000)
def parents(name: str) -> tuple[str, ...]:
    """Parent packages of a module, which are imported before it."""
    above, dot, _ = name.rpartition(".")
    return (above, *parents(above)) if dot else ()


@lru_cache(maxsize=20_000)
def _each(names: tuple[str, ...], asked: bool) -> frozenset[tuple[str, bool]]:
    return frozenset((name, asked) for name in names)


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


@lru_cache(maxsize=10_000)
def _imports(path: Path, _: tuple[int, ...], name: str, on_demand: bool) -> tuple[str, ...]:
    package = name if path.name == "__init__.py" else name.rpartition(".")[0]
    content = content_of(path)
    key = f"{hashlib.sha256(content).hexdigest()} {package} {on_demand:d}"
    if key not in known_imports:
        known_imports[key] = _imports_in(_tree(content), package.split(".") if package else [], on_demand)
    return known_imports[key]


def _imports_in(tree: ast.Module, package: list[str], on_demand: bool) -> tuple[str, ...]:
    body = tree.body
    gives = on_demand and any(isinstance(node, ast.FunctionDef) and node.name == "__getattr__" for node in body)
    return tuple(dict.fromkeys(_imported(_statements(body, typing=gives), package)))


@lru_cache(maxsize=10_000)
def _texts(path: Path, _: tuple[int, ...]) -> frozenset[str]:
    found = (_pattern(node) for node in ast.walk(parsed(path)) if isinstance(node, ast.Constant | ast.JoinedStr))
    return frozenset(value for value in found if isinstance(value, str))


def _pattern(node: ast.Constant | ast.JoinedStr) -> object:
    """Value of a constant; text of an f-string with `*` for each of its values."""
    if isinstance(node, ast.Constant):
        return node.value
    return "".join(str(part.value) if isinstance(part, ast.Constant) else "*" for part in node.values)


def _content(path: Path) -> str:
    try:
        return file_digest(path)
    except OSError:
        return "not readable"


@lru_cache(maxsize=100_000)
def _digest(path: Path, _: tuple[int, ...]) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _statements(body: Iterable[ast.AST], typing: bool) -> Iterator[ast.AST]:
    """All statements, nested ones included; those under TYPE_CHECKING only where `typing` is set."""
    for node in body:
        yield node
        for field in ("body", "handlers", "cases", "orelse", "finalbody"):
            if typing or field != "body" or not _for_type_checkers(node):
                yield from _statements(getattr(node, field, ()), typing)


def _for_type_checkers(node: ast.AST) -> bool:
    test = node.test if isinstance(node, ast.If) else None
    return (test.attr if isinstance(test, ast.Attribute) else getattr(test, "id", None)) == "TYPE_CHECKING"


def _imported(statements: Iterable[ast.AST], package: list[str]) -> Iterator[str]:
    for node in statements:
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield alias.name
                if alias.asname is None:  # `import a.b` binds a, with all of its lazy attributes
                    yield alias.name.partition(".")[0]
        elif isinstance(node, ast.ImportFrom):
            above = package[: len(package) - node.level + 1] if node.level else []
            base = ".".join([*above, *([node.module] if node.module else [])])
            yield base
            yield from (f"{base}.{alias.name}" for alias in node.names)
