"""Single mutations of a Python file: comparisons, arithmetic, constants, conditions, statements, arguments, returns."""

import ast
import difflib
import random
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

COMPARISONS: dict[type[ast.cmpop], tuple[type[ast.cmpop], ...]] = {
    ast.Lt: (ast.LtE, ast.GtE),
    ast.LtE: (ast.Lt, ast.Gt),
    ast.Gt: (ast.GtE, ast.LtE),
    ast.GtE: (ast.Gt, ast.Lt),
    ast.Eq: (ast.NotEq,),
    ast.NotEq: (ast.Eq,),
    ast.Is: (ast.IsNot,),
    ast.IsNot: (ast.Is,),
    ast.In: (ast.NotIn,),
    ast.NotIn: (ast.In,),
}
ARITHMETIC: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.FloorDiv: ast.Mult,
    ast.Mod: ast.Mult,
    ast.Pow: ast.Mult,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
}
ORDERED = (ast.Sub, ast.Div, ast.FloorDiv, ast.Mod, ast.Pow, ast.MatMult)
"""Operators whose operands are exchanged too."""
SPOKEN = (ast.Raise, ast.JoinedStr, ast.Import, ast.ImportFrom)
"""What is not looked into: words for people, and imports."""


EVEN_HANDED = {"min", "max", "minimum", "maximum", "hypot", "logical_and", "logical_or"}
"""Functions that do not care which argument comes first."""
UNSIGNED = {"abs", "square", "norm", "hypot"}
"""Functions that do not care for a sign, as the second power does not: a - b in them may be b - a."""


@dataclass(frozen=True)
class Mutant:
    """A file with one place changed."""

    file: str
    line: int
    before: str
    after: str
    source: str

    @property
    def key(self) -> tuple[str, str, str]:
        """What it is recognized by after lines have moved: the file, and the changed lines before and after."""
        return self.file, self.before, self.after

    def diff(self, original: str) -> str:
        """The change as a unified diff."""
        lines = difflib.unified_diff(
            original.splitlines(), self.source.splitlines(), self.file, self.file, lineterm="", n=1
        )
        return "\n".join(lines)


def mutants(root: Path, file: str) -> list[Mutant]:
    """Every mutant of a file, in the order of its lines."""
    source = (root / file).read_text(encoding="utf-8")
    text = source.encode()
    starts = [0]
    for line in text.splitlines(keepends=True):
        starts.append(starts[-1] + len(line))
    found = {}
    tree, rows = ast.parse(source), source.splitlines()
    unsigned = {id(child) for node in ast.walk(tree) for child in _without_sign(node)}
    for outer in tree.body:
        for node, other, swapped in _changes(ast.Module([outer], [])):
            if swapped and isinstance(node, ast.BinOp) and isinstance(node.op, ast.Sub) and id(node) in unsigned:
                continue
            first, last = starts[node.lineno - 1] + node.col_offset, starts[node.end_lineno - 1] + node.end_col_offset
            begin, end = starts[node.lineno - 1], starts[node.end_lineno]
            new, of_outer = other.encode(), slice(starts[outer.lineno - 1], starts[outer.end_lineno])
            changed = (text[:first] + new + text[last:]).decode()
            before = " ".join(part.strip() for part in rows[node.lineno - 1 : node.end_lineno])
            after = " ".join(part.strip() for part in (text[begin:first] + new + text[last:end]).decode().splitlines())
            if changed not in found:
                ast.parse(text[of_outer.start : first] + new + text[last : of_outer.stop])
                found[changed] = Mutant(file, node.lineno, before, after, changed)
    return sorted(found.values(), key=lambda m: (m.line, m.after))


def sample(every: list[Mutant], size: int, seed: int) -> list[Mutant]:
    """So many of the mutants of a file at most, drawn without replacement: the same under a seed."""
    if len(every) <= size:
        return every
    drawn = random.Random(f"{seed} {every[0].file}").sample(every, size)
    return sorted(drawn, key=lambda m: (m.line, m.after))


def _without_sign(node: ast.AST) -> list[ast.expr]:
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Pow) and ast.unparse(node.right) == "2":
        return [node.left]
    if isinstance(node, ast.Call) and ast.unparse(node.func).split(".")[-1] in UNSIGNED:
        return node.args
    return []


def _changes(node: ast.AST) -> Iterator[tuple[ast.expr | ast.stmt, str, bool]]:
    """Nodes with the text that takes their place, and whether it only exchanges two operands."""
    for child in _looked_into(node):
        if isinstance(child, SPOKEN):
            if isinstance(child, ast.Raise):
                yield child, "pass", False
            continue
        if isinstance(child, ast.expr):
            for other in _of_expression(child):
                text = ast.unparse(other)
                swapped = isinstance(other, ast.BinOp) and isinstance(child, ast.BinOp) and other.left is child.right
                yield child, f"({text})" if _inside(child) else text, swapped
        elif isinstance(child, ast.stmt):
            for text in _of_statement(child):
                yield child, text, False
        yield from _changes(child)


def _inside(node: ast.expr) -> bool:
    return not isinstance(node, ast.Constant | ast.Call)


def _looked_into(node: ast.AST) -> Iterator[ast.AST]:
    """Children without annotations, docstrings and decorators."""
    skipped = {"annotation", "returns", "decorator_list", "type_comment", "bases"}
    for name, value in ast.iter_fields(node):
        if name in skipped or (isinstance(node, ast.Subscript) and name == "slice" and _names_types(node)):
            continue
        for child in value if isinstance(value, list) else [value]:
            docstring = isinstance(child, ast.Expr) and isinstance(child.value, ast.Constant)
            if isinstance(child, ast.AST) and not docstring:
                yield child


def _names_types(node: ast.Subscript) -> bool:
    return ast.unparse(node.value).split(".")[-1] in {"NDArray", "Literal", "Annotated", "Callable", "dict", "list"}


def _of_expression(node: ast.expr) -> Iterator[ast.expr]:
    if isinstance(node, ast.Compare):
        for k, op in enumerate(node.ops):
            for other in COMPARISONS[type(op)]:
                yield ast.Compare(node.left, [*node.ops[:k], other(), *node.ops[k + 1 :]], node.comparators)
    elif isinstance(node, ast.BinOp):
        if type(node.op) in ARITHMETIC:
            yield ast.BinOp(node.left, ARITHMETIC[type(node.op)](), node.right)
        if isinstance(node.op, ORDERED):
            yield ast.BinOp(node.right, node.op, node.left)
    elif isinstance(node, ast.BoolOp):
        yield ast.BoolOp(ast.Or() if isinstance(node.op, ast.And) else ast.And(), node.values)
    elif isinstance(node, ast.UnaryOp):
        yield node.operand
    elif isinstance(node, ast.IfExp):
        yield ast.IfExp(node.test, node.orelse, node.body)
    elif isinstance(node, ast.Constant):
        value = node.value
        if isinstance(value, bool):
            yield ast.Constant(not value)
        elif isinstance(value, int):
            yield ast.Constant(value + 1)
        elif isinstance(value, float):
            yield ast.Constant(2 * value if value else 1.0)
    elif isinstance(node, ast.Call) and len(node.args) > 1 and not isinstance(node.args[0], ast.Starred):
        even = ast.unparse(node.func).split(".")[-1] in EVEN_HANDED
        if not even and not isinstance(node.args[1], ast.Starred) and ast.dump(node.args[0]) != ast.dump(node.args[1]):
            yield ast.Call(node.func, [node.args[1], node.args[0], *node.args[2:]], node.keywords)


def _of_statement(node: ast.stmt) -> Iterator[str]:
    if isinstance(node, ast.Return) and node.value is not None:
        yield "return None"
    elif isinstance(node, ast.Expr | ast.Continue | ast.Break | ast.Delete):
        yield "pass"
    elif isinstance(node, ast.AugAssign):
        yield "pass"
        if type(node.op) in ARITHMETIC:
            yield ast.unparse(ast.AugAssign(node.target, ARITHMETIC[type(node.op)](), node.value))
    elif isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Subscript | ast.Attribute):
        yield "pass"
