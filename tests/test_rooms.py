"""Rooms: no package is a heap, and each says what comes in, what goes out, and what it may import."""

import ast
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
