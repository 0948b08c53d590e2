"""One image and a predicted pose: control points, search, hypotheses and M-estimation to the pose that fits."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.scenes.camera import Camera
from uavbench.scenes.structure import Structure
from uavbench.tracker.geometry_kernels import camera_array, inverse6, move
from uavbench.tracker.protocol import Image
from uavbench.tracker.robust.config import RobustConfig
from uavbench.tracker.robust.config.edges import (
    AppearanceConfig,
    SamplingConfig,
    SearchConfig,
    SubpixelConfig,
    WeightConfig,
)
from uavbench.tracker.robust.config.solver import EstimatorConfig, HypothesesConfig
from uavbench.tracker.robust.edges.columns import EDGE, OUTSIDE
from uavbench.tracker.robust.edges.edge_graph import EdgeMap
from uavbench.tracker.robust.edges.profile_kernels import learn, search, search_range
from uavbench.tracker.robust.edges.sampling_kernels import BINS, edge_rows, place, sample_edges
from uavbench.tracker.robust.edges.step_kernels import sharpen
from uavbench.tracker.robust.edges.weight_kernels import crowding, support, trust, variances
from uavbench.tracker.robust.kernel_values import kernel_values
from uavbench.tracker.robust.patches.patches import Texture
from uavbench.tracker.robust.pose_fit import Evidence, Fit
from uavbench.tracker.robust.solver.bias_kernels import surprise
from uavbench.tracker.robust.solver.hypothesis_kernels import hypotheses
from uavbench.tracker.robust.solver.nuisance_biases import CommonErrors
from uavbench.tracker.robust.solver.solve_kernels import refine
from uavbench.tracker.stage_clock import StageClock
from uavbench.tracker.visible_edges import undistorted_bounds
from uavbench.trajectories.pose import Array, Pose

NOTHING = (
    *(np.zeros((0, 3)), np.zeros((0, 4)), np.zeros((0, 1)), np.zeros((0, 1)), np.zeros(0), np.zeros(0)),
    np.zeros(1, dtype=np.int64),
)
NO_EDGES = (np.zeros(0, dtype=np.int64), np.zeros(0))
"""No control points, and no edges with offsets."""
LEAST_POINTS = 6
"""With fewer control points and fewer patches nothing is fitted."""

Indices = NDArray[np.int64]


class Widths(NamedTuple):
    """Widths of Tukey's weights in px, one after the other, of each fit of a frame."""

    coarse: Array
    patches: Array
    fine: Array
    last: Array


class FitValues(NamedTuple):
    """The config as the kernels of a fit take it."""

    sampling: SamplingConfig
    search: SearchConfig
    appearance: AppearanceConfig
    weights: WeightConfig
    subpixel: SubpixelConfig
    hypotheses: HypothesesConfig
    estimator: EstimatorConfig
    widths: Widths

    @classmethod
    def of(cls, config: RobustConfig) -> "FitValues":
        """The values of a config."""
        edges, solver, e = config.edges, config.solver, config.solver.estimator
        return cls(
            kernel_values(edges.sampling),
            kernel_values(edges.search),
            kernel_values(edges.appearance),
            kernel_values(edges.weights),
            kernel_values(edges.subpixel),
            kernel_values(solver.hypotheses),
            kernel_values(solver.estimator),
            Widths(*map(np.array, (e.coarse_widths_px, e.patch_widths_px, e.fine_widths_px, e.last_widths_px))),
        )


class EdgeFitter:
    """Fits poses to images, and learns the appearance of the edges."""

    def __init__(self, structure: Structure, camera: Camera, rng: np.random.Generator, config: RobustConfig) -> None:
        self.config, self.values = config, FitValues.of(config)
        self.map = EdgeMap.of(structure, config.edges.sampling.rounded_deg)
        self.cam = camera_array(camera)
        self.size = np.array([camera.width, camera.height], dtype=np.float64)
        self.bounds = np.array(undistorted_bounds(camera))
        self.texture = Texture(self.map, camera, config.patches)
        self.common = CommonErrors(len(self.map.ends) * 3, config.solver.bias)
        self.appearance = np.zeros((len(self.map.ends) * 3 * BINS, 8))
        self.learned, self.spread = 0, 1.0
        self.sharp = True
        self.draws = rng.random((config.solver.hypotheses.count, 12))

    def begin(self, stamp_ns: int, sharp: bool) -> None:
        """Begin with the frame of a stamp; whether it is as sharp as the lens left it, and not smoothed."""
        self.texture.now_s, self.sharp = stamp_ns * 1e-9, sharp

    def fit(
        self, image: Image, predicted: Pose, covariance: Array, clock: StageClock, half_px: float | None = None
    ) -> Fit:
        """Fit to an image (h, w) or (h, w, 3) from a predicted pose with its covariance (6, 6).

        Search lines are no longer than half_px to either side, where it is given.
        """
        values, widths, solver = self.values, self.values.widths, self.config.solver
        most_px = self.config.edges.search.max_half_px if half_px is None else half_px
        image = layered(image)
        R, t = predicted.rotation, predicted.translation
        with clock.stage("project"):
            points, keys = self.sample(R, t)
            n = len(points)
            self.texture.choose(R, t)
            if n < LEAST_POINTS and len(self.texture.chosen) < LEAST_POINTS:
                return Fit(predicted, covariance, 0.0, n, 0, 0, float("nan"))
            lines, J, side = self.place(points, keys, R, t)
            rows, first = edge_rows(keys)
            gap = crowding(lines, keys, side, values.weights)
            trusted = trust(gap, rows, self.appearance, values.weights)
            prior, edges = inverse6(covariance), rows[first[:-1]] // BINS
        with clock.stage("texture"):
            observed, found, vague = self.texture.align(image, R, t)
            places, expected = self.texture.places(), (prior, R, t)
            sure = np.count_nonzero(found > 0) >= self.config.patches.enough_to_predict
            if sure:
                patches = (places, observed, found, vague)
                shared = self.common.at(*NO_EDGES, R, t)
                R, t, *_ = refine(
                    *NOTHING, *patches, shared, *expected, R, t, self.cam, widths.patches, values.estimator
                )
        if not sure and n:
            with clock.stage("search"):
                half = search_range(J, covariance, most_px, values.search)
                distance, penalty, contrast = search(image, lines, side, rows, self.appearance, half, values.search)
            with clock.stage("choose"):
                x, _ = hypotheses(
                    J,
                    distance,
                    penalty,
                    trusted,
                    first,
                    solver.hypotheses.prior_weight * prior,
                    self.draws,
                    values.hypotheses,
                )
                R, t = move(R, t, x)
                own, spread = self.variances(keys, side, rows, first, distance, contrast, trusted)
                alone = (places[:0], observed[:0], found[:0], vague[:0])
                evidence = (points, lines, distance, penalty, trusted, own, first)
                shared = self.common.at(edges, spread, R, t)
                R, t, *_ = refine(*evidence, *alone, shared, *expected, R, t, self.cam, widths.coarse, values.estimator)
            with clock.stage("texture"):
                observed, found, vague = self.texture.align(image, R, t)
        patches, half = (places, observed, found, vague), np.full(n, self.config.edges.search.fine_half_px)
        for scales in (widths.fine, widths.last):
            with clock.stage("search"):
                lines, J, side = self.place(points, keys, R, t)
                distance, penalty, contrast = search(image, lines, side, rows, self.appearance, half, values.search)
            with clock.stage("update"):
                own, spread = self.variances(keys, side, rows, first, distance, contrast, trusted)
                evidence = (points, lines, distance, penalty, trusted, own, first)
                shared = self.common.at(edges, spread, R, t)
                R, t, information, residual, weights, patch_weights, sums, to_patches, to_fit, moved = refine(
                    *evidence, *patches, shared, *expected, R, t, self.cam, scales, values.estimator
                )
            if moved < solver.estimator.repeat_px:
                break
        candidates = int(np.count_nonzero(distance < np.inf))
        held, patches_held = weights, patch_weights  # what is found by a fit near a pose does not support it
        if self.sharp:
            with clock.stage("sharpen"):
                lines, J, side = self.place(points, keys, R, t)
                distance, own = sharpen(
                    image, lines, side, rows, first, self.appearance, gap, residual, weights, own, values.subpixel
                )
                evidence = (points, lines, distance, np.zeros_like(distance), trusted, own, first)
                shared = self.common.at(edges, spread, R, t)
                R, t, information, residual, weights, patch_weights, sums, to_patches, to_fit, moved = refine(
                    *evidence, *patches, shared, *expected, R, t, self.cam, widths.last, values.estimator
                )
        with clock.stage("judge"):
            whole, by_edges = support(
                held, trusted, rows, self.appearance, contrast, patches_held, found, values.weights
            )
            patches_found = self.config.edges.weights.patch_weight * np.count_nonzero(patch_weights)
            return Fit(
                Pose(R, t),
                inverse6(information),
                whole,
                n,
                candidates,
                int(np.count_nonzero(weights) + np.count_nonzero(patch_weights)),
                float(R[2] @ points[n // 2] + t[2]) if n else float("nan"),
                by_edges,
                float(weights.sum() + patches_found),
                Evidence(
                    points,
                    keys,
                    rows,
                    residual,
                    weights,
                    self.texture.chosen,
                    patch_weights,
                    found,
                    edges,
                    spread,
                    sums,
                    to_patches,
                    to_fit,
                    prior,
                ),
            )

    def sample(self, R: Array, t: Array) -> tuple[Array, Indices]:
        """Visible control points at a pose."""
        m = self.map
        return sample_edges(
            m.ends, m.faces, m.smooth, m.rounded, m.planes, m.corners, m.owner, m.boxes, m.nodes,
            R, t, self.cam, self.size, self.bounds, self.values.sampling,
        )  # fmt: skip

    def seen(self, pose: Pose) -> tuple[Array, Array]:
        """Visible control points (n, 3) at a pose, and the directions (n, 3) of their edges."""
        points, keys = self.sample(pose.rotation, pose.translation)
        along = self.map.ends[keys[:, EDGE], 1] - self.map.ends[keys[:, EDGE], 0]
        return points, along / np.linalg.norm(along, axis=1, keepdims=True)

    def place(self, points: Array, keys: Indices, R: Array, t: Array) -> tuple[Array, Array, Indices]:
        """Lines, Jacobian and silhouette side of control points at a pose."""
        margin_px = self.config.edges.sampling.margin_px
        return place(points, keys, self.map.ends, self.map.inward, R, t, self.cam, self.size, margin_px)

    def variances(
        self,
        keys: Indices,
        side: Indices,
        rows: Indices,
        first: Indices,
        distance: Array,
        contrast: Array,
        trusted: Array,
    ) -> tuple[Array, Array]:
        """Variance in px^2 of each control point (n,), and of the offset that those of an edge share (g,)."""
        stands, appearance = self.map.stands, self.appearance
        initial = self.config.edges.appearance.initial_error_px_grey
        own, spread = variances(
            keys, side, rows, first, stands, distance, contrast, trusted, appearance, self.values.weights, initial
        )
        return own, self.spread * spread

    def learn(self, image: Image, fit: Fit, dt_s: float) -> None:
        """Take up the appearance of edges and faces at the pose of a fit, dt_s after the one before."""
        bias, patches = self.config.solver.bias, self.config.patches
        seen, pose, image = fit.evidence, fit.cam_from_world, layered(image)
        if seen is None:
            return
        lines, _, side = self.place(seen.points, seen.keys, pose.rotation, pose.translation)
        learn(image, lines, side, seen.rows, seen.weights, seen.residual, self.appearance, self.values.appearance)
        hits = self.texture.count_hits(seen.chosen, seen.patch_weights, seen.found)
        if hits >= patches.min_hits:
            twist = self.common.learn(seen.edges, seen.spread, seen.sums, seen.to_patches, pose, dt_s)
            self.texture.shift(twist, pose)
        self.learned += 1
        squares, expected = surprise(seen.spread, seen.sums, seen.to_fit, fit.covariance)
        if expected > bias.min_freedom:
            ratio = min(bias.max_innovation, squares / expected)
            grown = self.spread * (1.0 + bias.spread_rate * (ratio - 1.0))
            self.spread = min(bias.max_spread, max(bias.min_spread, grown))
        due = hits < patches.enough_to_predict or self.learned % patches.take_every == 0
        if due and hits < patches.enough_found and fit.edge_support >= patches.take_support:
            if hits < patches.min_hits:
                self.common.begin(seen.edges, seen.spread, seen.sums, seen.to_fit, seen.prior, pose)
            self.texture.take(image, pose, lines[side != OUTSIDE, :2])


def layered(image: Image) -> Image:
    """Image (h, w, c), contiguous, of one (h, w) or (h, w, c)."""
    return np.ascontiguousarray(image[..., None] if image.ndim == 2 else image)
