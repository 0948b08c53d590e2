"""What the source of a Python file imports, and the strings that it holds, without running it."""

import ast
import hashlib
from collections.abc import Iterable, Iterator
from functools import lru_cache
from pathlib import Path

from uavbench.trajectories.sources.digests import stamp

known_imports: dict[str, tuple[str, ...]] = {}
"""Imported names by content of the source file, its package, and whether lazy attributes count."""


def imports(path: Path, name: str, *, on_demand: bool = True) -> tuple[str, ...]:
    """Names of all modules that the source file of the module `name` may import; on_demand: lazy ones too."""
    return _imports(path, stamp(path), name, on_demand)


def imports_in(code: str) -> tuple[str, ...]:
    """Names of all modules that a Python program may import; none where the text is no Python."""
    return _imports_in(_tree(code.encode(errors="replace")), [], on_demand=True)


def texts(path: Path) -> frozenset[str]:
    """All string literals of a source file; `*` stands for each value of an f-string."""
    return _texts(path, stamp(path))


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
