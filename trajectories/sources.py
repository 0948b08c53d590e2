"""Which source files a module is made of: its own, and those of what it imports, as far as somebody may edit them."""

import ast
import hashlib
import importlib.util
import sys
import sysconfig
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path

OURS = tuple(Path(__file__).parent.parent / name for name in ("trajectories", "scenes", "tracker", "reports", "bench"))
INSTALLED = tuple(Path(sysconfig.get_path(name)).resolve() for name in ("stdlib", "platstdlib", "purelib", "platlib"))


def sources(module: str) -> frozenset[Path]:
    """Files of a module and of all that it imports, at any depth, but for the interpreter's and installed libraries'.

    Imports are read from the source, those within functions too; a module that cannot be found is left out.
    """
    seen: set[str] = set()
    found: set[Path] = set()
    waiting = [module]
    while waiting:
        name = waiting.pop()
        if name in seen:
            continue
        seen.add(name)
        path = source_file(name)
        if path is not None:
            found.add(path)
            waiting += imports(path, name)
            waiting += parents(name)
    return frozenset(found)


def digest(files: Iterable[Path]) -> str:
    """sha256 over files: their names, those of their folders, and their content, wherever the tree stands."""
    each = sorted(("/".join(path.parts[-2:]), hashlib.sha256(path.read_bytes()).hexdigest()) for path in files)
    return hashlib.sha256(repr(each).encode()).hexdigest()


def source_file(name: str) -> Path | None:
    """Source file of a module that is ours or the user's; None when it is installed, built in, or not to be found."""
    top = name.partition(".")[0]
    above = getattr(sys.modules.get(top), "__file__", None)
    if top in sys.stdlib_module_names or (above is not None and not editable(Path(above))):
        return None
    module = sys.modules.get(name)
    path = getattr(module, "__file__", None)
    if module is None:
        try:
            spec = importlib.util.find_spec(name)
        except (ImportError, AttributeError, ValueError):
            return None
        path = spec.origin if spec is not None and spec.has_location else None
    return Path(path) if path is not None and path.endswith(".py") and editable(Path(path)) else None


@cache
def editable(path: Path) -> bool:
    """Whether a file is ours or the user's, and not one of the interpreter or of an installed library."""
    folders = path.resolve().parents
    return any(ours in path.parents for ours in OURS) or not any(folder in folders for folder in INSTALLED)


@cache
def imports(path: Path, name: str) -> tuple[str, ...]:
    """Names of all modules that the source file of the module `name` imports, or may."""
    return tuple(dict.fromkeys(_imported(ast.parse(path.read_bytes()), name, path.name == "__init__.py")))


def parents(name: str) -> Iterator[str]:
    """Packages that a module lies in: they run before it."""
    while "." in name:
        name = name.rpartition(".")[0]
        yield name


def _imported(tree: ast.AST, name: str, is_package: bool) -> Iterator[str]:
    package = name.split(".") if is_package else name.split(".")[:-1]
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = package[: len(package) - node.level + 1] if node.level else []
            base = ".".join([*above, *([node.module] if node.module else [])])
            yield base
            yield from (f"{base}.{alias.name}" for alias in node.names)
