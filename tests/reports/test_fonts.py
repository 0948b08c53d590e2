"""Figures and formulas with a list of fonts that lacks some: a file in the user's cache, which may be damaged."""

import json
import os
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from matplotlib.font_manager import FontManager, json_dump

from uavbench.bench.cli.main import main
from uavbench.reports.style import house_style, new_figure, save_figure

ROOT = Path(__file__).parents[2]
DRAWN = """
import runpy, sys
from pathlib import Path
from uavbench.reports.style import house_style, new_figure, save_figure
from uavbench.reports.tables.latex import _width_pt
with house_style():
    figure = new_figure(1.0, wide=False)
    figure.text(0.1, 0.1, "error $\\\\xi\\\\,\\\\Sigma$ (mm)")
    save_figure(figure, Path(sys.argv[1]), suffixes=(".pdf", ".png"))
print(runpy.run_path(".ci/equations.py")["drawn"](r"\\xi = \\Sigma_k x_k \\sqrt{2}"))
print(_width_pt("uavbench", 8.0, True))
"""


def drawn_with(fonts, folder):
    """What is printed, and the bytes of a figure, in a process whose list of fonts is this text."""
    folder.mkdir()
    (folder / f"fontlist-v{FontManager.__version__}.json").write_text(fonts)
    environment = {**os.environ, "MPLCONFIGDIR": str(folder)}
    done = subprocess.run(
        [sys.executable, "-c", DRAWN, str(folder / "figure")],
        cwd=ROOT, env=environment, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout, *((folder / f"figure{suffix}").read_bytes() for suffix in (".pdf", ".png"))


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """The text of a list of all fonts, and what is drawn with it."""
    folder = tmp_path_factory.mktemp("fonts")
    json_dump(FontManager(), folder / "whole.json")
    text = (folder / "whole.json").read_text()
    return text, drawn_with(text, folder / "drawn")


@pytest.mark.parametrize("fonts", [{"DejaVu Sans"}, set(), {"DejaVu Sans", "STIXGeneral"}], ids=lambda f: str(len(f)))
def test_a_list_that_lacks_fonts_changes_no_glyph(fonts, whole, tmp_path):
    text, drawn = whole
    data = json.loads(text)
    data["ttflist"] = [entry for entry in data["ttflist"] if entry["name"] in fonts]
    assert drawn_with(json.dumps(data), tmp_path / "damaged") == drawn


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(("name", "told"), [("трекер", ""), ("מעקב", ""), ("追跡 of 2", "追跡")])
def test_letters_that_no_font_has_are_told_and_all_others_are_drawn(tmp_path, name, told):
    poses = np.column_stack(
        [np.arange(30) / 10, np.random.default_rng(0).normal(size=(30, 3)), np.zeros((30, 3)), np.ones(30)]
    )
    np.savetxt(tmp_path / "truth.tum", poses)
    for run in range(2):
        np.savetxt(tmp_path / f"run{run}.tum", poses + (run + 1) * np.eye(8)[1])
    group, out = f"{name}={tmp_path}/run*.tum", tmp_path / "out"
    done = CliRunner().invoke(main, ["evaluate", str(tmp_path / "truth.tum"), "--group", group, "--out", str(out)])
    assert done.exit_code == 0, done.output
    for text in (done.stderr, (out / "index.html").read_text()):
        assert (f"lack ({told} of {name})" in text) == bool(told)
        assert ("boxes" in text) == bool(told)
    assert "XeLaTeX" in (out / "tables" / "summary.tex").read_text()


def test_a_letter_that_one_font_lacks_is_of_the_other(tmp_path):
    """Hebrew is in one of the two fonts alone: its outlines differ from those of the box of a missing glyph."""
    drawn = []
    for k, text in enumerate(("מ", "ע", "追")):
        with house_style(), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            figure = new_figure(1.0, wide=False)
            figure.text(0.1, 0.1, text, fontsize=40)
            drawn.append(save_figure(figure, tmp_path / str(k), suffixes=(".png",))[0].read_bytes())
    assert len(set(drawn)) == 3
