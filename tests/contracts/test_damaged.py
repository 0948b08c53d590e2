"""No command takes a number from a file that is not as uavbench wrote it: one byte of every file that it opens is
changed, and the command must name the file.
"""

import re
import shutil
import sys
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

import uavbench as ub
from tests.contracts.commands import invoke, snapshot
from uavbench.bench.challenge.organizer import Challenge, Hidden
from uavbench.bench.config.suite import load_suite
from uavbench.bench.runner.output_folder import ELSEWHERE, suite_folder
from uavbench.reports.report import MARKER as REPORT
from uavbench.reports.report import ReportInputs, write_scores
from uavbench.reports.scoring.score import score
from uavbench.scenes.dataset.sequence import RENDERED, Sequence
from uavbench.tracker.baselines.hold import Hold
from uavbench.tracker.run import track_sequence
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.intact import LISTS
from uavbench.trajectories.files.writing import new_folder, new_parts

SEQUENCE, RESULTS = "sequences/box-s1", "results/box-s1/hold@15hz"
_opened: list[str] | None = None


def _note(event, arguments):
    if event == "open" and _opened is not None and isinstance(arguments[0], str):
        _opened.append(arguments[0])


sys.addaudithook(_note)


@pytest.fixture(scope="module")
def whole(inputs, tmp_path_factory):
    """A suite's folder as a run leaves it, with one sequence, and the folder of a challenge with the same one."""
    folder = tmp_path_factory.mktemp("whole")
    with suite_folder(folder, load_suite(inputs / "small.toml")):
        with new_folder(folder / SEQUENCE, RENDERED) as new:
            shutil.copytree(inputs / "rendered", new, dirs_exist_ok=True)
            (new / "manifest.json").unlink()
        sequence = Sequence.load(folder / SEQUENCE)
        results = track_sequence(Hold(), sequence, rate_hz=15.0, seed=0)
        results.save(folder / RESULTS, sequence.ground_truth)
        found = score(sequence, results)
        found.save(folder / RESULTS / "score.json")
        for name in (SEQUENCE, RESULTS):
            shutil.copytree(folder / name, folder / name.replace("-s1", "-s0"))
        with new_parts(folder, REPORT) as new:
            write_scores(new, ReportInputs("small", []), [found])
    Challenge("c", 5.0, {"sequence-01": Hidden("box-s1", "flight-1")}).save(folder)
    return folder


@click.command("load")
@click.argument("folder", type=click.Path(path_type=Path))
def load(folder):
    """What a notebook reads."""
    try:
        ub.load_scores(folder)
        for run in ub.load_runs(folder):
            run.frames()
            for frame in ub.open_sequence(run.sequence.folder):
                assert frame.image.size
    except UserError as error:
        raise SystemExit(str(error)) from None


def readers(folder, inputs, out):
    """Every command that reads what commands wrote."""
    estimate = folder / RESULTS / "estimate_world_from_body.tum"
    return {
        "tables": ["tables", folder, "--out", out / "table.md"],
        "gate": ["gate", folder, "--baseline", folder, "--out", out / "gate"],
        "record": ["gate", folder, "--record", out / "history.json", "--commit", "2e4b"],
        "export": ["export", folder / SEQUENCE, "--format", "tum", "--out", out / "tum"],
        "evaluate": ["evaluate", folder / SEQUENCE, folder / RESULTS],
        "evaluate files": ["evaluate", folder / SEQUENCE / "groundtruth.csv", estimate],
        "twin": ["twin", folder / SEQUENCE, "--out", out / "twin"],
        "score-submission": ["score-submission", folder, inputs / "team", "--out", out / "score.json"],
        "track": ["track", "hold", "--images", folder / SEQUENCE / "frames", "--model", folder / SEQUENCE / "model.obj",
                  "--camera", folder / SEQUENCE / "camera.toml", "--init", inputs / "init.toml", "--out", out / "t"],
        "load": ["load", folder],
    }  # fmt: skip


def called(arguments, folder):
    if arguments[0] == "load":
        return CliRunner().invoke(load, [str(folder)])
    return invoke(arguments, third_party=folder)


def opened_by(arguments, folder):
    """Names of the files of a folder that a command opens, one of the frames; without lists that name none of them."""
    global _opened
    _opened = []
    try:
        called(arguments, folder)
        names = {Path(path).absolute() for path in _opened}
    finally:
        _opened = None
    inside = sorted(path.relative_to(folder).as_posix() for path in names if path.is_relative_to(folder))
    above = {name for name in LISTS if not any("/" not in other and other not in LISTS for other in inside)}
    files = [name for name in inside if (folder / name).is_file() and name not in above]
    kinds = {(name if "/frames/" not in name else "frame"): name for name in reversed(files)}
    return sorted(kinds.values())


def changed(data):
    """The bytes with one digit of the text changed, or one byte of a binary file."""
    digit = re.search(rb"[=:, ]-?[0-9]*\.?[0-9]*([0-9])", data) if b"\0" not in data else None
    at = digit.start(1) if digit else len(data) // 2
    return data[:at] + bytes([data[at] ^ 1]) + data[at + 1 :]


@pytest.mark.parametrize("command", sorted(readers(Path("folder"), Path("inputs"), Path("out"))))
def test_a_changed_file_is_refused_by_its_name(whole, inputs, tmp_path, command):
    folder = tmp_path / "out"
    shutil.copytree(whole, folder)
    before = snapshot(folder)
    names = opened_by(readers(folder, inputs, tmp_path / "whole")[command], folder)
    assert names
    noted = snapshot(folder)
    assert {name: data for name, data in noted.items() if name != ELSEWHERE.name} == before
    for number, name in enumerate(names):
        data = (folder / name).read_bytes()
        (folder / name).write_bytes(changed(data))
        result = called(readers(folder, inputs, tmp_path / str(number))[command], folder)
        (folder / name).write_bytes(data)
        assert result.exit_code, f"{name}: {result.output}"
        assert f"{folder / name}: is damaged" in result.output.replace("\n", ""), f"{name}: {result.output}"
    assert snapshot(folder) == noted
