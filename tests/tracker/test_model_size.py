"""A model in millimetres is doubted: poses are then in millimetres, and no image tells."""

import numpy as np
import pytest

from uavbench.scenes.primitives.meshes import box
from uavbench.scenes.structure import Structure
from uavbench.tracker.images.model_size import doubts_of_size
from uavbench.trajectories.pose import Pose


@pytest.mark.parametrize(
    ("size_m", "away_m", "told"),
    [
        (0.4, 1.2, ""),
        (120.0, 60.0, ""),
        (400.0, 1200.0, "the model is 400 m large, and 1,200 m away in the first image: is it in millimetres"),
        (84.0, 350.0, "the model is 84 m large, and 350 m away"),
    ],
)
def test_a_model_that_is_too_large_or_too_far_for_metres_is_doubted(size_m: float, away_m: float, told: str) -> None:
    half = size_m / 2
    structure = Structure.from_mesh(*box((-half, -half / 2, -half / 2), (half, half / 2, half / 2)))
    found = doubts_of_size(structure, Pose(np.eye(3), np.array([0.0, 0.0, away_m])))
    assert [told in each for each in found] == [True] * bool(told)
