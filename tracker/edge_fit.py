"""One image and a predicted pose: control points, search, hypotheses and M-estimation to the pose that fits."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scenes.camera import Camera
from scenes.structure import Structure
from tracker.base import Image
from tracker.clock import StageClock
from tracker.edge_map import EdgeMap
from tracker.geometry_kernels import camera_array, move, twist_between
from tracker.profile_kernels import learn, search, search_range
from tracker.sampling_kernels import BINS, CROWD_PX, crowding, place, sample_edges
from tracker.solve_kernels import hypotheses, m_estimate, sandwich
from tracker.texture import ENOUGH_FOUND, Texture
from tracker.visible_edges import undistorted_bounds
from trajectories.pose import Array, Pose

SPACING_PX = 5.0
MOST_POINTS = 200
HYPOTHESES = 64
"""Hypotheses drawn for a frame."""
FINE_HALF_PX = (6.0, 3.5)
"""Half lengths of the search lines once the pose is nearly right."""
COARSE_SCALES = np.array([8.0, 5.0, 3.0])
FINE_SCALES = (np.array([4.0, 3.0, 2.5]), np.array([2.0, 1.5, 1.5]))
"""Widths of Tukey's weights in px."""
MEASUREMENT_PX = 0.5
"""Standard deviation of a candidate when weighed against the prediction."""
OWN_SIGMA_PX = 0.35
COMMON_SIGMA_PX = 0.2
"""Error of a control point: of its own, and shared along its edge."""

PATCH_SIGMA_PX = 0.2
PATCH_COMMON_PX = 0.26
"""Error of a patch along either axis: of its own, and shared by its face from the pose that it was taken at."""
WEAK_STEP = 15.0
"""Grey levels: an edge with this contrast weighs half of one with much."""
ENOUGH_PATCHES = 8
"""With so many patches found at the predicted pose the edges need no wide search."""
SURE_SUPPORT = 0.6
"""Patches are taken where the edges alone support the pose as much as this."""
PATCH_TRUST = 2.0
"""Weight of a patch in the support."""
NO_PATCHES = (np.zeros((0, 2, 6)), np.zeros((0, 2)), np.zeros(0))
NO_EDGES = (np.zeros((0, 6)), np.zeros((0, 1)), np.zeros((0, 1)), np.zeros(0))

Indices = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Evidence:
    """What a fit rests on: control points with their keys, rows of appearance and weights; weights of the patches."""

    points: Array
    keys: Indices
    rows: Indices
    weights: Array
    chosen: Indices
    patch_weights: Array
    found: Array


@dataclass(frozen=True, eq=False)
class Fit:
    """A pose and how well the edges support it.

    covariance (6, 6); support in [0, 1]: weighted share of the control points and patches that were found, and
    edge_support that of the control points alone.
    """

    cam_from_world: Pose
    covariance: Array
    support: float
    control_points: int
    candidates: int
    inliers: int
    range_m: float
    edge_support: float = 0.0
    evidence: Evidence | None = None

    @property
    def finite(self) -> bool:
        """Whether pose and covariance are numbers."""
        return bool(np.isfinite(self.cam_from_world.matrix).all() and np.isfinite(self.covariance).all())


class EdgeFitter:
    """Fits poses to images, and learns the appearance of the edges."""

    def __init__(self, structure: Structure, camera: Camera, rng: np.random.Generator) -> None:
        self.map = EdgeMap.of(structure)
        self.cam = camera_array(camera)
        self.size = np.array([camera.width, camera.height], dtype=np.float64)
        self.bounds = np.array(undistorted_bounds(camera))
        self.texture = Texture(self.map, camera)
        self.appearance = np.zeros((len(self.map.ends) * 3 * BINS, 8))
        self.draws = rng.random((HYPOTHESES, 12))

    def fit(self, image: Image, predicted: Pose, covariance: Array, clock: StageClock, half_px: float = 48.0) -> Fit:
        """Fit from a predicted pose with its covariance (6, 6); search lines no longer than half_px to either side."""
        R, t = predicted.rotation, predicted.translation
        with clock.stage("project"):
            points, keys = self.sample(R, t)
            self.texture.choose(R, t)
        n = len(points)
        if n < 6 and len(self.texture.chosen) < 6:
            return Fit(predicted, covariance, 0.0, n, 0, 0, float("nan"))
        rows = (keys[:, 0] * 3 + keys[:, 1] - 1) * BINS + keys[:, 2]
        prior = np.asarray(np.linalg.inv(covariance) * MEASUREMENT_PX**2, dtype=np.float64)
        lines, J, side = self.place(points, keys, R, t)
        trust = self.trust(lines, keys, side, rows)
        with clock.stage("texture"):
            observed, found = self.texture.align(image, R, t)
        if np.count_nonzero(found > 0) >= ENOUGH_PATCHES:
            with clock.stage("texture"):
                R, t = self.move_to_patches(observed, found, prior, R, t)
        else:
            with clock.stage("search"):
                half = search_range(J, covariance, 4.0, half_px)
                distance, penalty, _ = search(image, lines, side, rows, self.appearance, half)
            with clock.stage("choose"):
                first = np.append(np.flatnonzero(np.diff(keys[:, 0], prepend=-1)), n)
                x, _ = hypotheses(J, distance, penalty, trust, first, prior, self.draws, 3.0)
                x, *_ = m_estimate(J, distance, penalty, trust, *NO_PATCHES, prior, np.zeros(6), x, COARSE_SCALES)
                R, t = move(R, t, x)
            with clock.stage("texture"):
                observed, found = self.texture.align(image, R, t)
        for half_fine, scales in zip(FINE_HALF_PX, FINE_SCALES, strict=True):
            with clock.stage("search"):
                lines, J, side = self.place(points, keys, R, t)
                distance, penalty, _ = search(image, lines, side, rows, self.appearance, np.full(n, half_fine))
                moved, J_patch = self.texture.rows(observed, R, t)
            with clock.stage("update"):
                offset = twist_between(R, t, predicted.rotation, predicted.translation)
                x, information, weights, patch_weights = m_estimate(
                    J, distance, penalty, trust, J_patch, moved, found, prior, offset, np.zeros(6), scales
                )
                R, t = move(R, t, x)
        with clock.stage("covariance"):
            _, group = np.unique(self.texture.face[self.texture.chosen], return_inverse=True)
            covariance = sandwich(
                J, weights, keys[:, 0], J_patch, patch_weights, group, information + prior,
                OWN_SIGMA_PX, COMMON_SIGMA_PX, PATCH_SIGMA_PX, PATCH_COMMON_PX,
            )  # fmt: skip
        tried = PATCH_TRUST * np.count_nonzero(found >= 0)
        supported = weights.sum() + PATCH_TRUST * np.count_nonzero(patch_weights)
        return Fit(
            Pose(R, t),
            covariance,
            float(supported / max(trust.sum() + tried, 1.0)),
            n,
            int(np.isfinite(distance).sum()),
            int(np.count_nonzero(weights) + np.count_nonzero(patch_weights)),
            float(np.median(points @ R[2] + t[2])) if n else float("nan"),
            float(weights.sum() / max(trust.sum(), 1.0)),
            Evidence(points, keys, rows, weights, self.texture.chosen, patch_weights, found),
        )

    def move_to_patches(self, observed: Array, found: Array, prior: Array, R: Array, t: Array) -> tuple[Array, Array]:
        """The pose that brings the patches to where they were observed."""
        for scales in (COARSE_SCALES, FINE_SCALES[0]):
            moved, J_patch = self.texture.rows(observed, R, t)
            x, *_ = m_estimate(*NO_EDGES, J_patch, moved, found, prior, np.zeros(6), np.zeros(6), scales)
            R, t = move(R, t, x)
        return R, t

    def sample(self, R: Array, t: Array) -> tuple[Array, Indices]:
        """Visible control points at a pose."""
        m = self.map
        return sample_edges(
            m.ends, m.faces, m.planes, m.corners, m.owner, m.boxes, m.nodes,
            R, t, self.cam, self.size, self.bounds, SPACING_PX, MOST_POINTS,
        )  # fmt: skip

    def place(self, points: Array, keys: Indices, R: Array, t: Array) -> tuple[Array, Array, Indices]:
        """Lines, Jacobian and silhouette side of control points at a pose."""
        return place(points, keys, self.map.ends, self.map.inward, R, t, self.cam, self.size)

    def trust(self, lines: Array, keys: Indices, side: Indices, rows: Indices) -> Array:
        """Weight (n,) of each control point: less where edges crowd, contrast is low or appearance not learned yet."""
        gap = crowding(lines, keys, side)
        apart = np.clip((gap - 2.0) / (CROWD_PX - 2.0), 0.02, 1.0)
        seen = self.appearance[rows]
        known = np.minimum(seen[:, 6] / 3.0, 1.0)
        step = ((seen[:, 3:6] - seen[:, :3]) ** 2).sum(axis=1)
        strong = step / (step + WEAK_STEP**2)
        return np.asarray(apart * (0.25 * (1 - known) + known * strong))

    def learn(self, image: Image, fit: Fit, rate: float = 0.1) -> None:
        """Take up the appearance of edges and faces at the pose of a fit."""
        seen, pose = fit.evidence, fit.cam_from_world
        if seen is None:
            return
        lines, _, side = self.place(seen.points, seen.keys, pose.rotation, pose.translation)
        learn(image, lines, side, seen.rows, seen.weights, self.appearance, rate)
        self.texture.remember(seen.chosen, seen.patch_weights > 0, seen.found >= 0)
        if np.count_nonzero(seen.patch_weights) < ENOUGH_FOUND and fit.edge_support >= SURE_SUPPORT:
            self.texture.take(image, pose, lines[side != 9, :2])
