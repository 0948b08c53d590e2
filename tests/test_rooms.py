"""Rooms: no package is a heap, and each says what comes in, what goes out, and what it may import."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
MOST_MODULES = 12
PACKAGES = [
    path.parent
    for layer in ("bench", "reports", "tracker", "scenes", "trajectories")
    for path in sorted((ROOT / layer).rglob("__init__.py"))
]
NAMES = [str(folder.relative_to(ROOT)) for folder in PACKAGES]


@pytest.mark.parametrize("folder", PACKAGES, ids=NAMES)
def test_no_package_holds_more_than_a_dozen_modules(folder: Path) -> None:
    assert len([path for path in folder.glob("*.py") if path.name != "__init__.py"]) <= MOST_MODULES


@pytest.mark.parametrize("folder", PACKAGES, ids=NAMES)
def test_every_package_says_what_comes_in_and_out_and_what_it_imports(folder: Path) -> None:
    said = ast.get_docstring(ast.parse((folder / "__init__.py").read_text(encoding="utf-8"))) or ""
    assert said
    if folder.parent != ROOT:
        assert [word for word in ("In:", "Out:", "Imports") if word not in said] == []


def test_every_folder_of_modules_is_a_package() -> None:
    for layer in ("bench", "reports", "tracker", "scenes", "trajectories"):
        folders = {path.parent for path in (ROOT / layer).rglob("*.py")}
        assert sorted(str(folder) for folder in folders - set(PACKAGES)) == []


WHICH_FILE = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8").partition("## Which file to open")[2]
ROWS = [line for line in WHICH_FILE.splitlines() if line.startswith("| ")][1:]


@pytest.mark.parametrize("row", ROWS, ids=[row.split("|")[1].strip() for row in ROWS])
def test_the_file_to_open_is_there_and_holds_what_the_table_says(row: str) -> None:
    parts = re.findall(r"`([a-z_/]+\.py)`(?: \(([^)]*)\))?", row)
    assert parts
    for path, names in parts:
        body = ast.parse((ROOT / path).read_text(encoding="utf-8")).body
        targets = [t for node in body for t in getattr(node, "targets", [getattr(node, "target", node)])]
        defined = {getattr(target, "id", None) or getattr(target, "name", None) for target in targets}
        assert set(re.findall(r"`(\w+)`", names)) <= defined


def test_every_registry_of_plugins_is_in_the_table() -> None:
    registries = {str(path.relative_to(ROOT)) for layer in ("bench", "tracker", "scenes", "trajectories")
                  for path in (ROOT / layer).rglob("registry.py")}  # fmt: skip
    assert registries - set(re.findall(r"`([a-z_/]+\.py)`", WHICH_FILE)) == set()
