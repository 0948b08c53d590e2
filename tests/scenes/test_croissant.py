"""Every export is described by a croissant.json; MLCommons' own validator reads it where it is installed."""

import fnmatch
import hashlib
import json
import shutil
import subprocess
from pathlib import Path

import pytest

from tests.reports.drawn import make_sequence
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.scenes.exports.registry import EXPORTS, export
from uavbench.trajectories.files.listed import tree

FRAMES = 10
RAI = (
    "dataCollection", "dataCollectionType", "dataAnnotationProtocol", "dataBiases", "dataUseCases", "dataLimitations",
    "personalSensitiveInformation", "dataSocialImpact", "dataReleaseMaintenancePlan",
)  # fmt: skip


@pytest.fixture(scope="module")
def exported(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Folders by format."""
    base = tmp_path_factory.mktemp("exported")
    sequence = make_sequence(base / "sequence", FRAMES)
    for name in EXPORTS:
        export(sequence, name, base / name)
    return {name: base / name for name in EXPORTS}


@pytest.mark.parametrize("name", list(EXPORTS))
def test_every_file_is_described_once(name: str, exported: dict[str, Path]) -> None:
    folder = exported[name]
    about = json.loads((folder / "croissant.json").read_text())
    files = {each["@id"]: each for each in about["distribution"]}
    for file in tree(folder):
        if file == "croissant.json":
            continue
        if file in files:
            assert files[file]["sha256"] == hashlib.sha256((folder / file).read_bytes()).hexdigest()
        else:
            assert len([each for each in files if fnmatch.fnmatchcase(file, each)]) == 1, file
    assert all(not any(c.isspace() for c in each) for each in files)
    assert [key for key in RAI if not about[f"rai:{key}"]] == []
    not_held = json.loads((folder / "export.json").read_text())["not_held"]
    assert about["rai:dataLimitations"] == not_held or not not_held
    images = [each for each in files.values() if each["encodingFormat"] == "image/png" and "includes" in each]
    assert len(about["recordSet"]) == len(images)


@pytest.mark.parametrize("name", list(EXPORTS))
def test_the_same_sequence_gives_the_same_bytes(name: str, exported: dict[str, Path], tmp_path: Path) -> None:
    export(Sequence.load(exported[name].parent / "sequence"), name, tmp_path / "again")
    again = {file: (tmp_path / "again" / file).read_bytes() for file in tree(tmp_path / "again")}
    assert again == {file: (exported[name] / file).read_bytes() for file in tree(exported[name])}


@pytest.mark.parametrize("name", list(EXPORTS))
def test_the_validator_finds_no_error(name: str, exported: dict[str, Path]) -> None:
    validator = shutil.which("mlcroissant")
    if validator is None:
        pytest.skip("mlcroissant is not installed; CI installs it in an environment of its own")
    command = [validator, "validate", "--jsonld", str(exported[name] / "croissant.json")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0 and "error(s)" not in done.stderr, done.stderr
