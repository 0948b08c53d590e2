"""Figures and formulas with a list of fonts that lacks some: a file in the user's cache, which may be damaged."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from matplotlib.font_manager import FontManager, json_dump

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
    """What is printed, and the bytes of a figure, in a process whose list of fonts has some of the entries."""
    folder.mkdir()
    whole = FontManager()
    json_dump(whole, folder / f"fontlist-v{FontManager.__version__}.json")
    if fonts is not None:
        for path in folder.glob("fontlist*"):
            data = json.loads(path.read_text())
            data["ttflist"] = [entry for entry in data["ttflist"] if entry["name"] in fonts]
            path.write_text(json.dumps(data))
    environment = {**os.environ, "MPLCONFIGDIR": str(folder)}
    done = subprocess.run(
        [sys.executable, "-c", DRAWN, str(folder / "figure")],
        cwd=ROOT, env=environment, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout, *((folder / f"figure{suffix}").read_bytes() for suffix in (".pdf", ".png"))


@pytest.mark.parametrize("fonts", [{"DejaVu Sans"}, set(), {"DejaVu Sans", "STIXGeneral"}], ids=lambda f: str(len(f)))
def test_a_list_that_lacks_fonts_changes_no_glyph(fonts, tmp_path):
    assert drawn_with(fonts, tmp_path / "damaged") == drawn_with(None, tmp_path / "whole")
