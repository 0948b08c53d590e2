"""`canny`: the published method with Canny edge pixels in place of LSD segments."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Ge, Gt

from uavbench.scenes.camera import Camera
from uavbench.tracker.protocol import Image
from uavbench.tracker.shang_shen.control_points import ControlPoints
from uavbench.tracker.shang_shen.edge_search import Candidates, search_edge_pixels
from uavbench.tracker.shang_shen.hypotheses import INLIER_PX, RANSAC_HYPOTHESES, Matches, ransac
from uavbench.tracker.shang_shen.pipeline import Published
from uavbench.tracker.shang_shen.segments import CANNY_HIGH, CANNY_LOW, detect_edge_pixels
from uavbench.trajectories.pose import Array


@dataclass(frozen=True)
class Canny(Published):
    """Parameters of `canny`: thresholds of the hysteresis in grey levels; the others as in `lsd`."""

    canny_low: Annotated[float, Gt(0)] = CANNY_LOW
    canny_high: Annotated[float, Gt(0)] = CANNY_HIGH
    hypotheses: Annotated[int, Ge(1)] = RANSAC_HYPOTHESES
    inlier_px: Annotated[float, Gt(0)] = INLIER_PX

    def detect(self, gray: Image, camera: Camera) -> Image:
        """Edge pixels (h, w) of the camera's image."""
        return detect_edge_pixels(gray, self.canny_low, self.canny_high)

    def search(self, points: ControlPoints, edges: Image, camera: Camera) -> Candidates:
        """Edge pixels on the search lines."""
        return search_edge_pixels(points, edges, camera, self.search_px)

    def choose(
        self, candidates: Candidates, points: ControlPoints, J: Array, prior: Array, rng: np.random.Generator
    ) -> Matches:
        """Steps 8 and 9, as in `lsd`."""
        return ransac(candidates, J, points.edge, prior, rng, hypotheses=self.hypotheses, inlier_px=self.inlier_px)
