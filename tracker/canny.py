"""`canny`: the published method with Canny edge pixels in place of LSD segments."""

from dataclasses import dataclass
from functools import partial
from typing import Annotated

import numpy as np
from annotated_types import Ge, Gt

from scenes.camera import Camera
from scenes.structure import Structure
from tracker.base import Run
from tracker.control_points import CONTROL_POINT_SPACING_PX
from tracker.hypotheses import INLIER_PX, RANSAC_HYPOTHESES
from tracker.published import PASSES, PublishedRun, choose_by_ransac
from tracker.search import SEARCH_PX, search_edge_pixels
from tracker.segments import CANNY_HIGH, CANNY_LOW, detect_edge_pixels
from trajectories.pose import Pose


@dataclass(frozen=True)
class Canny:
    """Parameters of `canny`: thresholds of the hysteresis in grey levels; the others as in `lsd`."""

    canny_low: Annotated[float, Gt(0)] = CANNY_LOW
    canny_high: Annotated[float, Gt(0)] = CANNY_HIGH
    control_point_spacing_px: Annotated[float, Gt(0)] = CONTROL_POINT_SPACING_PX
    search_px: Annotated[float, Gt(0)] = SEARCH_PX
    hypotheses: Annotated[int, Ge(1)] = RANSAC_HYPOTHESES
    inlier_px: Annotated[float, Gt(0)] = INLIER_PX
    passes: Annotated[int, Ge(1)] = PASSES

    def start(self, structure: Structure, camera: Camera, cam_from_world: Pose, rng: np.random.Generator) -> Run:
        """Begin a run at a known first pose."""
        return PublishedRun(
            structure,
            camera,
            cam_from_world,
            detect=partial(detect_edge_pixels, low=self.canny_low, high=self.canny_high),
            search=partial(search_edge_pixels, camera=camera, search_px=self.search_px),
            choose=choose_by_ransac(rng, self.hypotheses, self.inlier_px),
            spacing_px=self.control_point_spacing_px,
            passes=self.passes,
        )
