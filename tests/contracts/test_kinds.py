"""No command takes the place of a product of another kind that a command wrote, and which may have taken work."""

import hashlib
import json
import shutil
from pathlib import Path

import pytest

from tests.contracts.commands import COMMANDS, assert_kept, calls, invoke, snapshot
from tests.contracts.products import FILES, PRODUCTS, make
from uavbench.trajectories.files.seals import sealed_kind
from uavbench.trajectories.files.writing import write_text

WRITTEN = (
    "index.html", "suite.json", "manifest.json", "record.json", "report.json", "gate.json", "gate.md", "gate.xml",
    "head/suite.json", "head/timing.json", "base/suite.json", "bisect.json", "changes.json", "leaderboard.json",
    "evaluation.json", "flights.json", "package.json", "uavbench.json", "setup.json", "score.json", "challenge.json",
    "visp/setup.json", "opencv-rapid/setup.json", "worst/worst.json", "summary.md", "failures.txt", "seconds.json",
)  # fmt: skip
"""Names under which commands write into a folder."""
BESIDE = {"tables", "gate", "history", "leaderboard"}
"""Commands that add their files to a folder where the names are free."""
LONG = {"evaluate", "compare", "bisect", "third-party setup"}
"""Commands that would do so too, in seconds to minutes for each folder."""


@pytest.fixture(scope="module")
def products(inputs, tmp_path_factory):
    folder = tmp_path_factory.mktemp("products")
    make(inputs, folder)
    return folder


def copied(product, to):
    """A product in a new folder, under its own name."""
    to.parent.mkdir()
    return shutil.copytree(product, to, symlinks=True) if product.is_dir() else Path(shutil.copy(product, to))


@pytest.mark.usefixtures("sketched")
@pytest.mark.parametrize("command", COMMANDS)
def test_a_product_of_another_kind_stays(inputs, products, tmp_path, monkeypatch, command):
    """Every command is told to write over each product of every other kind."""
    monkeypatch.chdir(tmp_path)
    for product in FILES if command in LONG else PRODUCTS:
        if command in product.by:
            continue
        target = copied(products / product.name, tmp_path / product.name / product.name)
        before = snapshot(target.parent)
        for arguments in calls(inputs, target)[command]:
            result = invoke(arguments, third_party=target)
            assert_kept(target.parent, before, result)
            if target in arguments and (product in FILES or command not in BESIDE):
                assert result.exit_code, f"{arguments} did not refuse"


@pytest.mark.usefixtures("sketched")
@pytest.mark.parametrize("command", COMMANDS)
def test_files_of_another_kind_in_a_folder_stay(inputs, tmp_path, monkeypatch, command):
    """Every command is told to write to a folder whose files have its names and the seals of another kind."""
    monkeypatch.chdir(tmp_path)
    target = tmp_path / "home" / "product"
    for name in WRITTEN:
        text = json.dumps({"a": 1}, indent=1) if name.endswith(".json") else "a"
        write_text(target / name, f"{text}\n", kind="work of weeks")
    before = snapshot(target.parent)
    for arguments in calls(inputs, target)[command]:
        result = invoke(arguments, third_party=target)
        assert_kept(target.parent, before, result)
        if target in arguments and command != "tables":
            assert result.exit_code, f"{arguments} did not refuse"


def test_what_an_earlier_version_sealed_stays_and_is_named_as_such(inputs, tmp_path):
    """Its seals say no kind, so that nothing tells a calibration from picked points."""
    target = tmp_path / "speed.json"
    sealed_before_kinds(target, '{\n "a": 1')
    before = snapshot(tmp_path)
    (arguments,) = calls(inputs, target)["speed"]
    result = invoke(arguments, third_party=target)
    assert_kept(tmp_path, before, result)
    assert f"{target}: was written by an earlier version of uavbench" in result.output


def sealed_before_kinds(path, text):
    """A JSON file with a seal as the first versions wrote it."""
    head = f'{text},\n "made_by": "'.encode()
    path.write_bytes(head + b"uavbench-made-" + hashlib.sha256(head).hexdigest().encode() + b'"\n}\n')
    assert sealed_kind(path) == ""
