"""New patches are taken no faster than the error that all patches share is forgotten, whatever the rate of frames."""

import numpy as np
import pytest

from tests.tracker.synthetic import CAMERA, box, flown
from uavbench.tracker.robust.config import RobustConfig
from uavbench.tracker.robust.fit.learning import TAKE_AFTER_S, TAKE_EVERY
from uavbench.tracker.robust.fit.pose_fit import MIN_POINTS
from uavbench.tracker.robust.patches.patches import Texture
from uavbench.tracker.robust.tracker import Robust


def times_of_taking(monkeypatch, frame_s):
    """Times in s at which patches are taken while enough of them are found."""
    taken, take = [], Texture.take

    def noted(texture, image, pose, edge_pixels):
        if len(texture.chosen) >= MIN_POINTS:
            taken.append(texture.now_s)
        take(texture, image, pose, edge_pixels)

    monkeypatch.setattr(Texture, "take", noted)
    poses, images = flown(33, seed=11)
    run = Robust(RobustConfig()).start(box(), CAMERA, poses[0], np.random.default_rng(0))
    for k, image in enumerate(images):
        assert run.track(image, round(k * frame_s * 1e9)).status == "ok"
    return np.array(taken)


@pytest.mark.parametrize("frame_s", [1 / 60, 1 / 15, 1 / 5])
def test_patches_are_taken_no_faster_than_their_error_is_forgotten(monkeypatch, frame_s):
    taken = times_of_taking(monkeypatch, frame_s)
    between = np.diff(np.concatenate([[0.0], taken]))
    assert len(taken) == 0 or between.min() > TAKE_AFTER_S
    assert len(taken) <= 32 * frame_s / max(TAKE_AFTER_S, TAKE_EVERY * frame_s) + 1
