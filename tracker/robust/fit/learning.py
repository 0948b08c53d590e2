"""What is learned from a fit: the looks and distances of edges, the blur, the biases, and patches."""

from typing import NamedTuple

import numpy as np

from uavbench.tracker.protocol import Image
from uavbench.tracker.robust.config import RobustConfig
from uavbench.tracker.robust.edges.blur import Blur
from uavbench.tracker.robust.edges.blur_kernels import excess_blur
from uavbench.tracker.robust.edges.columns import OUTSIDE, U, V
from uavbench.tracker.robust.edges.measurements import SearchLines
from uavbench.tracker.robust.edges.profile_kernels import learn, learn_squares
from uavbench.tracker.robust.fit.kernel_config import KernelConfig
from uavbench.tracker.robust.fit.pose_fit import Fit, FitResiduals
from uavbench.tracker.robust.patches.patches import MOST_USED, Texture
from uavbench.tracker.robust.solver.nuisance_biases import NuisanceBiases
from uavbench.trajectories.pose import Array

MIN_POINTS = 6
"""Least number of control points or patches for a fit, and of patches that make a wide search of edges unnecessary:
these give two equations each, and thus twice as many as a pose has unknowns."""
TAKE_EVERY = 4
"""Frames between searches for new patches while enough are found: limits their time."""


class Memory(NamedTuple):
    """What was learned: patches, biases, appearance of the edges, and in how many frames."""

    texture: Texture
    biases: NuisanceBiases
    appearance: Array
    frames: int


class Seen(NamedTuple):
    """An image (h, w, c), the search lines at the pose of its fit, and the residuals there."""

    image: Image
    lines: SearchLines
    residuals: FitResiduals


def learn_edges(
    appearance: Array, blur: Blur, seen: Seen, covariance: Array, config: RobustConfig, values: KernelConfig
) -> None:
    """Update appearance and mean squares of the edges, and the blur, from a fit with this covariance (6, 6)."""
    image, lines, used = seen
    rows, weighting = used.points.rows, used.weighting
    near = np.abs(weighting.residual) < values.widths.last[-1]
    distance = np.where(near, weighting.residual, np.inf)
    learn_squares(lines, rows, distance, covariance, appearance, values.appearance)
    beside = np.abs(weighting.residual) < config.solver.estimator.trusted_px
    learn(image, lines, rows, np.where(beside, weighting.weight, 0.0), appearance, values.appearance)
    alone = np.where((used.steps == 1) & (weighting.weight > 0), distance, np.inf)
    rate = config.edges.appearance.learning_rate
    blur.learn(excess_blur(image, lines, rows, appearance, alone, blur.px), rate)


def learn_patches(memory: Memory, seen: Seen, fit: Fit, dt_s: float, good_support: float) -> None:
    """Update the patches and the biases with a fit, dt_s after the previous one; take new patches where they are due.

    Patches are taken where the edges' support is good.
    """
    texture, biases, pose = memory.texture, memory.biases, fit.cam_from_world
    image, lines, used = seen
    faces = texture.patches.face[used.chosen[used.weighting.patch_weight > 0]]
    hits = texture.count_hits(used.chosen, used.weighting.patch_weight, used.correlation)
    if hits:
        twist = biases.learn(used.edges, used.sums, used.step.to_patches, pose, dt_s)
        texture.shift(faces, twist, pose)  # others keep their places: the frame says nothing of them
    due = hits < MIN_POINTS or memory.frames % TAKE_EVERY == 0
    if due and hits < MOST_USED and fit.edge_support >= good_support:
        if not hits:
            biases.begin(used.edges, used.sums, used.step.to_fit, used.prior_information, pose)
        texture.take(image, pose, lines.lines[lines.side != OUTSIDE][:, [U, V]])
