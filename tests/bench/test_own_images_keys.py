"""What is in the key of a recording with true poses: all code and all files by which they are read and told of."""

import ast
from pathlib import Path

import pytest

import uavbench.bench.own_images.true_poses as true_poses
from uavbench.bench.inputs.content_hash import content_hash
from uavbench.bench.runner.jobs import TRUE_POSES
from uavbench.bench.trial.check import TRIAL
from uavbench.tracker.images.recorded_sequence import Files, RecordingSpec

ROOT = Path(true_poses.__file__).parents[2]


def imported_by(file):
    """Files of uavbench that a file of it imports, by a module's whole name."""
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("uavbench."):
            name = ROOT / node.module.removeprefix("uavbench.").replace(".", "/")
            yield from (path for path in (name.with_suffix(".py"), name / "__init__.py") if path.is_file())


def test_all_code_that_reads_true_poses_is_in_the_key():
    """That of the layers below is in it as a whole."""
    seen, further = set(), [ROOT / "bench/own_images/true_poses.py"]
    while further:
        file = further.pop()
        if file not in seen and file.relative_to(ROOT).parts[0] in ("bench", "reports"):
            seen.add(file)
            further += imported_by(file)
    assert {file.name for file in seen} > {"conventions.py", "find_trajectory.py", "association.py"}
    assert [file for file in seen if not any(file.is_relative_to(ROOT / package) for package in TRUE_POSES)] == []


@pytest.fixture
def spec(tmp_path):
    """Links to the files of the trial, in a folder with two above it."""
    own = tmp_path / "all" / "own"
    own.mkdir(parents=True)
    for name in ("frames", "model.obj", "camera.toml"):
        (own / name).symlink_to(TRIAL / name)
    (own / "poses.tum").write_text("0 0 0 0 0 0 0 1\n")
    source = Files(images_path=f"{own}/frames", model_file=f"{own}/model.obj", camera_file=f"{own}/camera.toml")
    return RecordingSpec(name="own", seed=0, source=source, ground_truth_file=f"{own}/poses.tum")


@pytest.mark.parametrize("name", ["own/times.txt", "own/sequence.json", "own/export.json", "export.json"])
def test_files_that_tell_what_the_poses_are_are_in_the_key(spec, tmp_path, name):
    keys = [content_hash(spec)]
    for content in ("{}", '{"format": "tum"}'):
        (tmp_path / "all" / name).write_text(content)
        keys.append(content_hash(spec))
    assert len(set(keys)) == 3


def test_files_whose_times_are_compared_with_those_of_the_images_are_in_the_key(spec, tmp_path):
    """A doubt about them went on being told after they were corrected."""
    frames = tmp_path / "all" / "own" / "frames"
    frames.unlink()
    frames.mkdir()
    for image in (TRIAL / "frames").iterdir():
        (frames / image.name).symlink_to(image)
    keys = [content_hash(spec)]
    for place in (frames / "timestamps.txt", frames.with_name("rgb.txt"), frames.parent.with_name("data.csv")):
        place.write_text("0.0\n")
        keys.append(content_hash(spec))
    assert len(set(keys)) == 4
