"""`lsd`: the published method, all eleven steps; `lsd-single`: the same without its hypotheses and RANSAC."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np
from annotated_types import Ge, Gt

from uavbench.scenes.camera import Camera
from uavbench.tracker.protocol import Image
from uavbench.tracker.shang_shen.control_points import ControlPoints
from uavbench.tracker.shang_shen.edge_search import Candidates, search_segments
from uavbench.tracker.shang_shen.hypotheses import INLIER_PX, RANSAC_HYPOTHESES, Matches, ransac
from uavbench.tracker.shang_shen.pipeline import Published
from uavbench.tracker.shang_shen.segments import MIN_SEGMENT_PX, detect_segments, undistort_segments
from uavbench.trajectories.pose import Array


@dataclass(frozen=True)
class LsdSingle(Published):
    """Parameters of `lsd-single`: the nearest segment on each search line, plain least squares."""

    counts_segments: ClassVar[bool] = True

    min_segment_px: Annotated[float, Ge(0)] = MIN_SEGMENT_PX

    def detect(self, gray: Image, camera: Camera) -> Array:
        """Undistorted LSD segments (m, 4)."""
        return undistort_segments(detect_segments(gray, self.min_segment_px), camera)

    def search(self, points: ControlPoints, edges: Array, camera: Camera) -> Candidates:
        """Crossings of the search lines with the segments."""
        return search_segments(points, edges, self.search_px)


@dataclass(frozen=True)
class Lsd(LsdSingle):
    """Parameters of `lsd`; inlier_px: orthogonal distance up to which a candidate supports a hypothesis."""

    hypotheses: Annotated[int, Ge(1)] = RANSAC_HYPOTHESES
    inlier_px: Annotated[float, Gt(0)] = INLIER_PX

    def choose(
        self, candidates: Candidates, points: ControlPoints, J: Array, prior: Array, rng: np.random.Generator
    ) -> Matches:
        """Steps 8 and 9: several candidates kept, RANSAC over them."""
        return ransac(candidates, J, points.edge, prior, rng, hypotheses=self.hypotheses, inlier_px=self.inlier_px)
