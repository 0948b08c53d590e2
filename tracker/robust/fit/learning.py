"""What is learned from a fit: the looks and distances of edges, the biases, patches, and what all edges share."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.tracker.robust.edges.appearance_kernels import (
    Images,
    LookedAt,
    Nearness,
    SeenOptics,
    learn_appearance,
)
from uavbench.tracker.robust.edges.columns import OUTSIDE, U, V
from uavbench.tracker.robust.edges.measurements import SearchLines
from uavbench.tracker.robust.edges.steps.optics_kernels import Optics
from uavbench.tracker.robust.fit.kernel_config import KernelConfig
from uavbench.tracker.robust.fit.pose_fit import Fit, FitResiduals
from uavbench.tracker.robust.fit.shared_numbers import SharedNumbers
from uavbench.tracker.robust.patches.patch_kernels import faces_found
from uavbench.tracker.robust.patches.patches import MOST_USED, Texture
from uavbench.tracker.robust.solver.equation_kernels import PosePrior
from uavbench.tracker.robust.solver.nuisance_biases import NuisanceBiases
from uavbench.tracker.robust.solver.number_kernels import numbers_seen
from uavbench.tracker.robust.view import View
from uavbench.trajectories.kernels.compiled import unchecked
from uavbench.trajectories.pose import Array, Pose

Indices = NDArray[np.int64]
MIN_POINTS = 6
"""Least number of control points or patches for a fit, and of patches that make a wide search of edges unnecessary:
these give two equations each, and thus twice as many as a pose has unknowns."""
TAKE_EVERY = 4
"""Frames between searches for new patches while enough are found, or after one that found none: limits their time."""


ASK_EVERY, ASK_AT = 8, 2
"""Frames between those in which the numbers that all edges share are learned, and the first of these: limits their
time. It takes no patches."""
TAKE_AFTER_S = 0.75
"""Least time between such searches while enough are found, s: new patches have the error of the pose that they are
taken at, and where up to a fifth of them is new every 0.27 s, the error that all share drifts faster than it is
forgotten. Measured at 15 Hz on flights of four seeds; four frames at 5 Hz are 0.8 s.
"""


class Memory(NamedTuple):
    """What was learned: patches, biases, appearance of the edges, in how many frames; the numbers that edges share."""

    texture: Texture
    biases: NuisanceBiases
    appearance: Array
    frames: int
    numbers: SharedNumbers


class Seen(NamedTuple):
    """A frame's images, the search lines at the pose of its fit, and the residuals there."""

    images: Images
    lines: SearchLines
    residuals: FitResiduals


class Lens(NamedTuple):
    """The optics that are assumed, the amount of sharpening that was undone, and whether an image is asked for it."""

    optics: Optics
    undone: float
    asks: bool


def learn_edges(appearance: Array, lens: Lens, seen: Seen, covariance: Array, values: KernelConfig) -> SeenOptics:
    """Update appearance and mean squares of the edges from a fit with this covariance (6, 6).

    Returns what the image shows beside the optics.
    """
    images, lines, used = seen
    weighting, numbers = used.weighting, used.step.to_numbers
    looked_at = LookedAt(used.points.rows, weighting.residual, weighting.weight, used.steps, used.by_numbers, numbers)
    limits = Nearness(values.widths.last_px, values.widths.trusted_px, *lens)
    found = unchecked(learn_appearance)(images, lines, looked_at, covariance, appearance, limits, values.appearance)
    return SeenOptics(*found)


def found_faces(texture: Texture, used: FitResiduals) -> Indices:
    """Faces of the patches that a fit found."""
    return unchecked(faces_found)(texture.patches.face, used.chosen, used.weighting.patch_weight)


def learn_patches(memory: Memory, seen: Seen, fit: Fit, faces: Indices, dt_s: float, good_support: float) -> None:
    """Update the patches and the biases with a fit, dt_s after the previous one; take new patches where they are due.

    faces: of the patches that were found. Patches are taken where the edges' support is good.
    """
    texture, biases, pose = memory.texture, memory.biases, fit.cam_from_world
    images, lines, used = seen
    hits = texture.count_hits(used.chosen, used.weighting.patch_weight, used.correlation)
    if hits:
        twist = biases.learn(used.edges, used.sums, used.step.to_patches, pose, dt_s)
        texture.shift(faces, twist, pose)  # others keep their places: the frame says nothing of them
    few = hits < MIN_POINTS
    in_turn = memory.frames % TAKE_EVERY == 0 and (few or texture.now_s - texture.searched_s > TAKE_AFTER_S)
    due = (few and not texture.barren) or in_turn
    if due and hits < MOST_USED and fit.edge_support >= good_support:
        texture.take(images.searched, pose, lines.lines[lines.side != OUTSIDE][:, [U, V]])
        if not hits and len(texture):
            biases.begin(used.edges, used.sums, used.step, used.prior_information, pose)


def learn_numbers(
    memory: Memory, used: FitResiduals, faces: Indices, at: View, dt_s: float, shared_part: float
) -> None:
    """Update the numbers that all edges share with what those of a fit at a view say; the biases are relative to them.

    faces: of the patches that were found, before some of them were given up.
    """
    texture, biases, _, frames, numbers = memory
    numbers.unasked_s += dt_s
    if frames % ASK_EVERY == ASK_AT:
        shared_px2 = shared_part * float(np.mean(used.edges.variance_px2 + used.edges.kind_px2))
        prior = PosePrior(used.prior_information, at.R, at.t, numbers.known)
        given = used.sums, biases.before(used.edges), prior, at, shared_px2, numbers.slabs.first[:-1]
        numbers.learn(numbers_seen(*given), numbers.unasked_s)
        numbers.unasked_s = 0.0
        moved = numbers.locate()
    else:
        moved = numbers.unmoved
    if not len(texture):
        biases.forget()  # the offsets of edges are relative to patches
    elif moved is not numbers.unmoved or not len(faces):  # then all patches are new
        of_all, pose = texture.patches.face[: len(texture)], Pose(at.R, at.t)
        texture.shift(faces if len(faces) else of_all, biases.follow(moved, pose), pose)
