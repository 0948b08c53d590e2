"""What is learned from a fit: the looks and distances of edges, the blur, the biases, and patches."""

from typing import NamedTuple

from uavbench.tracker.protocol import Image
from uavbench.tracker.robust.edges.appearance_kernels import LookedAt, Nearness, learn_appearance
from uavbench.tracker.robust.edges.columns import OUTSIDE, U, V
from uavbench.tracker.robust.edges.measurements import SearchLines
from uavbench.tracker.robust.edges.step_kernels import Optics
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


def learn_edges(appearance: Array, optics: Optics, seen: Seen, covariance: Array, values: KernelConfig) -> float:
    """Update appearance and mean squares of the edges from a fit with this covariance (6, 6).

    Returns by how much the variance of the image's blur is more than that of the optics, px^2, NaN where unknown.
    """
    image, lines, used = seen
    residual = used.weighting.residual - used.by_response @ used.step.to_response
    looked_at = LookedAt(used.points.rows, residual, used.weighting.weight, used.steps)
    limits = Nearness(values.widths.last_px, values.widths.trusted_px, optics)
    return learn_appearance(image, lines, looked_at, covariance, appearance, limits, values.appearance)


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
            biases.begin(used.edges, used.sums, used.step, used.prior_information, pose)
        texture.take(image, pose, lines.lines[lines.side != OUTSIDE][:, [U, V]])
