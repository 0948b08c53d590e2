"""Folders of sequences that were copied, edited, or cut: each mistake is told with what to do."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from uavbench.bench.trial.check import TRIAL
from uavbench.scenes.dataset.sequence import Sequence, open_sequence
from uavbench.scenes.dataset.verify import verify, write_manifest
from uavbench.trajectories.errors import UserError


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A copy of the bundled sequence."""
    return Path(shutil.copytree(TRIAL, tmp_path / "copy"))


def test_a_folder_without_its_images_is_told_as_it_is_opened(folder: Path) -> None:
    """Its poses can still be read."""
    (folder / "frames/000001.png").unlink()
    with pytest.warns(UserWarning, match="1 of its 10 images are missing, the first one frames/000001"):
        opened = open_sequence(folder)
    assert np.array_equal(opened.ground_truth.positions_m, Sequence.load(TRIAL).ground_truth.positions_m)


def test_a_manifest_is_not_written_over_another(folder: Path) -> None:
    (folder / "frames.csv").write_text("edited")
    before = (folder / "manifest.json").read_bytes()
    with pytest.raises(
        UserError, match=r"manifest.json: exists; `uavbench verify .*` tells what .* once it is deleted"
    ):
        write_manifest(folder)
    assert (folder / "manifest.json").read_bytes() == before
    (folder / "manifest.json").unlink()
    write_manifest(folder)
    assert verify(folder).ok


def test_a_file_that_is_not_as_it_was_written_need_not_be_rendered_again(folder: Path) -> None:
    """It may have come from elsewhere."""
    about = json.loads((folder / "sequence.json").read_text())
    del about["cam_from_body"]
    (folder / "sequence.json").write_text(json.dumps(about))
    with pytest.raises(UserError, match="`cam_from_body` is missing; copy the folder again, or render or import it"):
        _ = open_sequence(folder).cam_from_body
