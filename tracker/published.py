"""The published loop (Shang & Shen): project, detect, search, choose, update; the new pose predicts the next frame.

Step 1, the model, is `scenes.structure`; step 2, calibration, `scenes.calibrate`; step 3, the first pose,
`tracker.initial_pose`. The variants differ in what they detect and how they choose among the candidates.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from scenes.camera import Camera
from scenes.structure import Structure
from tracker.base import Image, TrackResult
from tracker.clock import StageClock
from tracker.control_points import ControlPoints, control_points
from tracker.hypotheses import INLIER_PX, Matches, ransac
from tracker.pose_update import normal_jacobian, prior_information, update_pose
from tracker.search import Candidates
from tracker.segments import grey
from tracker.visible_edges import visible_edges
from trajectories.pose import Array, Pose

MIN_MATCHES = 5
"""Fewer matched control points than this fix no pose (the paper's PnP takes five points)."""

PASSES = 3
"""Times that a frame is projected, searched and solved, each from the pose of the one before."""

Detect = Callable[[Image], Any]
Search = Callable[[ControlPoints, Any], Candidates]
Choose = Callable[[Candidates, ControlPoints, Array, Array], Matches]


class PublishedRun:
    """One run of the loop with the stages that make a variant."""

    def __init__(
        self,
        structure: Structure,
        camera: Camera,
        cam_from_world: Pose,
        *,
        detect: Detect,
        search: Search,
        choose: Choose,
        spacing_px: float,
        passes: int,
        counts_segments: bool = False,
    ) -> None:
        self.structure, self.camera, self.cam_from_world = structure, camera, cam_from_world
        self.detect, self.search, self.choose = detect, search, choose
        self.spacing_px, self.passes, self.counts_segments = spacing_px, passes, counts_segments

    def track(self, image: Image, stamp_ns: int) -> TrackResult:
        """Estimate at the next frame."""
        clock = StageClock()
        with clock.stage("detect"):
            edges = self.detect(grey(image))
        pose = self.cam_from_world
        result = TrackResult(status="lost", stage_ms=clock.ms, segments=len(edges) if self.counts_segments else None)
        for _ in range(self.passes):
            with clock.stage("project"):
                points = control_points(visible_edges(self.structure, self.camera, pose), self.spacing_px)
            with clock.stage("search"):
                candidates = self.search(points, edges)
            result = replace(result, control_points=len(points), candidates=int(candidates.counts.sum()), inliers=0)
            if np.count_nonzero(candidates.counts) < MIN_MATCHES:
                return result
            with clock.stage("choose"):
                cam = pose.transform(points.points_m)
                J = normal_jacobian(cam, points.normals, self.camera)
                matches = self.choose(candidates, points, J, prior_information(float(np.median(cam[:, 2]))))
            result = replace(result, inliers=int(matches.inlier.sum()))
            if np.count_nonzero(matches.inlier) < MIN_MATCHES:
                return result
            with clock.stage("update"):
                chosen = points.select(matches.inlier)
                pose, _ = update_pose(chosen, matches.distances[matches.inlier], self.camera, pose)
        self.cam_from_world = pose
        return replace(result, status="ok", cam_from_world=pose)


def choose_by_ransac(rng: np.random.Generator, hypotheses: int, inlier_px: float = INLIER_PX) -> Choose:
    """Steps 8 and 9: several candidates kept, RANSAC over them."""

    def choose(candidates: Candidates, points: ControlPoints, J: Array, prior: Array) -> Matches:
        return ransac(candidates, J, points.edge, prior, rng, hypotheses=hypotheses, inlier_px=inlier_px)

    return choose


def choose_nearest(candidates: Candidates, points: ControlPoints, J: Array, prior: Array) -> Matches:
    """One hypothesis for each control point, its nearest candidate, and nothing refused."""
    return Matches(candidates.distances[:, 0], candidates.counts > 0)
