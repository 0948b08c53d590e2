"""Clutter that a tracker may confuse with the structure: cardboard boxes of other sizes."""

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from annotated_types import Gt, Interval

from uavbench.scenes.clutter.placing import Free, anywhere, check_reach
from uavbench.scenes.renderables import BuiltClutter, Part
from uavbench.scenes.structures.box import Box
from uavbench.trajectories.pose import Array, rotation_exp

INSTANCE = 10


@dataclass(frozen=True)
class Lookalikes:
    """Cardboard boxes at random positions around the structure; their number is at most 10 times density.

    UserError when nearest_m is above furthest_m.
    """

    density: Annotated[float, Interval(ge=0, le=10)] = 0.5
    nearest_m: Annotated[float, Gt(0)] = 0.45
    furthest_m: Annotated[float, Gt(0)] = 2.2

    def __post_init__(self) -> None:
        if self.nearest_m != self.furthest_m:
            check_reach(self.nearest_m, self.furthest_m)

    def build(self, bounds: Array, rng: np.random.Generator, free: Free = anywhere) -> BuiltClutter:
        """Boxes on free ground around a structure of bounds (2, 3) in metres, world frame.

        The gap to the circle about the bounds is uniform in nearest_m..furthest_m; a box whose position is not free is
        left out. Each box has its own instance in the mask, from 10 up.
        """
        parts: list[Part] = []
        centre, reach = bounds.mean(axis=0), float(np.linalg.norm((bounds[1] - bounds[0])[:2]) / 2)
        for number in range(round(10 * self.density)):
            size = rng.uniform([0.2, 0.15, 0.1], [0.45, 0.35, 0.4])
            built = Box(*(float(s) for s in size)).build(rng)
            bearing, turn = rng.uniform(0, 2 * np.pi, 2)
            radius = float(np.hypot(size[0], size[1]) / 2)
            away = reach + radius + self.nearest_m + rng.uniform(0, self.furthest_m - self.nearest_m)
            place = np.array([*(centre[:2] + away * np.array([np.cos(bearing), np.sin(bearing)])), 0.0])
            if not free(place[None, :2])[0]:
                continue
            R = rotation_exp(np.array([0, 0, turn]))
            for part in built.parts:
                assert part.normals is not None
                parts.append(
                    replace(
                        part,
                        vertices=part.vertices @ R.T + place,
                        normals=part.normals @ R.T,
                        instance=min(INSTANCE + number, 99),
                    )
                )
        return BuiltClutter(tuple(parts))
