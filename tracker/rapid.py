"""`rapid`: control points, the nearest gradient maximum on each search line, least squares (Harris & Stennett 1990)."""

from dataclasses import dataclass
from functools import partial
from typing import Annotated

import numpy as np
from annotated_types import Ge, Gt

from scenes.camera import Camera
from scenes.structure import Structure
from tracker.base import Image, Run
from tracker.published import PublishedRun, choose_nearest
from tracker.search import MIN_GRADIENT, search_gradient
from trajectories.pose import Pose

RAPID_SEARCH_PX = 15.0
"""Half length of a search line: without hypotheses a longer one meets more of what is not the edge."""
RAPID_SPACING_PX = 20.0
"""RAPID takes few control points, 20 to 30 on a structure."""


@dataclass(frozen=True)
class Rapid:
    """Parameters of `rapid`; min_gradient in grey levels per px."""

    control_point_spacing_px: Annotated[float, Gt(0)] = RAPID_SPACING_PX
    search_px: Annotated[float, Gt(0)] = RAPID_SEARCH_PX
    min_gradient: Annotated[float, Gt(0)] = MIN_GRADIENT
    passes: Annotated[int, Ge(1)] = 1

    def start(self, structure: Structure, camera: Camera, cam_from_world: Pose, rng: np.random.Generator) -> Run:
        """Begin a run at a known first pose."""
        return PublishedRun(
            structure,
            camera,
            cam_from_world,
            detect=_nothing,
            search=partial(search_gradient, camera=camera, search_px=self.search_px, min_gradient=self.min_gradient),
            choose=choose_nearest,
            spacing_px=self.control_point_spacing_px,
            passes=self.passes,
        )


def _nothing(gray: Image) -> Image:
    """RAPID detects nothing ahead of its search."""
    return gray
