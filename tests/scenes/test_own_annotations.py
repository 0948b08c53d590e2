"""Masks and depth that somebody put into a sequence folder are right, or told; never silently left out."""

import shutil

import cv2
import numpy as np
import pytest
from click.testing import CliRunner
from PIL import Image

from uavbench.bench.cli.main import main
from uavbench.bench.trial.check import TRIAL
from uavbench.scenes.dataset.sequence import Sequence

MASK = np.zeros((120, 160), np.uint8)
MASK[20:80, 40:120] = 1


def palette(path):
    image = Image.fromarray(MASK, "P")
    image.putpalette([0, 0, 0, 255, 255, 255])
    image.save(path)


def written(image):
    return lambda path: cv2.imwrite(str(path), image)


WRONG = {
    "of another size": (written(MASK[::2, ::2]), "has 80 x 60 px of 8 bits; expected 160 x 120 px"),
    "of 16 bits": (written(MASK.astype(np.uint16)), "has 160 x 120 px of 16 bits; expected .* of 8 bits"),
    "in colour": (written(np.dstack([MASK] * 3)), ".* of 8 bits, 3 channels; expected .* in one channel"),
    "with a palette": (palette, ".* 3 channels; expected .* without a palette"),
    "of 255": (written(MASK * 255), "has the value 255, which no instance has .*; write 1 for the structure"),
    "of one bit": (lambda path: Image.fromarray(MASK > 0).save(path), "has the value 255"),
    "missing": (lambda path: None, r"is missing, while the folder mask/ is there, .* for each of the 10 frames"),
    "of another name": (lambda path: written(MASK)(path.with_name("mask_3.png")), "is missing, while the folder"),
}


@pytest.fixture
def sequence(tmp_path):
    """A folder like the bundled trial, with a mask of each frame."""
    shutil.copytree(TRIAL, tmp_path / "own")
    (tmp_path / "own" / "mask").mkdir()
    for frame in range(10):
        written(MASK)(tmp_path / "own" / "mask" / f"{frame:06d}.png")
    return tmp_path / "own"


def test_masks_of_ones_own_are_read_and_exported(sequence, tmp_path):
    np.testing.assert_array_equal(Sequence.load(sequence)[3].mask, MASK)
    done = CliRunner().invoke(main, ["export", str(sequence), "--format", "colmap", "--out", str(tmp_path / "colmap")])
    assert done.exit_code == 0
    exported = cv2.imread(str(tmp_path / "colmap" / "masks" / "000003.png.png"), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(exported, MASK * 255)


def test_instances_of_clutter_of_ones_own_are_read(sequence):
    instances = MASK * 7
    written(instances)(sequence / "mask" / "000003.png")
    np.testing.assert_array_equal(Sequence.load(sequence)[3].mask, instances)


@pytest.mark.parametrize("form", ["colmap", "bop", "transforms"])
@pytest.mark.parametrize(("write", "told"), WRONG.values(), ids=WRONG)
def test_a_mask_that_is_none_of_the_camera_is_told_with_its_frame(sequence, tmp_path, form, write, told):
    (sequence / "mask" / "000003.png").unlink()
    write(sequence / "mask" / "000003.png")
    done = CliRunner().invoke(main, ["export", str(sequence), "--format", form, "--out", str(tmp_path / "out")])
    assert done.exit_code == 2 and isinstance(done.exception, SystemExit), done.exception
    assert not (tmp_path / "out").exists()
    with pytest.raises(Exception, match=rf"mask/000003\.png: {told}") as error:
        _ = Sequence.load(sequence)[3].mask
    assert str(error.value) in done.output
