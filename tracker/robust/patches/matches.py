"""Arrays of patches and of their matches in an image.

A patch is a grid of SIDE x SIDE texels on a plane of the structure.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.trajectories.kernels.argument_types import named_tuple
from uavbench.trajectories.pose import Array

SIDE = 9
HALF = (SIDE - 1) / 2

Indices = NDArray[np.int64]


class Patches(NamedTuple):
    """Patches of the structure's surface, one row per patch.

    middles (n, 3) centres; axes (n, 2, 3) step of one texel along either axis in units of the model; texels
    (n, SIDE, SIDE) grey values of mean 0 and norm 1; face (n,) of each patch; hits (n,) number of frames in which it
    was an inlier; missed (n,) number of frames since then in which it was not found; taken_s (n,) time of its
    creation.
    """

    middles: Array
    axes: Array
    texels: Array
    face: Indices
    hits: Indices
    missed: Indices
    taken_s: Array

    @classmethod
    def room_for(cls, count: int) -> "Patches":
        """Uninitialized rows for `count` patches."""
        middles, axes, texels = np.zeros((count, 3)), np.zeros((count, 2, 3)), np.zeros((count, SIDE, SIDE))
        face, hits, missed = (np.zeros(count, dtype=np.int64) for _ in range(3))
        return cls(middles, axes, texels, face, hits, missed, np.zeros(count))


class Warp(NamedTuple):
    """A patch at a pose: pixel (u, v) of its centre, steps in px of a texel to the right and down, x before y, and
    whether its area is similar to that at its creation.
    """

    u: float
    v: float
    x_right: float
    x_down: float
    y_right: float
    y_down: float
    alike: bool


class Shift(NamedTuple):
    """Shift (da, db) of a patch in texels, its correlation there, and the mean variance of da and db for texel
    differences of unit variance.
    """

    da: float
    db: float
    correlation: float
    spread: float


class PatchMatches(NamedTuple):
    """Matches of patches in an image.

    places (m, 3) centres of the patches in the world; observed (m, 2) px; correlation (m,), 0 for a patch that was not
    found, -1 for one that was not searched; variance_px2 (m,) of the pixel along either axis.
    """

    places: Array
    observed: Array
    correlation: Array
    variance_px2: Array


PATCHES = named_tuple(Patches, "f2! f3! f3! i1! i1! i1! f1!")
WARP = named_tuple(Warp, "f0 f0 f0 f0 f0 f0 b0")
PATCH_MATCHES = named_tuple(PatchMatches, "f2! f2! f1! f1!")
