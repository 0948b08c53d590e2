"""`vo`: monocular visual odometry on features, which uses the structure for its initial pose only.

Corners are tracked by optical flow (Lucas & Kanade 1981) and triangulated once their parallax suffices; each frame's
pose is found by PnP on the triangulated corners. Frame and scale come from the initial pose: the first corners on the
structure are back-projected onto it. The structure is not used afterwards, so `vo` shows how a model-free method
drifts.
"""

from dataclasses import dataclass
from typing import Annotated, Any

import cv2
import numpy as np
from annotated_types import Ge, Gt

from uavbench.scenes.camera import Camera
from uavbench.scenes.structure import Structure
from uavbench.tracker.protocol import Image, Run, StampOrder, TrackResult, check_image, check_start
from uavbench.tracker.shang_shen.segments import grey
from uavbench.tracker.stage_clock import StageClock
from uavbench.trajectories.geometry.bvh import build_tree
from uavbench.trajectories.geometry.rays import ray_distances
from uavbench.trajectories.kernels.warm_up import prepare
from uavbench.trajectories.pose import Array, Pose

MIN_CORNERS = 12
"""Least number of triangulated corners for a pose."""
OUTLIER_PX = 2.0


@dataclass(frozen=True)
class Vo:
    """Parameters of `vo`: number of tracked corners, their least spacing, and the least parallax for triangulation."""

    corners: Annotated[int, Ge(20)] = 300
    apart_px: Annotated[float, Gt(0)] = 10.0
    parallax_rad: Annotated[float, Gt(0)] = 0.03

    def start(self, structure: Structure, camera: Camera, cam_from_world: Pose, rng: np.random.Generator) -> Run:
        """Start a run from a known initial pose; StartError for inputs of another type, and when that pose is none."""
        first = check_start(structure, camera, cam_from_world, rng)
        prepare(__name__)
        return VoRun(self, structure, camera, first)


class VoRun:
    """A run of `vo`."""

    def __init__(self, parameters: Vo, structure: Structure, camera: Camera, cam_from_world: Pose) -> None:
        self.parameters, self.structure, self.camera, self.pose = parameters, structure, camera, cam_from_world
        self.order = StampOrder()
        self.last: Image | None = None
        self.pixels = np.zeros((0, 2))  # current pixel of each corner
        self.points = np.zeros((0, 3))  # its position in the world
        self.first_eye = np.zeros((0, 3))  # camera centre and ray in the world at its first observation
        self.first_ray = np.zeros((0, 3))
        self.placed = np.zeros(0, dtype=bool)

    def track(self, image: Image, stamp_ns: int) -> TrackResult:
        """Estimate at the next frame; ImageError for an image of another size or type, StampError for no stamp."""
        image = check_image(image, self.camera)
        if not self.order.is_later(stamp_ns):
            return TrackResult(status="lost")
        clock = StageClock()
        gray = grey(image)
        if self.last is not None:
            with clock.stage("flow"):
                self._follow(gray)
            with clock.stage("pose"):
                if not self._solve():
                    self.last = gray
                    return TrackResult(status="lost", stage_ms=clock.ms, candidates=len(self.pixels))
        with clock.stage("map"):
            self._triangulate()
            self._add(gray)
        self.last = gray
        return TrackResult(
            status="ok",
            cam_from_world=self.pose,
            stage_ms=clock.ms,
            candidates=len(self.pixels),
            inliers=int(self.placed.sum()),
        )

    def _follow(self, gray: Image) -> None:
        assert self.last is not None
        if not len(self.pixels):
            return
        start = self.pixels.astype(np.float32).reshape(-1, 1, 2)
        there, good, _ = cv2.calcOpticalFlowPyrLK(self.last, gray, start, start.copy())
        back, good_back, _ = cv2.calcOpticalFlowPyrLK(gray, self.last, there, start.copy())
        closed = np.linalg.norm((back - start).reshape(-1, 2), axis=1) < 0.5
        self.pixels = there.reshape(-1, 2).astype(np.float64)
        self._keep((good.ravel() > 0) & (good_back.ravel() > 0) & closed)

    def _solve(self) -> bool:
        """PnP on the triangulated corners; outliers are dropped."""
        rows = np.flatnonzero(self.placed)
        if len(rows) < MIN_CORNERS:
            return False
        flat = self.camera.undistort(self.pixels[rows])
        cv2.setRNGSeed(0)
        found, rotation, translation, inliers = cv2.solvePnPRansac(
            self.points[rows],
            flat,
            self.camera.K,
            np.zeros(4),
            cv2.Rodrigues(self.pose.rotation)[0],
            self.pose.translation.reshape(3, 1).copy(),
            useExtrinsicGuess=True,
            iterationsCount=100,
            reprojectionError=OUTLIER_PX,
        )
        if not found or inliers is None or len(inliers) < MIN_CORNERS:
            return False
        self.pose = Pose(
            np.asarray(cv2.Rodrigues(rotation)[0], np.float64), np.asarray(translation, np.float64).reshape(3)
        )
        keep = np.ones(len(self.pixels), dtype=bool)
        keep[rows] = False
        keep[rows[inliers.ravel()]] = True
        self._keep(keep)
        return True

    def _rays(self, pixels: Array) -> Array:
        rays = self.camera.rays(pixels) @ self.pose.rotation
        return np.asarray(rays / np.linalg.norm(rays, axis=1, keepdims=True))

    def _triangulate(self) -> None:
        """Triangulate corners with enough parallax since their first observation, by the midpoint of the two rays."""
        if not len(self.pixels):
            return
        eye, rays = self.pose.inverse().translation, self._rays(self.pixels)
        base = eye - self.first_eye
        cosine = np.einsum("ij,ij->i", rays, self.first_ray)
        turned = ~self.placed & (np.arccos(np.clip(cosine, -1, 1)) > self.parameters.parallax_rad)
        for k in np.flatnonzero(turned):
            A = np.column_stack([self.first_ray[k], -rays[k]])
            along = np.linalg.lstsq(A, base[k], rcond=None)[0]
            if along.min() > 0:
                self.points[k] = (self.first_eye[k] + along[0] * self.first_ray[k] + eye + along[1] * rays[k]) / 2
                self.placed[k] = True

    def _add(self, gray: Image) -> None:
        """Start tracking new corners; in the first frame those on the structure are back-projected onto it."""
        missing = self.parameters.corners - len(self.pixels)
        if missing < self.parameters.corners // 4:
            return
        mask = np.full(gray.shape, 255, dtype=np.uint8)
        for x, y in np.round(self.pixels).astype(int).tolist():
            cv2.circle(mask, (x, y), int(self.parameters.apart_px), 0, -1)
        found: Any = cv2.goodFeaturesToTrack(gray, missing, 0.01, self.parameters.apart_px, mask=mask)
        if found is None:
            return
        pixels = found.reshape(-1, 2).astype(np.float64)
        rays, eye = self._rays(pixels), self.pose.inverse().translation
        distance = np.full(len(pixels), np.inf)
        if self.last is None:
            tree = build_tree(self.structure.vertices[self.structure.triangles])
            distance = ray_distances(tree, np.broadcast_to(eye, rays.shape), rays)
        placed = np.isfinite(distance)
        self.pixels = np.concatenate([self.pixels, pixels])
        self.points = np.concatenate([self.points, eye + np.where(placed, distance, 1.0)[:, None] * rays])
        self.first_eye = np.concatenate([self.first_eye, np.broadcast_to(eye, rays.shape)])
        self.first_ray = np.concatenate([self.first_ray, rays])
        self.placed = np.concatenate([self.placed, placed])

    def _keep(self, rows: Array) -> None:
        for name in ("pixels", "points", "first_eye", "first_ray", "placed"):
            setattr(self, name, getattr(self, name)[rows])
