"""No command that writes deletes or overwrites what it did not write, whatever stands where it is told to write.

The commands come from the command line itself: a new one must say here how it is called.
"""

import os
import shutil
import tempfile

import click
import numba
import pytest
from click.testing import CliRunner

from tests.contracts.commands import COMMANDS, assert_kept, calls, invoke, snapshot
from uavbench.bench.cli.main import main
from uavbench.bench.reference import main as reference
from uavbench.trajectories.kernels.cache import KernelCache, folder_of, remove_old
from uavbench.trajectories.kernels.pipeline import KernelCompiler

SILENT = {"list", "schema", "verify", "third-party list"}
"""Commands that write nothing."""
CAN_BE_BESIDE = {"evaluate", "planes", "tables"}
"""Commands that make a file beside what is there where its name is free."""
PRECIOUS = b"years of work"
FILES = (
    "thesis.tex", ".git-credentials", ".pre-commit-config.yaml", ".a-b", "results/.my-notes", "sequences/box-s0/a.png",
    "results/box-s0/hold@15hz/score.json", "figures/mine.pdf", "index.html", "suite.json", "manifest.json", ".lock",
    "record.json", "report.json", "head/suite.json", "base/suite.json", "failures.txt", "seconds.json",
    "gate.json", "gate/gate.json", "bisect.json", "visp/versions.json", "opencv-rapid/venv/a",
    "commands.md", "plugins.md", "suite.schema.json", "camera.toml",
    "made/a",
)  # fmt: skip


def leaves(group, before=""):
    """Names of all commands, `third-party list` of those in groups."""
    for name, command in group.commands.items():
        if isinstance(command, click.Group):
            yield from leaves(command, f"{before}{name} ")
        else:
            yield before + name


def fill(folder):
    """Precious files, links and pipes, in a folder and those below, and something far that links lead to."""
    folder.mkdir(parents=True)
    far = folder.parent / "far"
    far.mkdir()
    for name in FILES:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(PRECIOUS)
        (far / name.replace("/", "-")).write_bytes(PRECIOUS)
    (folder / "link").symlink_to(far / "thesis.tex")
    (folder / "figures" / "nowhere").symlink_to(far / "none")
    (folder / "hard").hardlink_to(far / "index.html")
    os.mkfifo(folder / "pipe")
    (folder.parent / "precious.pdf").write_bytes(PRECIOUS)
    (folder.parent / "precious.png").write_bytes(PRECIOUS)
    (folder.parent / "precious.csv").write_bytes(PRECIOUS)


def test_every_command_is_known_here():
    known = {*COMMANDS} | SILENT | {"warm-up"}
    assert set(leaves(main)) == known


@pytest.mark.usefixtures("sketched")
@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("what", ["folder", "file", "link", "dangling link", "pipe"])
def test_what_is_precious_is_there_afterwards(inputs, tmp_path, monkeypatch, command, what):
    home = tmp_path / "home"
    fill(home / "precious")
    target = {
        "folder": home / "precious",
        "file": home / "precious" / "camera.toml",
        "link": home / "precious" / "link",
        "dangling link": home / "precious" / "figures" / "nowhere",
        "pipe": home / "precious" / "pipe",
    }[what]
    monkeypatch.chdir(tmp_path)
    before, read = snapshot(home), snapshot(inputs)
    for arguments in calls(inputs, target)[command]:
        result = invoke(arguments, third_party=target)
        assert_kept(home, before, result)
        assert result.exit_code or command in CAN_BE_BESIDE, f"{arguments} did not refuse"
        assert snapshot(inputs) == read


def doubled(x):
    return 2.0 * x


@pytest.mark.parametrize("where", ["", "camera.toml", "link", "figures/nowhere", "pipe"])
def test_warm_up_keeps_kernels_beside_what_is_precious(tmp_path, monkeypatch, where):
    """What `warm-up` does for each kernel: a place is found, a kernel is kept there, old ones are removed."""
    fill(tmp_path / "home" / "precious")
    before = snapshot(tmp_path / "home")
    for name in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME"):
        monkeypatch.setenv(name, str(tmp_path / "home" / "precious" / where))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "home" / "precious"))
    place = folder_of.__wrapped__("0" * 32)
    kernel = numba.njit(pipeline_class=KernelCompiler)(doubled)
    kernel._cache = KernelCache("doubled", lambda: place)
    assert kernel(3.0) == 6.0
    remove_old(place.parent)
    after = snapshot(tmp_path / "home")
    assert {name: after.get(name) for name in before} == before
    assert any(name.endswith(".nbc") for name in set(after) - set(before))


def test_the_images_are_not_the_place_for_results(inputs, tmp_path):
    (tmp_path / "data").mkdir()
    shutil.copytree(inputs / "images", tmp_path / "data" / "images")
    trial = inputs / "trial"
    rest = ["--model", trial / "model.obj", "--camera", trial / "camera.toml", "--init", inputs / "init.toml"]
    before = snapshot(tmp_path)
    for out in (tmp_path / "data" / "images", tmp_path / "data", tmp_path):
        result = invoke(["track", "hold", "--images", tmp_path / "data" / "images", *rest, "--out", out], tmp_path)
        assert_kept(tmp_path, before, result)
        assert result.exit_code == 2
        assert "000000.png, which uavbench did not write" in result.output
    images = tmp_path / "data" / "images"
    for _ in range(2):  # beside the images is well, and again too
        result = invoke(["track", "hold", "--images", images, *rest, "--out", images / "tracked"], tmp_path)
        assert result.exit_code == 0, result.output
        assert_kept(tmp_path, before, result)
    (images / "tracked" / "notes.txt").write_bytes(PRECIOUS)
    before = snapshot(tmp_path)
    result = invoke(["track", "hold", "--images", images, *rest, "--out", images / "tracked"], tmp_path)
    assert_kept(tmp_path, before, result)
    assert "notes.txt" in result.output


def test_a_job_that_broke_the_protocol_is_kept_again_and_again_but_on_nobodys_files(inputs, tmp_path):
    for _ in range(2):
        assert invoke(["check", inputs / "bad.toml", "--keep", tmp_path / "kept"], tmp_path).exit_code == 1
    assert (tmp_path / "kept" / "faults.txt").is_file()
    (tmp_path / "kept" / "notes.txt").write_bytes(PRECIOUS)
    before = snapshot(tmp_path)
    result = invoke(["check", inputs / "bad.toml", "--keep", tmp_path / "kept"], tmp_path)
    assert_kept(tmp_path, before, result)
    assert "notes.txt" in result.output


def test_a_plot_is_drawn_again_until_somebody_changes_it_or_its_numbers(inputs, tmp_path):
    call = ["evaluate", inputs / "a.tum", inputs / "b.tum", "--plot"]
    for suffix in (".pdf", ".png"):
        plot = (tmp_path / "errors").with_suffix(suffix)
        for _ in range(2):
            assert invoke([*call, plot], tmp_path).exit_code == 0
        (tmp_path / "errors.csv").write_bytes(PRECIOUS)
        before = snapshot(tmp_path)
        assert_kept(tmp_path, before, refused := invoke([*call, plot], tmp_path))
        assert "errors.csv" in refused.output
        (tmp_path / "errors.csv").unlink()
        plot.unlink()


def test_the_reference_is_written_beside_what_is_there(tmp_path):
    fill(tmp_path / "home" / "precious")
    before = snapshot(tmp_path)
    result = CliRunner().invoke(reference, [str(tmp_path / "home" / "precious")])
    assert {name: snapshot(tmp_path).get(name) for name in before} == before
    assert result.exit_code
    for _ in range(2):
        assert CliRunner().invoke(reference, [str(tmp_path / "new")]).exit_code == 0
