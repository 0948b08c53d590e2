"""Recordings of users: what cannot be tracked, or is another one each time, is told by what is wrong with it."""

from dataclasses import dataclass, replace
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from uavbench.bench.trial.check import TRIAL
from uavbench.scenes.camera import Camera
from uavbench.scenes.dataset.sequence import load_structure
from uavbench.tracker.images.recorded_sequence import Recording, recording_of
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.pose import Pose

IMAGES = tuple(sorted((TRIAL / "frames").iterdir()))
POSE = Pose(np.eye(3), np.array([0.0, 0.0, 2.0]))
FOUND = Recording(IMAGES, Camera.load(TRIAL / "camera.toml"), load_structure(TRIAL), POSE)
CALLS = count()


@dataclass(frozen=True)
class Own:
    """A source that finds what a function gives."""

    found: Any

    def find(self) -> Any:
        return self.found()


def test_a_recording_is_taken_as_it_is() -> None:
    assert recording_of(Own(lambda: FOUND)) is FOUND


@pytest.mark.parametrize(("found", "told"), [
    (lambda: None, "find gives a NoneType; it takes a Recording"),
    (lambda: replace(FOUND, images=()), "its images are no paths of files; it takes a tuple of one Path or more"),
    (lambda: replace(FOUND, images=tuple(map(str, IMAGES))), "its images are no paths of files"),
    (lambda: replace(FOUND, initial_cam_from_world=POSE.matrix), "its initial_cam_from_world is a ndarray; it takes"),
    (lambda: replace(FOUND, camera=Path("camera.toml")), "its camera is a PosixPath; it takes a Camera"),
    (lambda: replace(FOUND, images=IMAGES[:: 1 - 2 * (next(CALLS) % 2)]), "find gives another recording each time"),
])  # fmt: skip
def test_a_recording_that_cannot_be_tracked_or_is_another_each_time_is_told(found: Any, told: str) -> None:
    with pytest.raises(UserError, match=f"recording .*:Own: {told}"):
        recording_of(Own(found))
