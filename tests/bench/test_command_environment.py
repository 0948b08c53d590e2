"""Variables of the environment with which libraries cannot be imported end no command."""

import os
import subprocess
import sys

import matplotlib
import pytest

from uavbench.bench.cli.environment import settle_matplotlib
from uavbench.bench.trial.check import TRIAL

READS_A_NUMBER = """__version__ = '99'
import os
int(os.environ.get('NUMEXPR_NUM_THREADS') or os.environ.get('OMP_NUM_THREADS', '1'))
"""
"""A stand-in of NumExpr, which is not always installed."""


def plot(folder, **variables):
    """Draws a figure by a command, which imports pandas' and matplotlib's settings."""
    truth = TRIAL / "groundtruth.csv"
    words = [sys.executable, "-m", "uavbench", "evaluate", truth, truth, "--plot", folder / "plot.png"]
    environment = {**os.environ, **variables}
    return subprocess.run(list(map(str, words)), capture_output=True, text=True, check=False, env=environment)


@pytest.mark.parametrize(
    ("variables", "threads"),
    [
        ({"NUMEXPR_NUM_THREADS": "x"}, "1"),
        ({"NUMEXPR_NUM_THREADS": "0"}, "1"),
        ({"NUMEXPR_NUM_THREADS": "", "OMP_NUM_THREADS": "x"}, "1"),
        ({"OMP_NUM_THREADS": "4,2"}, "4"),
        ({"NUMEXPR_NUM_THREADS": " 3 ", "OMP_NUM_THREADS": "4,2"}, " 3 "),
        ({"OMP_NUM_THREADS": "2"}, "none"),
    ],
)
def test_numexpr_is_told_a_number_of_threads(tmp_path, variables, threads):
    (tmp_path / "numexpr.py").write_text(READS_A_NUMBER)
    code = "import os; from click.testing import CliRunner; from uavbench.bench.cli.main import main; "
    code += "CliRunner().invoke(main, ['list']); import pandas; print(os.environ.get('NUMEXPR_NUM_THREADS', 'none'))"
    kept = {name: value for name, value in os.environ.items() if not name.endswith("_NUM_THREADS")}
    environment = {**kept, **variables, "PYTHONPATH": os.pathsep.join([str(tmp_path), *filter(None, sys.path)])}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, env=environment)
    assert (done.returncode, done.stdout) == (0, f"{threads}\n"), done.stderr


@pytest.mark.parametrize("backend", ["nosuch", "qtagg", "", "module://nosuch"])
def test_figures_are_drawn_whatever_backend_is_asked_for(tmp_path, backend):
    done = plot(tmp_path, MPLBACKEND=backend)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "plot.png").is_file()


@pytest.mark.parametrize(("asked", "kept"), [("TkAgg", "TkAgg"), ("module://mine", "module://mine"), ("nosuch", "agg")])
def test_only_a_backend_that_matplotlib_does_not_know_is_replaced(monkeypatch, asked, kept):
    monkeypatch.setenv("MPLBACKEND", asked)
    monkeypatch.setitem(matplotlib.rcParams, "backend", "agg")
    settle_matplotlib()
    assert os.environ["MPLBACKEND"] == kept


def test_a_home_that_is_missing_is_not_made(tmp_path):
    """Neither for kernels nor by matplotlib: what is kept goes into a temporary folder."""
    (tmp_path / "tmp").mkdir()
    kept = {"HOME": str(tmp_path / "home"), "TMPDIR": str(tmp_path / "tmp"), "NUMBA_CACHE_DIR": ""}
    done = plot(tmp_path, XDG_CACHE_HOME="", XDG_CONFIG_HOME="", MPLCONFIGDIR="", **kept)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "plot.png").is_file() and not (tmp_path / "home").exists()
