"""`lsd`: the published method, all eleven steps; `lsd-single`: the same without its hypotheses and RANSAC."""

from dataclasses import dataclass
from functools import partial
from typing import Annotated

import numpy as np
from annotated_types import Ge, Gt

from scenes.camera import Camera
from scenes.structure import Structure
from tracker.base import Image, Run
from tracker.control_points import CONTROL_POINT_SPACING_PX
from tracker.hypotheses import INLIER_PX, RANSAC_HYPOTHESES
from tracker.published import PASSES, PublishedRun, choose_by_ransac, choose_nearest
from tracker.search import SEARCH_PX, search_segments
from tracker.segments import MIN_SEGMENT_PX, detect_segments, undistort_segments
from trajectories.pose import Array, Pose


@dataclass(frozen=True)
class LsdSingle:
    """Parameters of `lsd-single`: the nearest segment on each search line, plain least squares."""

    min_segment_px: Annotated[float, Ge(0)] = MIN_SEGMENT_PX
    control_point_spacing_px: Annotated[float, Gt(0)] = CONTROL_POINT_SPACING_PX
    search_px: Annotated[float, Gt(0)] = SEARCH_PX
    passes: Annotated[int, Ge(1)] = PASSES

    def start(self, structure: Structure, camera: Camera, cam_from_world: Pose, rng: np.random.Generator) -> Run:
        """Begin a run at a known first pose."""
        return PublishedRun(
            structure,
            camera,
            cam_from_world,
            detect=partial(_segments, camera=camera, min_length_px=self.min_segment_px),
            search=partial(search_segments, search_px=self.search_px),
            choose=choose_nearest,
            spacing_px=self.control_point_spacing_px,
            passes=self.passes,
            counts_segments=True,
        )


@dataclass(frozen=True)
class Lsd:
    """Parameters of `lsd`; inlier_px is the orthogonal distance up to which a candidate supports a hypothesis."""

    min_segment_px: Annotated[float, Ge(0)] = MIN_SEGMENT_PX
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
            detect=partial(_segments, camera=camera, min_length_px=self.min_segment_px),
            search=partial(search_segments, search_px=self.search_px),
            choose=choose_by_ransac(rng, self.hypotheses, self.inlier_px),
            spacing_px=self.control_point_spacing_px,
            passes=self.passes,
            counts_segments=True,
        )


def _segments(gray: Image, *, camera: Camera, min_length_px: float) -> Array:
    return undistort_segments(detect_segments(gray, min_length_px), camera)
