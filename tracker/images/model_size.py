"""Plausibility of the unit of a model, which nothing in images tells: poses are in the model's unit."""

import numpy as np

from uavbench.scenes.structure import Structure
from uavbench.trajectories.pose import Pose

FAR = 200.0
"""Size of a model, and distance of a camera from it, from which it may be in mm: few structures and flights have it."""


def doubts_of_size(structure: Structure, cam_from_world: Pose) -> list[str]:
    """Message on a model that is very large, or very far away in the first image, for metres."""
    low, high = structure.bounds
    size = float((high - low).max())
    away = float(np.linalg.norm(cam_from_world.transform((low + high)[None] / 2)))
    if max(size, away) < FAR:
        return []
    return [
        f"the model is {size:,.4g} m large, and {away:,.4g} m away in the first image: is it in millimetres? Poses are "
        "then in millimetres, too; scale it to metres, and the points of the initial pose"
    ]
