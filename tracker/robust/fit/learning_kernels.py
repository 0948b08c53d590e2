"""Compiled learning from a fit: what the image shows of its edges and of the camera."""

from typing import NamedTuple

from uavbench.tracker.geometry_kernels import inverse6
from uavbench.tracker.robust.edges.appearance_kernels import (
    IMAGES,
    NEARNESS,
    Images,
    LookedAt,
    Nearness,
    SeenOptics,
    learn_appearance,
)
from uavbench.tracker.robust.edges.measurements import SearchLines
from uavbench.tracker.robust.edges.sampling_kernels import search_lines
from uavbench.tracker.robust.edges.steps.optics_kernels import OPTICS, Optics
from uavbench.tracker.robust.fit.kernel_config import KERNEL_CONFIG, KernelConfig
from uavbench.tracker.robust.fit.pose_fit import FIT_RESIDUALS, FitResiduals
from uavbench.tracker.robust.fit.stage_kernels import EDGE_MODEL, EdgeModel
from uavbench.tracker.robust.optics.code_blur_kernels import displaced_by_codes
from uavbench.tracker.robust.solver.bias_state import BIAS_STATE, BiasState
from uavbench.tracker.robust.solver.solve_kernels import STEP, Step
from uavbench.tracker.robust.solver.spread_kernels import moved_by
from uavbench.tracker.robust.view import VIEW, View
from uavbench.trajectories.kernels.compiled import compiled
from uavbench.trajectories.pose import Array


class Looks(NamedTuple):
    """Search lines at the pose of a fit, and what the image shows there beside the optics that are assumed."""

    lines: SearchLines
    optics: SeenOptics


@compiled("step f2", inner=True, step=STEP)
def covariance_of_told(step: Step, covariance: Array) -> Array:
    """Covariance (6, 6) of a pose if the numbers that all edges share were known: by what the step to it was told."""
    if len(step.to_numbers) == 0:
        return covariance.copy()
    return inverse6(step.told + (inverse6(covariance) - step.information))


@compiled(
    "images used view f2 model limits values",
    images=IMAGES,
    used=FIT_RESIDUALS,
    view=VIEW,
    model=EDGE_MODEL,
    limits=NEARNESS,
    values=KERNEL_CONFIG,
)
def learn_looks(
    images: Images,
    used: FitResiduals,
    view: View,
    covariance: Array,
    model: EdgeModel,
    limits: Nearness,
    values: KernelConfig,
) -> Looks:
    """Update the appearance of the edges, in place, from a fit at a view, with this covariance (6, 6)."""
    points, weighting, numbers = used.points, used.weighting, used.step.to_numbers
    lines = search_lines(points, model.ends, model.inward, view)
    seen = LookedAt(points.rows, weighting.residual, weighting.weight, used.steps, used.by_numbers, numbers)
    told = covariance_of_told(used.step, covariance)
    return Looks(lines, learn_appearance(images, lines, seen, told, model.appearance, limits, values.appearance))


@compiled("used state f2 f2 optics i0", used=FIT_RESIDUALS, state=BIAS_STATE, optics=OPTICS)
def moved_by_codes(
    used: FitResiduals, state: BiasState, covariance: Array, appearance: Array, optics: Optics, channels: int
) -> Array:
    """Twist (6,) from a fit with this covariance (6, 6) to where it would be if its image's codes were blurred."""
    points = used.points
    px = displaced_by_codes(points.rows, points.first, used.steps, used.weighting.weight, appearance, optics, channels)
    return moved_by(used.sums, used.edges, state, px, covariance)
