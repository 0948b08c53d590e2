"""Fit of a pose to an image from a prediction: control points, search, hypotheses and M-estimation."""

import copy
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from uavbench.scenes.camera import Camera
from uavbench.scenes.structure import Structure
from uavbench.tracker.geometry_kernels import inverse6, se3_exp_left
from uavbench.tracker.protocol import Image
from uavbench.tracker.robust.config import RobustConfig
from uavbench.tracker.robust.edges.appearance_kernels import Images, Nearness
from uavbench.tracker.robust.edges.columns import APPEARANCE_COLUMNS, BINS, EDGE, U, V
from uavbench.tracker.robust.edges.edge_graph import EdgeMap
from uavbench.tracker.robust.edges.measurements import ControlPoints, EdgeMeasurements, SearchLines
from uavbench.tracker.robust.edges.profile_kernels import MAX_HALF_PX, REACH, search, search_range
from uavbench.tracker.robust.edges.sampling_kernels import sample_edges
from uavbench.tracker.robust.edges.steps.optics_kernels import Optics
from uavbench.tracker.robust.edges.weight_kernels import point_variances
from uavbench.tracker.robust.fit.judging import conclude, fit_of, judge
from uavbench.tracker.robust.fit.kernel_config import KernelConfig
from uavbench.tracker.robust.fit.learning import Memory, Seen, learn_numbers, learn_patches
from uavbench.tracker.robust.fit.learning_kernels import learn_looks, moved_by_codes
from uavbench.tracker.robust.fit.pose_fit import (
    MIN_POINTS,
    NO_MATCHES,
    Aligned,
    Fit,
    Problem,
    Searched,
    Solution,
)
from uavbench.tracker.robust.fit.shared_numbers import SharedNumbers
from uavbench.tracker.robust.fit.stage_kernels import (
    EdgeModel,
    Fitted,
    Located,
    Shared,
    Solved,
    align_by_patches,
    edges_in_view,
    solve_anew,
    update,
)
from uavbench.tracker.robust.mostly_zero import mostly_zero
from uavbench.tracker.robust.optics.blur import Blur
from uavbench.tracker.robust.optics.colours import Colours
from uavbench.tracker.robust.optics.sharpening import Sharpening
from uavbench.tracker.robust.patches.matches import PatchMatches
from uavbench.tracker.robust.patches.patches import MOST_USED, Texture
from uavbench.tracker.robust.solver.bias_state import BiasesInView
from uavbench.tracker.robust.solver.edge_kinds import EdgeKinds
from uavbench.tracker.robust.solver.equation_kernels import PosePrior
from uavbench.tracker.robust.solver.hypothesis_kernels import DRAWS_PER_EDGE, EDGES_DRAWN, HYPOTHESES, best_motion
from uavbench.tracker.robust.solver.nuisance_biases import NO_EDGES, NuisanceBiases
from uavbench.tracker.robust.view import AT_ONCE, View
from uavbench.tracker.robust.work import LOCATED_POINT, Work, fit_evaluations
from uavbench.tracker.stage_clock import StageClock
from uavbench.trajectories.kernels.compiled import unchecked
from uavbench.trajectories.pose import Array, Pose

Indices = NDArray[np.int64]
MOST_POINTS = 200
"""Approximate largest number of visible control points, beyond which long edges get fewer: limits their time."""


class EdgeFitter:
    """Fits poses to images, and learns the appearance of the edges."""

    def __init__(self, structure: Structure, camera: Camera, rng: np.random.Generator, config: RobustConfig) -> None:
        self.camera, self.config, self.values = camera, config, KernelConfig.of(config)
        self.edges = EdgeMap.of(structure, config.edges.sampling.rounded_deg)
        self.kinds = EdgeKinds.of(self.edges)
        self.view = View.of(camera, structure)
        self.most_points, self.most_edges, self.now_s = 0, 0, 0.0
        self.unsmoothed: Image | None = None
        self.blur, self.sharpening, self.colours = Blur(), Sharpening(), Colours()
        self.seen = np.zeros(len(self.edges.ends), dtype=np.bool_)
        """Edges (e,) whose appearance was learned, even if it is forgotten."""
        self.weak_step = float(config.edges.appearance.weak_step_grey)
        self.work = Work(config.budget.evaluations)
        self.rng = rng
        self.draws = rng.random((HYPOTHESES, EDGES_DRAWN * DRAWS_PER_EDGE))
        self.forget()

    def forget(self) -> None:
        """Forget the appearance of the edges, the patches and the biases."""
        self.forget_patches()
        smallest_m = float(np.ptp(self.edges.extent, axis=0).min())
        self.numbers = SharedNumbers(self.camera, smallest_m, self.config.solver.bias)
        self.biases = NuisanceBiases(
            self.kinds, self.config.solver.bias, self.numbers.count, len(self.numbers.slabs.probability)
        )
        self.appearance = mostly_zero(len(self.edges.ends) * 3 * BINS, APPEARANCE_COLUMNS)
        self.learned = 0

    def forget_patches(self) -> None:
        """Forget the patches."""
        self.texture = Texture(self.edges, self.camera, self.view, self.config)
        self.texture.now_s = self.now_s

    @property
    def optics(self) -> Optics:
        """How light is thought to become codes."""
        return Optics(self.numbers.response.light, self.blur.px, self.colours.known)

    @property
    def seen_rows(self) -> Indices:
        """Rows of appearance that may have been learned."""
        return (np.flatnonzero(self.seen)[:, None] * 3 * BINS + np.arange(3 * BINS)).ravel()

    @property
    def known_biases(self) -> BiasesInView:
        """The biases, with no edges in view yet."""
        return self.biases.seen_with(NO_EDGES)

    @property
    def memory(self) -> Memory:
        """What was learned, which `forget` leaves as it is."""
        return Memory(self.texture, self.biases, self.appearance, self.learned, self.numbers)

    def remember(self, memory: Memory) -> None:
        """Return to what was learned before it was forgotten."""
        self.texture, self.biases, self.appearance, self.learned, self.numbers = memory
        self.texture.now_s = self.now_s

    def without_memory(self) -> "EdgeFitter":
        """A fitter of the same structure and the same draws that has learned nothing."""
        other = copy.copy(self)
        other.forget()
        return other

    def begin(self, stamp_ns: int, step_s: float, unsmoothed: Image | None = None) -> None:
        """Begin with a frame by its stamp, step_s after the previous one; unsmoothed: see `locate_in`."""
        self.now_s = self.texture.now_s = stamp_ns * 1e-9
        self.locate_in(unsmoothed)
        self.work = Work(self.config.budget.allowed(step_s))

    def move(self, velocity: Array | None) -> None:
        """Expect the image of a camera that moves at a velocity (6,) while its rows are read out; None: not known."""
        if self.camera.readout_ms:
            row_s = self.camera.readout_ms * 1e-3 / max(1, self.camera.height - 1)
            self.view = self.view.swept(AT_ONCE if velocity is None else row_s * velocity)

    def locate_in(self, unsmoothed: Image | None) -> None:
        """Locate edges in the frame's image (h, w) or (h, w, c) before it was smoothed, None where it was not.

        The noise of its pixels is independent, as a fit to them supposes, and its steps have the blur of the lens.
        """
        self.unsmoothed = None if unsmoothed is None else layered(unsmoothed)

    def cost(self, fits: int, located: int = 1) -> int:
        """Evaluations of so many fits of a search, and of locating the edges of so many of them, a quarter more."""
        points, patches = self.most_points * 5 // 4, min(len(self.texture), MOST_USED)
        return fits * fit_evaluations(self.most_edges, points, patches) + located * points * LOCATED_POINT

    def has_room_for(self, fits: int) -> bool:
        """Whether the frame's budget is enough for so many fits of a search and for locating the edges of the best."""
        return self.work.left >= self.cost(fits)

    def fit(
        self, image: Image, predicted: Pose, covariance: Array, clock: StageClock, half_px: float | None = None
    ) -> Fit:
        """Fit to an image (h, w) or (h, w, c) from a predicted pose with its covariance (6, 6).

        half_px: largest half length of the search lines, None for no limit.
        """
        found = self.search(image, predicted, covariance, clock, half_px)
        return found if isinstance(found, Fit) else self.concluded(found, clock)

    def concluded(self, found: Searched, clock: StageClock) -> Fit:
        """The fit to the matches of a search, its edges located between the pixels."""
        self.work.done += len(found.problem.points.points) * LOCATED_POINT
        with clock.stage("subpixel"):
            given = found, self.known_biases, self.optics, self.model, self.values
            return fit_of(found, *unchecked(conclude)(self.sharp(found.problem.image), *given))

    def searched(
        self, image: Image, predicted: Pose, covariance: Array, clock: StageClock, half_px: float | None = None
    ) -> Fit:
        """As `fit`, but to the matches of a search alone: with the same support, in half the time."""
        found = self.search(image, predicted, covariance, clock, half_px)
        if isinstance(found, Fit):
            return found
        with clock.stage("support"):
            at = unlocated(found)
            return fit_of(found, at, unchecked(judge)(found, at, self.appearance, self.values))

    def located(self, fit: Fit, clock: StageClock) -> Fit:
        """A fit with its edges located between the pixels, and the same support."""
        if fit.searched is None:
            return fit
        best = self.concluded(fit.searched, clock)
        return replace(best, support=fit.support, edge_support=fit.edge_support, found=fit.found)

    def search(
        self, image: Image, predicted: Pose, covariance: Array, clock: StageClock, half_px: float | None = None
    ) -> Searched | Fit:
        """Matches of a search, and the estimate from them; a fit without support where too little is in view."""
        most_px = float(MAX_HALF_PX) if half_px is None else half_px
        problem = self.project(layered(image), predicted, covariance, clock)
        n = len(problem.points.points)
        self.work.done += fit_evaluations(self.edges.looked_at, n, len(self.texture.chosen))
        self.most_points, self.most_edges = max(self.most_points, n), max(self.most_edges, self.edges.looked_at)
        if n < MIN_POINTS and len(self.texture.chosen) < MIN_POINTS:
            return Fit(predicted, covariance, 0.0, n, 0, 0, float("nan"))
        aligned = self.align(problem, most_px, clock)
        return Searched(problem, aligned, self.update(problem, aligned, clock), self.texture.chosen)

    def sharp(self, image: Image) -> Image:
        """The frame's image (h, w, c) as it is, or before it was smoothed."""
        return image if self.unsmoothed is None else self.unsmoothed

    @property
    def model(self) -> EdgeModel:
        """The edges with their appearance."""
        return EdgeModel(self.edges.ends, self.edges.inward, self.appearance)

    def project(self, image: Image, predicted: Pose, covariance: Array, clock: StageClock) -> Problem:
        """Control points, their weights, and patches that are visible at the prediction."""
        view = self.view.at(predicted)
        with clock.stage("project"):
            shared = Shared(self.numbers.rounding, self.numbers.response.light, image.shape[2])
            seen = unchecked(edges_in_view)(self.edges, view, self.appearance, MOST_POINTS, shared, self.values)
            self.texture.choose(view)
            prior = PosePrior(inverse6(covariance), view.R, view.t, self.numbers.known)
        return Problem(image, view, covariance, prior, *seen)

    def align(self, problem: Problem, most_px: float, clock: StageClock) -> Aligned:
        """Coarse estimate, by the patches if enough of them are found, else by hypotheses over a wide search."""
        with clock.stage("texture"):
            given = self.texture.in_view, self.known_biases, self.values
            aligned, told = unchecked(align_by_patches)(problem, *given)
        if told or not len(problem.points.points):
            return aligned
        view, widths = problem.at, self.values.widths
        with clock.stage("search"):
            half_px = unchecked(search_range)(problem.lines.jacobian, problem.covariance, widths.fine_half_px, most_px)
            half_px = view.within_clearance(half_px, problem.lines.lines[:, [U, V]], REACH + 1.0)
            measured = self.measure(problem, problem.lines, half_px)
        with clock.stage("hypotheses"):
            prior, outlier_px = problem.prior.information, self.config.solver.estimator.coarse_widths_px[-1]
            motion = unchecked(best_motion)(measured, prior, self.draws, outlier_px)
            view = view.to(*se3_exp_left(view.R, view.t, motion))
            estimate = self.solve_anew(problem, measured, NO_MATCHES, view, widths.coarse).estimate
            view = view.to(estimate.R, estimate.t)
        with clock.stage("texture"):
            return Aligned(view, self.texture.align(problem.image, view))

    def update(self, problem: Problem, aligned: Aligned, clock: StageClock) -> Solution:
        """Estimate by a short search."""
        with clock.stage("update"):
            return unchecked(update)(problem, aligned, self.known_biases, self.model, self.values)

    def measure(self, problem: Problem, lines: SearchLines, half_px: Array) -> EdgeMeasurements:
        """Candidates on search lines of half lengths half_px (n,), with the variances of their control points."""
        points, looks, weak_step = problem.points, self.appearance, self.weak_step
        found = unchecked(search)(problem.image, lines, points.rows, looks, half_px, weak_step, self.values.search)
        variance_px2 = unchecked(point_variances)(points, found, looks, weak_step, self.values.weights)
        return EdgeMeasurements(points, lines, found, problem.weight, variance_px2, problem.by_numbers)

    def solve_anew(
        self, problem: Problem, measured: EdgeMeasurements, matches: PatchMatches, view: View, widths_px: Array
    ) -> Solved:
        """M-estimation over edges and patches, from a view on, with the offsets of the edges by the measurements."""
        given = Fitted(measured, matches, self.known_biases, problem.prior)
        return unchecked(solve_anew)(given, problem.edges, widths_px, view, self.appearance, self.values)

    def sample(self, view: View) -> ControlPoints:
        """Visible control points in a view."""
        return unchecked(sample_edges)(self.edges, view, float(self.config.edges.sampling.spacing_px), MOST_POINTS)

    def moved_by_codes(self, fit: Fit, channels: int) -> Array:
        """Twist (6,) from where a fit is to where it would be if the blur of its image was of the codes."""
        if fit.residuals is None:
            return np.zeros(6)
        learned = self.biases.state, fit.covariance, self.appearance, self.optics
        return np.asarray(unchecked(moved_by_codes)(fit.residuals, *learned, channels))

    def learn(self, image: Image, fit: Fit, dt_s: float) -> None:
        """Update the appearance of edges, the patches and the biases with a fit, dt_s after the previous one."""
        used = fit.residuals
        if used is None:
            return
        self.seen[used.points.keys[:, EDGE]] = True
        image, at, widths = layered(image), self.view.at(fit.cam_from_world), self.values.widths
        asks = self.sharpening.asks(self.learned)
        limits = Nearness(widths.last_px, widths.trusted_px, self.optics, self.sharpening.undoes, asks)
        fitted = Images(image, self.sharp(image)), used, at, fit.covariance
        lines, found = unchecked(learn_looks)(*fitted, self.model, limits, self.values)
        rate, if_sharpened = self.values.appearance.learning_rate, found.if_sharpened
        self.blur.learn(if_sharpened.blur_px2 if self.sharpening.is_suspected else found.blur_px2, rate)
        self.sharpening.learn(if_sharpened.sharpening, rate)
        self.colours.learn(found.colours, dt_s, rate)
        self.learned += 1
        memory, seen = self.memory, Seen(image, at, lines, used)
        faces = learn_patches(memory, seen, fit, dt_s, self.config.good_support)
        learn_numbers(memory, seen, faces, dt_s, self.config.edges.weights.shared_part)


def unlocated(searched: Searched) -> Located:
    """The estimate from the matches of a search, which locates no edge between the pixels."""
    by_numbers = searched.problem.by_numbers
    return Located(searched.found.estimate, np.zeros(len(by_numbers), dtype=np.int64), by_numbers)


def layered(image: Image) -> Image:
    """Contiguous image (h, w, c) of an image (h, w) or (h, w, c)."""
    return np.ascontiguousarray(image[..., None] if image.ndim == 2 else image)
