"""The cells of docs/api.md and of the notebooks in examples/ run, in an empty folder."""

import json
import subprocess
import sys

import matplotlib.pyplot as plt
import pytest

import uavbench as ub
from tests.docs.cells import code_cells, run_cell
from tests.docs.pages import ROOT, blocks
from tests.docs.test_docs import commands_in

NOTEBOOKS = sorted((ROOT / "examples").glob("*.ipynb"))
API = ROOT / "docs" / "api.md"


@pytest.fixture
def figures():
    """Closed when the test is over."""
    yield
    plt.close("all")


@pytest.mark.usefixtures("figures")
@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda p: p.stem)
def test_a_notebook_runs_from_top_to_bottom(notebook, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names = {}
    for number, text in enumerate(code_cells(notebook)):
        shown = run_cell(text, names, f"{notebook.name}[{number}]")
    assert plt.get_fignums()
    found = names["found"]
    assert found.ate["translation_m"].rmse < 0.05, "the estimate is near the ground truth"
    assert found.coverage == 1
    assert shown is not None


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda p: p.stem)
def test_a_notebook_is_kept_without_outputs(notebook):
    kept = json.loads(notebook.read_text(encoding="utf-8"))
    assert (kept["nbformat"], kept["nbformat_minor"]) == (4, 5)
    assert len({cell["id"] for cell in kept["cells"]}) == len(kept["cells"])
    assert all(not cell["outputs"] for cell in kept["cells"] if cell["cell_type"] == "code")


@pytest.mark.usefixtures("figures")
@pytest.mark.slow
def test_the_cells_of_the_api_page_run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names = {}
    for number, block in enumerate(blocks(API)):
        if block.file:
            (tmp_path / block.file).write_text(block.text, encoding="utf-8")
        elif block.language == "sh":
            (words,) = commands_in(block.text)
            subprocess.run([sys.executable, "-m", "uavbench.bench.cli", *words], check=True)
        else:
            run_cell(block.text, names, f"api.md[{number}]")
    assert names["result"].status == "ok"
    assert list(names["scores"]["tracker"]) == ["hold", "lsd"]
    assert (tmp_path / "mine.pdf").stat().st_size > 1000


def test_the_page_names_every_figure():
    text = API.read_text(encoding="utf-8")
    public = [n for n in vars(ub.figures) if callable(getattr(ub.figures, n)) and not n.startswith("_")]
    drawn = [n for n in public if getattr(ub.figures, n).__module__ == ub.figures.__name__]
    assert len(drawn) > 15
    assert all(f"`{name}`" in text for name in drawn)
