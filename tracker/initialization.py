"""Step 3, initialization: a known pose, PnP on picked points (Haralick & Shapiro 1992), or a coarse guess."""

import sys
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Protocol

import cv2
import numpy as np
from annotated_types import Ge, Interval

from uavbench.scenes.camera import Camera
from uavbench.scenes.structure import Structure
from uavbench.tracker.protocol import Image
from uavbench.tracker.robust.config import RobustConfig
from uavbench.tracker.robust.fit.edge_fit import EdgeFitter
from uavbench.tracker.robust.motion_model import isotropic_covariance
from uavbench.tracker.robust.relocalization.ranking import Sought
from uavbench.tracker.robust.relocalization.relocate import Relocator
from uavbench.tracker.robust.work import Work
from uavbench.tracker.visible_edges import visible_edges
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.reading import read_toml
from uavbench.trajectories.obstacles import ObstacleMesh
from uavbench.trajectories.pose import Array, Pose

LEAST_SPAN_PX = 4.0
"""Least width or height of a model's edges in the first image: smaller ones are no more than a point."""
MOST_MISSED_PART = 0.03
"""Largest distance of a picked point from its pixel in image diagonals: 24 px at 640 x 480; clicks err by a few."""
MOST_BESIDE_PART = 0.1
"""Largest distance of a picked point from the model in its sizes: one that was measured in another frame is farther."""
PICKED_POINTS = 5
"""Number of points picked in the first image (Shang & Shen)."""


class Initialization(Protocol):
    """Source of the initial pose: a frozen dataclass of its parameters."""

    def initial_pose(
        self, structure: Structure, camera: Camera, true_cam_from_world: Pose, image: Image, rng: np.random.Generator
    ) -> Pose:
        """cam_from_world with which a tracker is started on the first image."""
        ...


@dataclass(frozen=True)
class Known:
    """The true initial pose."""

    def initial_pose(
        self, structure: Structure, camera: Camera, true_cam_from_world: Pose, image: Image, rng: np.random.Generator
    ) -> Pose:
        """The true pose."""
        return true_cam_from_world


@dataclass(frozen=True)
class PickedPoints:
    """Corners of the structure picked on the first image with a click error, then PnP."""

    click_sigma_px: Annotated[float, Ge(0)] = 1.0
    points: Annotated[int, Ge(4)] = PICKED_POINTS

    def initial_pose(
        self, structure: Structure, camera: Camera, true_cam_from_world: Pose, image: Image, rng: np.random.Generator
    ) -> Pose:
        """PnP pose of the picked corners; UserError when fewer than four are in view."""
        seen = np.unique(structure.edges[visible_edges(structure, camera, true_cam_from_world).edges])
        cam = true_cam_from_world.transform(structure.vertices[seen])
        seen, cam = seen[cam[:, 2] > 0], cam[cam[:, 2] > 0]
        pixels = camera.project(cam) if len(cam) else np.zeros((0, 2))
        inside = ((pixels >= 0) & (pixels < [camera.width, camera.height])).all(axis=1)
        seen, pixels = seen[inside], pixels[inside]
        if len(seen) < 4:
            raise UserError(f"only {len(seen)} corners of the structure are in the first view; four are needed for PnP")
        rows = np.sort(rng.permutation(len(seen))[: max(self.points, 4)])
        clicks = pixels[rows] + rng.normal(0.0, self.click_sigma_px, (len(rows), 2))
        return pose_from_points(structure.vertices[seen[rows]], clicks, camera)


@dataclass(frozen=True)
class CoarseGuess:
    """A coarse guess, refined by a pose search.

    The guess is the true pose perturbed at random by up to range_part of the distance and angle_deg of the direction;
    the initial pose is the best match around it.
    """

    range_part: Annotated[float, Interval(ge=0, le=0.5)] = 0.1
    angle_deg: Annotated[float, Interval(ge=0, le=45)] = 10.0

    def initial_pose(
        self, structure: Structure, camera: Camera, true_cam_from_world: Pose, image: Image, rng: np.random.Generator
    ) -> Pose:
        """The best matching pose around the guess; the guess itself when the image has no edges."""
        range_m = float(np.linalg.norm(true_cam_from_world.transform(structure.bounds.mean(axis=0, keepdims=True))))
        twist = np.concatenate(
            [
                rng.uniform(-1, 1, 3) * self.range_part * range_m / np.sqrt(3),
                rng.uniform(-1, 1, 3) * np.radians(self.angle_deg) / np.sqrt(3),
            ]
        )
        guess = Pose.exp(twist) @ true_cam_from_world
        config = RobustConfig()
        spread = max(self.range_part, float(np.radians(self.angle_deg)), config.relocalization.guess_sigma) / 2
        fitter = EdgeFitter(structure, camera, rng, config)
        fitter.work = Work(allowed=sys.maxsize)  # no time limit before the start
        relocator = Relocator(fitter, camera)
        fit = relocator.search(Sought(image, [guess], isotropic_covariance(spread, range_m), range_m)).fit
        return fit.cam_from_world if fit.finite else guess


INITIALIZATIONS: dict[str, type[Initialization]] = {
    "known": Known,
    "picked-points": PickedPoints,
    "coarse-guess": CoarseGuess,
}
"""Name -> source of the initial pose."""


def initial_pose_of(
    start: Initialization,
    structure: Structure,
    camera: Camera,
    true_cam_from_world: Pose,
    image: Image,
    rng: np.random.Generator,
) -> Pose:
    """cam_from_world of a source on the first image; UserError for a user's that is no Pose, or another each time.

    A source that draws from more than the generator given to it starts each tracker elsewhere.
    """
    if type(start) in INITIALIZATIONS.values():
        return start.initial_pose(structure, camera, true_cam_from_world, image, rng)
    poses: list[object] = [
        start.initial_pose(structure, camera, true_cam_from_world, image.copy(), deepcopy(rng)) for _ in range(2)
    ]
    name = f"start {type(start).__module__}:{type(start).__name__}"
    for pose in poses:
        if not isinstance(pose, Pose):
            raise UserError(f"{name}: initial_pose gives a {type(pose).__name__}; it takes a Pose, cam_from_world")
    found, again = (pose for pose in poses if isinstance(pose, Pose))
    if not np.array_equal(found.matrix, again.matrix):
        raise UserError(
            f"{name}: initial_pose gives another pose each time; take all random numbers from the `rng` that it is "
            "given, and nothing from the clock or an earlier call"
        )
    return found


def pose_from_points(points_m: Array, pixels: Array, camera: Camera) -> Pose:
    """cam_from_world of points (n, 3) observed at pixels (n, 2), n >= 4; UserError when they determine no pose.

    SQPnP (Terzakis & Lourakis 2020), then Levenberg-Marquardt on the reprojection errors.
    """
    if len(points_m) < 4:
        raise UserError(f"{len(points_m)} points given; a pose takes at least four, better five or more")
    flat = camera.undistort(np.asarray(pixels, dtype=np.float64))
    spans = np.linalg.svd(points_m - points_m.mean(axis=0), compute_uv=False)
    if spans[1] < 1e-6 * max(spans[0], 1e-12):
        raise UserError("the picked points lie on one line; pick points that span a face")
    try:
        found, rotation, translation = cv2.solvePnP(points_m, flat, camera.K, np.zeros(4), flags=cv2.SOLVEPNP_SQPNP)
        if found:
            rotation, translation = cv2.solvePnPRefineLM(points_m, flat, camera.K, np.zeros(4), rotation, translation)
    except cv2.error:
        found = False
    if not found or not np.isfinite(rotation).all() or not np.isfinite(translation).all():
        raise UserError("no pose puts the picked points at their pixels; check their order")
    pose = Pose(np.asarray(cv2.Rodrigues(rotation)[0], np.float64), np.asarray(translation, np.float64).reshape(3))
    if (pose.transform(points_m)[:, 2] <= 0).any():
        raise UserError("the picked points would lie behind the camera; check their order")
    return pose


def read_init(path: Path, camera: Camera, structure: Structure | None = None) -> Pose:
    """cam_from_model of an `init.toml`; UserError naming the file and the invalid key.

    It holds `cam_from_model`, four rows of four, or `points`, a list of {model_m = [x, y, z], image_px = [u, v]}. Where
    the structure is given, points beside it are an error, and so is a pose at which its edges are not in the image.
    """
    pose = _read_pose(path, camera, structure)
    if structure is None:
        return pose
    if (wide_px := span_px(structure, camera, pose)) < LEAST_SPAN_PX:
        seen = f"only {wide_px:.2g} px wide" if wide_px else "not in the image"
        raise UserError(
            f"{path}: at this pose the model is {seen}: it maps points of the model, in metres, to the camera, "
            "x right, y down, z forward; is it the inverse, in another unit, or with the axes of OpenGL?"
        )
    return pose


def span_px(structure: Structure, camera: Camera, cam_from_world: Pose) -> float:
    """Width or height in px, the larger one, of what an image shows of a structure's visible edges; 0 without any."""
    segments_px = visible_edges(structure, camera, cam_from_world).segments_px.reshape(-1, 2)
    return float(np.ptp(segments_px, axis=0).max()) if len(segments_px) else 0.0


def _read_pose(path: Path, camera: Camera, structure: Structure | None) -> Pose:
    values = read_toml(path)
    if set(values) == {"cam_from_model"}:
        try:
            return Pose.from_matrix(values["cam_from_model"])
        except (ValueError, TypeError, OverflowError) as error:
            raise UserError(f"{path}: cam_from_model: {error}") from None
    if set(values) != {"points"}:
        raise UserError(f"{path}: has keys {sorted(values)}; give either cam_from_model or points")
    try:
        points = np.array([row["model_m"] for row in values["points"]], dtype=np.float64).reshape(-1, 3)
        pixels = np.array([row["image_px"] for row in values["points"]], dtype=np.float64).reshape(-1, 2)
    except (KeyError, ValueError, TypeError, OverflowError):
        raise UserError(f"{path}: points: each takes model_m = [x, y, z] and image_px = [u, v]") from None
    if not (np.isfinite(points).all() and np.isfinite(pixels).all() and len(points) == len(pixels)):
        raise UserError(f"{path}: points: numbers must be finite")
    if structure is not None and len(points):
        _refuse_points_beside(path, points, structure)
    try:
        pose = pose_from_points(points, pixels, camera)
    except UserError as error:
        raise UserError(f"{path}: points: {error}") from None
    missed_px = np.linalg.norm(camera.project(pose.transform(points)) - pixels, axis=1)
    if missed_px.max() > MOST_MISSED_PART * np.hypot(camera.width, camera.height):
        worst = int(np.argmax(missed_px))
        raise UserError(
            f"{path}: points: at the pose that fits best, points[{worst}] is {missed_px[worst]:.1f} px from its pixel; "
            "check which corner each pixel belongs to, and the camera"
        )
    return pose


def _refuse_points_beside(path: Path, points_m: Array, structure: Structure) -> None:
    """UserError for points (n, 3) that are not of the model: to PnP all frames of them are alike."""
    beside_m = ObstacleMesh(structure.vertices, structure.triangles).distance(points_m)
    if beside_m.max() > MOST_BESIDE_PART * float(np.ptp(structure.bounds, axis=0).max()):
        worst = int(np.argmax(beside_m))
        raise UserError(
            f"{path}: points: points[{worst}] is {beside_m[worst]:.3g} m beside the model; give points of the model in "
            "metres, with its origin and axes; glTF is turned to z up: (x, y, z) of its file is (x, -z, y) here"
        )
