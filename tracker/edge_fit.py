"""One image and a predicted pose: control points, search, hypotheses and M-estimation to the pose that fits."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scenes.camera import Camera
from scenes.structure import Structure
from tracker.base import Image
from tracker.clock import StageClock
from tracker.edge_map import EdgeMap
from tracker.geometry_kernels import camera_array, move
from tracker.profile_kernels import FIRST_ERROR, learn, search, search_range
from tracker.sampling_kernels import BINS, CROWD_PX, crowding, place, sample_edges
from tracker.solve_kernels import hypotheses, inverse6, line_variance, refine
from tracker.texture import ENOUGH_FOUND, Texture
from tracker.visible_edges import undistorted_bounds
from trajectories.pose import Array, Pose

SPACING_PX = 5.0
MOST_POINTS = 160
HYPOTHESES = 64
"""Hypotheses drawn for a frame."""
FINE_HALF_PX = 6.0
"""Half length of the search lines once the pose is nearly right."""
AGAIN_PX = 1.0
"""Control points are searched again when the pose moved them further than this."""
COARSE_SCALES = np.array([8.0, 5.0, 3.0])
FINE_SCALES = np.array([4.0, 3.0, 2.0])
LAST_SCALES = np.array([2.0, 1.5, 1.5])
"""Widths of Tukey's weights in px."""
HYPOTHESIS_PRIOR = 0.25
"""Weight of the prediction against candidates that are not weighed by their own errors yet."""
OWN_VARIANCE = 0.1**2
SILHOUETTE_VARIANCE, CREASE_VARIANCE, CONTACT_VARIANCE = 0.08**2, 0.15**2, 0.2**2
COMMON_PART = 0.15
"""Variance of a control point in px^2: its own, and that shared along its edge.

The latter takes a part of what was learned of the edge too. Measured at true poses, on average over an edge:
silhouettes lie 0.01 to 0.05 px from the model's edge; creases 0.1 to 0.3 px, by worn borders and by what is set into a
face; an edge that stands on the ground 0.05 to 0.4 px, by its shadow.
"""
PATCH_VARIANCE = 0.12**2
"""Variance of a patch along either axis in px^2, beside that of its place."""
WEAK_STEP = 15.0
"""Grey levels: an edge with this contrast weighs half of one with much."""
ENOUGH_PATCHES = 8
"""With so many patches found at the predicted pose the edges need no wide search."""
SURE_SUPPORT = 0.6
"""Patches are taken where the edges alone support the pose as much as this."""
PATCH_TRUST = 2.0
"""Weight of a patch in the support."""

Indices = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Evidence:
    """What a fit rests on.

    Control points with their keys, rows of appearance, residuals and weights; the patches, whether they were hit and
    tried; the information (6, 6) of the edges alone, and the pull (6,) with which they would move the patches' pose.
    """

    points: Array
    keys: Indices
    rows: Indices
    residual: Array
    weights: Array
    chosen: Indices
    hit: NDArray[np.bool_]
    tried: NDArray[np.bool_]
    edge_information: Array
    pull: Array


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
        """Fit to an image (h, w) or (h, w, 3) from a predicted pose with its covariance (6, 6).

        Search lines are no longer than half_px to either side.
        """
        image = layered(image)
        R, t = predicted.rotation, predicted.translation
        with clock.stage("project"):
            points, keys = self.sample(R, t)
            self.texture.choose(R, t)
        n = len(points)
        if n < 6 and len(self.texture.chosen) < 6:
            return Fit(predicted, covariance, 0.0, n, 0, 0, float("nan"))
        rows = (keys[:, 0] * 3 + keys[:, 1] - 1) * BINS + keys[:, 2]
        first = np.append(np.flatnonzero(np.diff(keys[:, 0], prepend=-1)), n)
        prior = inverse6(np.ascontiguousarray(covariance))
        lines, J, side = self.place(points, keys, R, t)
        trust, own = self.trust(lines, keys, side, rows)
        with clock.stage("texture"):
            observed, found = self.texture.align(image, R, t)
            places, map_covariance = self.texture.places(), self.texture.covariance_at(R, t)
        known = (map_covariance, prior, R, t)
        if np.count_nonzero(found > 0) >= ENOUGH_PATCHES:
            with clock.stage("texture"):
                nothing = (points[:0], lines[:0], np.zeros((0, 1)), np.zeros((0, 1)), trust[:0], own[:0])
                for scales in (COARSE_SCALES, FINE_SCALES):
                    R, t, *_ = refine(*nothing, places, observed, found, PATCH_VARIANCE, *known, R, t, self.cam, scales)
        elif n:
            with clock.stage("search"):
                half = search_range(J, covariance, 4.0, half_px)
                distance, penalty, contrast = search(image, lines, side, rows, self.appearance, half)
            with clock.stage("choose"):
                x, _ = hypotheses(J, distance, penalty, trust, first, HYPOTHESIS_PRIOR * prior, self.draws, 3.0)
                R, t = move(R, t, x)
                evidence = (
                    points,
                    lines,
                    distance,
                    penalty,
                    trust,
                    self.variance(first, distance, contrast, own, side, keys),
                )
                alone = (places[:0], observed[:0], found[:0])
                R, t, *_ = refine(*evidence, *alone, PATCH_VARIANCE, *known, R, t, self.cam, COARSE_SCALES)
            with clock.stage("texture"):
                observed, found = self.texture.align(image, R, t)
        for half_fine, scales in ((FINE_HALF_PX, FINE_SCALES), (FINE_HALF_PX / 2, LAST_SCALES)):
            with clock.stage("search"):
                lines, J, side = self.place(points, keys, R, t)
                distance, penalty, contrast = search(image, lines, side, rows, self.appearance, np.full(n, half_fine))
            with clock.stage("update"):
                evidence = (
                    points,
                    lines,
                    distance,
                    penalty,
                    trust,
                    self.variance(first, distance, contrast, own, side, keys),
                )
                patches = (places, observed, found)
                R, t, information, residual, weights, patch_weights, E, pull = refine(
                    *evidence, *patches, PATCH_VARIANCE, *known, R, t, self.cam, scales
                )
        with clock.stage("covariance"):
            covariance = inverse6(information)
        # an edge not known yet that is found by a weak step may be anything
        step = contrast.max(axis=1)
        weights = np.where(np.isfinite(own), weights, weights * step**2 / (step**2 + WEAK_STEP**2))
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
            Evidence(
                points, keys, rows, residual, weights, self.texture.chosen, patch_weights > 0, found >= 0, E, pull
            ),
        )  # fmt: skip

    def sample(self, R: Array, t: Array) -> tuple[Array, Indices]:
        """Visible control points at a pose."""
        m = self.map
        return sample_edges(
            m.ends, m.faces, m.planes, m.corners, m.owner, m.boxes, m.nodes,
            R, t, self.cam, self.size, self.bounds, SPACING_PX, MOST_POINTS,
        )  # fmt: skip

    def seen(self, pose: Pose) -> tuple[Array, Array]:
        """Visible control points (n, 3) at a pose, and the directions (n, 3) of their edges."""
        points, keys = self.sample(pose.rotation, pose.translation)
        along = self.map.ends[keys[:, 0], 1] - self.map.ends[keys[:, 0], 0]
        return points, along / np.linalg.norm(along, axis=1, keepdims=True)

    def place(self, points: Array, keys: Indices, R: Array, t: Array) -> tuple[Array, Array, Indices]:
        """Lines, Jacobian and silhouette side of control points at a pose."""
        return place(points, keys, self.map.ends, self.map.inward, R, t, self.cam, self.size)

    def trust(self, lines: Array, keys: Indices, side: Indices, rows: Indices) -> tuple[Array, Array]:
        """Weight (n,) of each control point, and its mean square residual (n,) in px^2, inf where none is learned.

        The weight is less where edges crowd, contrast is low or the appearance is not learned yet.
        """
        gap = crowding(lines, keys, side)
        apart = np.clip((gap - 2.0) / (CROWD_PX - 2.0), 0.02, 1.0)
        seen = self.appearance[rows]
        known = np.minimum(seen[:, 6] / 3.0, 1.0)
        step = ((seen[:, 3:6] - seen[:, :3]) ** 2).sum(axis=1)
        strong = step / (step + WEAK_STEP**2)
        return apart * (0.25 * (1 - known) + known * strong), np.where(seen[:, 6] > 0, seen[:, 7], np.inf)

    def variance(
        self, first: Indices, distance: Array, contrast: Array, learned: Array, side: Indices, keys: Indices
    ) -> Array:
        """Variance (n,) in px^2 of each control point, with which those of an edge count as much as they should."""
        unknown = (FIRST_ERROR / np.maximum(contrast.max(axis=1), FIRST_ERROR)) ** 2
        own = OWN_VARIANCE + np.where(np.isfinite(learned), learned, unknown)
        common = np.where(side == 0, CREASE_VARIANCE, SILHOUETTE_VARIANCE)
        common[self.map.stands[keys[:, 0]]] = CONTACT_VARIANCE
        return line_variance(first, distance, own, common + COMMON_PART * own)

    def learn(self, image: Image, fit: Fit, rate: float = 0.1) -> None:
        """Take up the appearance of edges and faces at the pose of a fit."""
        seen, pose, image = fit.evidence, fit.cam_from_world, layered(image)
        if seen is None:
            return
        lines, _, side = self.place(seen.points, seen.keys, pose.rotation, pose.translation)
        learn(image, lines, side, seen.rows, seen.weights, seen.residual, self.appearance, rate)
        self.texture.remember(seen.chosen, seen.hit, seen.tried, pose, seen.edge_information, seen.pull)
        hits = int(np.count_nonzero(seen.hit))
        if hits < ENOUGH_FOUND and fit.edge_support >= SURE_SUPPORT:
            self.texture.take(image, pose, fit.covariance, hits, lines[side != 9, :2])


def layered(image: Image) -> Image:
    """Image (h, w, c), contiguous, of one (h, w) or (h, w, c)."""
    return np.ascontiguousarray(image[..., None] if image.ndim == 2 else image)
