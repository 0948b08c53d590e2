"""What is learned from a fit: the looks and distances of edges, the biases, patches, and what all edges share."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.tracker.protocol import Image
from uavbench.tracker.robust.edges.columns import OUTSIDE, U, V
from uavbench.tracker.robust.edges.measurements import SearchLines
from uavbench.tracker.robust.fit.pose_fit import MIN_POINTS, Fit, FitResiduals
from uavbench.tracker.robust.fit.shared_numbers import SharedNumbers
from uavbench.tracker.robust.patches.patches import MOST_USED, Texture
from uavbench.tracker.robust.solver.equation_kernels import PosePrior
from uavbench.tracker.robust.solver.nuisance_biases import NuisanceBiases
from uavbench.tracker.robust.solver.number_kernels import numbers_seen
from uavbench.tracker.robust.view import View
from uavbench.trajectories.pose import Array, Pose

Indices = NDArray[np.int64]
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
    """A frame's image (h, w, c), the view at its fit, and the search lines and residuals there."""

    image: Image
    at: View
    lines: SearchLines
    residuals: FitResiduals


def learn_patches(memory: Memory, seen: Seen, fit: Fit, dt_s: float, good_support: float) -> Indices:
    """Update the patches and the biases with a fit, dt_s after the previous one; take new patches where they are due.

    Patches are taken where the edges' support is good. Returns the faces of those that were found, before some of them
    were given up.
    """
    texture, biases, pose = memory.texture, memory.biases, fit.cam_from_world
    image, at, lines, used = seen
    hits, faces, _ = texture.count_hits(used.chosen, used.weighting.patch_weight, used.correlation)
    if hits:
        twist = biases.learn(used.edges, used.sums, used.step.to_patches, pose, dt_s)
        texture.shift(faces, twist, at)  # others keep their places: the frame says nothing of them
    few = hits < MIN_POINTS
    in_turn = memory.frames % TAKE_EVERY == 0 and (few or texture.now_s - texture.searched_s > TAKE_AFTER_S)
    due = (few and not texture.barren) or in_turn
    if due and hits < MOST_USED and fit.edge_support >= good_support:
        texture.take(image, pose, lines.lines[lines.side != OUTSIDE][:, [U, V]])
        if not hits and len(texture):
            biases.begin(used.edges, used.sums, used.step, used.prior_information, pose)
    return faces


def learn_numbers(memory: Memory, seen: Seen, faces: Indices, dt_s: float, shared_part: float) -> None:
    """Update the numbers that all edges share with what those of a frame say; the biases are relative to them.

    faces: of the patches that were found, before some of them were given up.
    """
    texture, biases, _, frames, numbers = memory
    at, used = seen.at, seen.residuals
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
        texture.shift(faces if len(faces) else of_all, biases.follow(moved, pose), at)
