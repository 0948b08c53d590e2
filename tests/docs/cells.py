"""Cells of Python, run one after the other in one namespace, as a notebook runs them."""

import ast
import json
from pathlib import Path


def code_cells(notebook: Path) -> list[str]:
    """Texts of the code cells of a notebook."""
    cells = json.loads(notebook.read_text(encoding="utf-8"))["cells"]
    return ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]


def run_cell(text: str, names: dict[str, object], file: str) -> object:
    """The value of a cell's last line, None where that is no expression; a traceback names the cell."""
    tree = ast.parse(text, file)
    last = tree.body.pop() if tree.body and isinstance(tree.body[-1], ast.Expr) else None
    exec(compile(tree, file, "exec"), names)
    return eval(compile(ast.Expression(last.value), file, "eval"), names) if isinstance(last, ast.Expr) else None
