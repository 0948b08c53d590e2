"""The published loop (Shang & Shen): project, detect, search, choose, update; the new pose predicts the next frame.

Step 1, the model, is `scenes.structure`; step 2, calibration, `scenes.calibration`; step 3, the initial pose,
`uavbench.tracker.initialization`. The variants differ in what they detect and how they choose among the candidates.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

import numpy as np
from annotated_types import Ge, Gt

from uavbench.scenes.camera import Camera
from uavbench.scenes.structure import Structure
from uavbench.tracker.protocol import Image, Run, StampOrder, TrackResult, check_image, check_start
from uavbench.tracker.shang_shen.control_points import CONTROL_POINT_SPACING_PX, ControlPoints, control_points
from uavbench.tracker.shang_shen.edge_search import SEARCH_PX, Candidates
from uavbench.tracker.shang_shen.hypotheses import Matches
from uavbench.tracker.shang_shen.pose_update import normal_jacobian, prior_information, update_pose
from uavbench.tracker.shang_shen.segments import grey
from uavbench.tracker.stage_clock import StageClock
from uavbench.tracker.visible_edges import visible_edges
from uavbench.trajectories.kernels.warm_up import prepare
from uavbench.trajectories.pose import Array, Pose

MIN_MATCHES = 5
"""Least number of matched control points for a pose (the paper's PnP takes five points)."""

PASSES = 3
"""Iterations of projection, search and solution per frame, each from the previous pose."""


@dataclass(frozen=True)
class Published(ABC):
    """Base of the variants of the published loop: its parameters, and its start."""

    counts_segments: ClassVar[bool] = False

    control_point_spacing_px: Annotated[float, Gt(0)] = CONTROL_POINT_SPACING_PX
    search_px: Annotated[float, Gt(0)] = SEARCH_PX
    passes: Annotated[int, Ge(1)] = PASSES

    @abstractmethod
    def detect(self, gray: Image, camera: Camera) -> Any:
        """Step 5: the edges of an image, in the form that `search` takes."""

    @abstractmethod
    def search(self, points: ControlPoints, edges: Any, camera: Camera) -> Candidates:
        """Step 7: the candidates of each control point."""

    def choose(
        self, candidates: Candidates, points: ControlPoints, J: Array, prior: Array, rng: np.random.Generator
    ) -> Matches:
        """The nearest candidate of each control point, without outlier rejection."""
        return Matches(candidates.distances[:, 0], candidates.counts > 0)

    def start(self, structure: Structure, camera: Camera, cam_from_world: Pose, rng: np.random.Generator) -> Run:
        """Start a run from a known initial pose; StartError for inputs of another type, and when that pose is none."""
        first = check_start(structure, camera, cam_from_world, rng)
        prepare(__name__)
        return PublishedRun(self, structure, camera, first, rng)


class PublishedRun:
    """One run of the loop with the stages of a variant."""

    def __init__(
        self,
        variant: Published,
        structure: Structure,
        camera: Camera,
        cam_from_world: Pose,
        rng: np.random.Generator,
    ) -> None:
        self.variant, self.structure, self.camera = variant, structure, camera
        self.cam_from_world, self.rng, self.order = cam_from_world, rng, StampOrder()

    def track(self, image: Image, stamp_ns: int) -> TrackResult:
        """Estimate at the next frame; ImageError for an image of another size or type, StampError for no stamp."""
        image = check_image(image, self.camera)
        if not self.order.is_later(stamp_ns):
            return TrackResult(status="lost")
        variant, camera, clock = self.variant, self.camera, StageClock()
        with clock.stage("detect"):
            edges = variant.detect(grey(image), camera)
        pose = self.cam_from_world
        found: dict[str, Any] = {"segments": len(edges)} if variant.counts_segments else {}
        for _ in range(variant.passes):
            with clock.stage("project"):
                points = control_points(visible_edges(self.structure, camera, pose), variant.control_point_spacing_px)
            with clock.stage("search"):
                candidates = variant.search(points, edges, camera)
            found |= {"control_points": len(points), "candidates": int(candidates.counts.sum()), "inliers": 0}
            if np.count_nonzero(candidates.counts) < MIN_MATCHES:
                return TrackResult(status="lost", stage_ms=clock.ms, **found)
            with clock.stage("hypotheses"):
                cam = pose.transform(points.points_m)
                J = normal_jacobian(cam, points.normals, camera)
                prior = prior_information(float(np.median(cam[:, 2])))
                matches = variant.choose(candidates, points, J, prior, self.rng)
            found["inliers"] = int(matches.inlier.sum())
            if found["inliers"] < MIN_MATCHES:
                return TrackResult(status="lost", stage_ms=clock.ms, **found)
            with clock.stage("update"):
                chosen = points.select(matches.inlier)
                pose, _ = update_pose(chosen, matches.distances[matches.inlier], camera, pose)
        self.cam_from_world = pose
        return TrackResult(status="ok", cam_from_world=pose, stage_ms=clock.ms, **found)
