"""Help and mistakes on the command line, as a terminal of 80 columns shows them."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner

from tests.bench.small_suites import small_suite
from uavbench.bench.cli.main import main
from uavbench.bench.runner import commands
from uavbench.bench.trial.check import TRIAL
from uavbench.scenes.exports import registry


def uavbench(*arguments):
    return CliRunner().invoke(main, list(map(str, arguments)), prog_name="uavbench", terminal_width=80)


def test_every_command_is_summed_up_in_whole_words():
    listed = uavbench("--help").output.split("Commands:")[1]
    assert "..." not in listed
    assert " ".join(listed.split()).count("exit code 0 pass, 1 fail, 3 inconclusive") == 1
    assert [line.split()[0] for line in listed.splitlines() if line[2:3].strip()] == sorted(main.commands)


@pytest.mark.parametrize("name", ["", *main.commands])
def test_help_fits_the_terminal(name):
    done = uavbench(*name.split(), "--help")
    assert done.exit_code == 0
    assert max(map(len, done.output.splitlines())) <= 80
    assert "..." not in done.output.partition("Commands:")[2]


@pytest.mark.parametrize(("arguments", "told"), [
    (("check", "none.toml"), "none.toml: no such file; write a table such as kind = 'robust' into a TOML file"),
    (("run", "none.toml"), "none.toml: no such file; `uavbench list` shows the suites"),
    (("tables", "none"), "none/scores.json: no such file; name the folder of a report"),
    (("track", "robust"), "unknown suite 'robust'"),
    (("calibrate", "none", "--board", "²x8"), "--board '²x8': write the numbers of inner corners as 7x8"),
    (("calibrate", "none", "--out", "c.png"), "--out c.png: the picture of the corners gets this name; name"),
])  # fmt: skip
def test_a_mistake_is_told_with_what_to_name(arguments, told, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = uavbench(*arguments)
    assert done.exit_code == 2
    assert told in done.output


@pytest.mark.parametrize("arguments", [
    ("score", "SUITE", "--shard", ""),
    ("score", "SUITE", "--dask", ""),
    ("score", "SUITE", "--out", ""),
    ("track", "robust", "--images", "", "--model", "m.obj", "--camera", "c.toml", "--init", "i.toml", "--out", "out"),
    ("gate", ""),
])  # fmt: skip
def test_a_variable_that_is_not_set_is_not_the_current_folder_nor_the_whole_suite(arguments, tmp_path, monkeypatch):
    suite = small_suite(tmp_path)
    (tmp_path / "empty").mkdir()
    monkeypatch.chdir(tmp_path / "empty")
    done = uavbench(*(suite if each == "SUITE" else each for each in arguments))
    assert done.exit_code == 2
    assert "is empty; is a variable of a script not set?" in " ".join(done.output.split())
    assert not list((tmp_path / "empty").iterdir())


@pytest.mark.parametrize("arguments", [
    ("score", "SUITE", "--out=~/runs"),
    ("export", "none", "--format", "tum", "--out=~"),
    ("verify", "~/runs/box-s0"),
])  # fmt: skip
def test_a_home_that_the_shell_did_not_fill_in_is_no_folder_called_tilde(arguments, tmp_path, monkeypatch):
    """Which whoever then removes it would remove with the home."""
    suite = small_suite(tmp_path)
    (tmp_path / "empty").mkdir()
    monkeypatch.chdir(tmp_path / "empty")
    monkeypatch.setenv("HOME", "/home/me")
    done = uavbench(*(suite if each == "SUITE" else each for each in arguments))
    assert done.exit_code == 2
    assert "the shell put no home in place of ~" in " ".join(done.output.split())
    assert "/home/me" in done.output
    assert not list((tmp_path / "empty").iterdir())


def interrupted(*_, **__):
    raise KeyboardInterrupt


def test_an_interrupt_says_that_a_suite_goes_on_and_nothing_of_the_kind_of_what_begins_anew(tmp_path, monkeypatch):
    monkeypatch.setattr(commands, "run_graph", interrupted)
    monkeypatch.setattr(registry, "new_folder", interrupted)
    suite = uavbench("render", small_suite(tmp_path), "--out", tmp_path / "out")
    export = uavbench("export", TRIAL, "--format", "tum", "--out", tmp_path / "tum")
    assert (suite.exit_code, suite.stderr) == (130, "uavbench: interrupted; the same command goes on from here\n")
    assert (export.exit_code, export.stderr) == (130, "uavbench: interrupted; run the same command again\n")


@pytest.mark.parametrize("arguments", [("run", "tiny"), ("calibrate", TRIAL / "frames"), ("export", TRIAL)])
def test_a_current_folder_that_was_removed_is_told(arguments, tmp_path, monkeypatch):
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    done = uavbench(*arguments, *(("--format", "tum", "--out", "tum") if arguments[0] == "export" else ()))
    assert done.exit_code == 2
    assert done.stderr == ("uavbench: the current folder has been removed; change into another one, or into it again\n")


def test_a_current_folder_that_is_removed_during_a_command_is_told(tmp_path, monkeypatch):
    suite = small_suite(tmp_path)
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")

    def removed(*_, **__):
        (tmp_path / "gone").rmdir()
        Path("relative").absolute()

    monkeypatch.setattr(commands, "run_graph", removed)
    done = uavbench("render", suite, "--out", tmp_path / "out")
    assert done.exit_code == 2
    assert done.stderr.startswith("uavbench: the current folder has been removed; change into another one")


def in_process(*words, **variables):
    environment = {**os.environ, **variables}
    return subprocess.run([sys.executable, *words], capture_output=True, text=True, check=False, env=environment)


def test_a_number_of_threads_that_numba_does_not_take_is_told():
    done = in_process("-m", "uavbench", "run", "nosuch", NUMBA_NUM_THREADS="0")
    assert done.returncode == 2 and "Traceback" not in done.stderr
    assert "NUMBA_NUM_THREADS is 0; set it to 1 or more, or unset it" in done.stderr


def test_pandas_is_imported_where_openmp_has_a_number_of_threads_for_each_level(tmp_path):
    """It imports NumExpr, which is not always installed, and reads one number only."""
    (tmp_path / "numexpr.py").write_text(
        "import os\n__version__ = '99'\nint(os.environ.get('NUMEXPR_NUM_THREADS') or os.environ['OMP_NUM_THREADS'])\n"
    )
    path = os.pathsep.join([str(tmp_path), *filter(None, sys.path)])
    code = "from click.testing import CliRunner; from uavbench.bench.cli.main import main; "
    code += "CliRunner().invoke(main, ['list']); import pandas"
    done = in_process("-c", code, OMP_NUM_THREADS="4,2", PYTHONPATH=path)
    assert done.returncode == 0, done.stderr
