"""No text of anybody's commands the terminal that a command is typed in, whichever command says it."""

import json
import os
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import CliRunner

from tests.bench.test_history import noisy
from uavbench.bench.challenge.organizer import Challenge, Hidden
from uavbench.bench.cli.main import main
from uavbench.bench.history.validation import history_of
from uavbench.bench.trial.check import TRIAL
from uavbench.reports.history.history_file import MOST_COMMITS, write_history

ROOT = Path(__file__).parents[2]
ESCAPE = "\x1b]0;owned\x07\x1b[2J\x9b31m\u202e\r"
COMMANDS = "\x1b\x07\x9b\u202e\r"
"""What of it commands a terminal, or turns the direction of writing."""
PROGRAMS = {"blender_script.py", "rapid_runner.py", "said.py"}
"""That speak to another program, and the one place that speaks to a person."""


def test_all_that_is_said_is_said_in_one_place():
    spoken = re.compile(r"click\.(echo|secho|echo_via_pager)|(?<![\w.])print\(|sys\.(stdout|stderr)\.write")
    found = [
        f"{path.relative_to(ROOT)}: {line.strip()}"
        for path in sorted((ROOT / "bench").rglob("*.py"))
        if path.name not in PROGRAMS and not path.name.startswith("test_")
        for line in path.read_text().splitlines()
        if spoken.search(line) and "file=self._talk" not in line and "import sys; print" not in line
    ]
    assert found == []


def spoken_by(*arguments):
    done = CliRunner().invoke(main, [str(each) for each in arguments])
    assert done.exception is None or isinstance(done.exception, SystemExit), done.exception
    said = done.output + done.stderr
    assert not [sign for sign in COMMANDS if sign in said], repr(said)
    return said


def test_names_of_files_and_sensors_of_a_dataset(tmp_path):
    folder = shutil.copytree(TRIAL, tmp_path / "trial")
    info = json.loads((folder / "sequence.json").read_text())
    info["sensors"] = {f"{ESCAPE}.csv": {"kind": ESCAPE}}
    (folder / "sequence.json").write_text(json.dumps(info))
    (folder / f"x{ESCAPE}").touch()
    assert "\\x1b" in spoken_by("verify", folder)
    assert "\\x1b" in spoken_by("export", folder, "--format", "tum", "--out", tmp_path / "out")


def test_subjects_of_commits(tmp_path):
    errors = noisy(30)
    errors[15:] *= 1.2
    path, history = tmp_path / "history.json", history_of(errors)
    write_history(path, replace(history, commits=[replace(entry, subject=ESCAPE) for entry in history.commits]))
    assert "ALARM" in (said := spoken_by("history", path, "--out", tmp_path / "out")) and "\\x1b" in said


@pytest.mark.parametrize(
    "command", ["verify", "score-submission", "leaderboard", "tables", "gate", "history", "export"]
)
def test_what_is_in_json_of_others(tmp_path, command):
    """A file that is something else than was meant, its keys and values full of escapes."""
    place = tmp_path / f"a{ESCAPE}"
    place.mkdir()
    for name in ("scores.json", "suite.json", "manifest.json", "sequence.json", "report.json", "challenge.json"):
        (place / name).write_text(json.dumps({ESCAPE: ESCAPE, "sha256": {ESCAPE: ESCAPE}, "format": ESCAPE}))
    Challenge("c", 5.0, {f"sequence-{ESCAPE}": Hidden("trial", ESCAPE)}).save(tmp_path / "organizer")
    more = {
        "score-submission": [tmp_path / "organizer", place],
        "leaderboard": [place / "scores.json", "--out", tmp_path / "out"],
        "gate": [place, "--baseline", place / "suite.json"],
        "history": [place / "scores.json", "--out", tmp_path / "out"],
        "export": [place, "--format", "tum", "--out", tmp_path / "out"],
    }
    assert spoken_by(command, *more.get(command, [place]))


def test_a_name_that_is_no_text_is_said_too(tmp_path):
    out = os.fsencode(tmp_path) + b"/bad\xff"
    environment = {**os.environ, "PYTHONIOENCODING": "utf-8:strict", "LC_ALL": "C.UTF-8"}
    command = [sys.executable, "-m", "uavbench.bench.cli.main", "export", str(TRIAL), "--format", "tum", "--out", out]
    done = subprocess.run(command, capture_output=True, env=environment, check=False)
    assert done.returncode == 0, done.stderr.decode()
    assert Path(os.fsdecode(out)).is_dir() and b"bad\\udcff" in done.stdout


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ('"value": ', '"value": 1e308, "x": ', "at `commits.0.metrics"),
        ('"runs": {', '"runs": {"huge": [1e308], ', "less than or equal to 1000000000000"),
        ('"value": ', '"value": NaN, "x": ', "finite"),
    ],
)
def test_a_history_of_numbers_that_are_none_is_refused(tmp_path, old, new, told):
    path = tmp_path / "history.json"
    write_history(path, history_of(noisy(6)))
    path.write_text(path.read_text().replace(old, new))
    assert told in spoken_by("history", path, "--out", tmp_path / "out")


def test_a_history_has_a_length(tmp_path):
    path = tmp_path / "history.json"
    entries = ",".join(
        f'{{"commit": "{k}", "time": "", "subject": "", "environment": {{}}, "metrics": {{}}}}'
        for k in range(MOST_COMMITS + 1)
    )
    write_history(path, history_of(noisy(4)))
    head = path.read_text().split('"commits": [')[0]
    path.write_text(f'{head}"commits": [{entries}]}}')
    assert "at most 10,000 are read" in spoken_by("history", path, "--out", tmp_path / "out")
