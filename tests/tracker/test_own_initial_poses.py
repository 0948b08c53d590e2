"""Initial poses of users: what is no pose, or another one for each tracker, is told, and the image stays as it is."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from uavbench.tracker.initialization import Known, initial_pose_of
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.pose import Pose

TRUE = Pose(np.eye(3), np.array([0.0, 0.0, 2.0]))


@dataclass(frozen=True)
class Own:
    """The true pose moved along x by a function of the generator, after the image was painted black."""

    shift: Any

    def initial_pose(self, structure: Any, camera: Any, true: Pose, image: Any, rng: np.random.Generator) -> Any:
        image[:] = 0
        moved = self.shift(rng)
        return Pose.exp([moved, 0, 0, 0, 0, 0]) @ true if isinstance(moved, float) else moved


def started(start: Any, image: Any) -> Pose:
    nothing: Any = None
    return initial_pose_of(start, nothing, nothing, TRUE, image, np.random.default_rng(0))


def test_a_pose_of_the_generator_given_is_taken_and_the_image_is_left_to_the_tracker() -> None:
    image = np.full((12, 16, 3), 100, dtype=np.uint8)
    found = started(Own(lambda rng: 0.01 * rng.random()), image)
    assert found.translation[0] == pytest.approx(0.01 * np.random.default_rng(0).random())
    assert (image == 100).all()
    assert started(Known(), image) is TRUE


@pytest.mark.parametrize(("shift", "told"), [
    (lambda rng: np.random.random(), "initial_pose gives another pose each time; take all random numbers from"),  # noqa: NPY002
    (lambda rng: TRUE.matrix, "initial_pose gives a ndarray; it takes a Pose, cam_from_world"),
    (lambda rng: None, "initial_pose gives a NoneType; it takes a Pose"),
])  # fmt: skip
def test_a_pose_that_is_none_or_another_for_each_tracker_is_told(shift: Any, told: str) -> None:
    with pytest.raises(UserError, match=f"start .*:Own: {told}"):
        started(Own(shift), np.zeros((12, 16, 3), dtype=np.uint8))
