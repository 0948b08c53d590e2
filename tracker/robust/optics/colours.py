"""Where the colours of a camera's images lie beside each other, learned from the edges that stand alone."""

import numpy as np

from uavbench.tracker.robust.edges.steps.colour_kernels import BLUE, GREEN, RED, TINY_PX2, SeenColours
from uavbench.tracker.robust.edges.steps.optics_kernels import ALIGNED, OUTWARDS
from uavbench.tracker.robust.optics.mixture_kernels import Slabs, mixture
from uavbench.trajectories.kernels.compiled import unchecked
from uavbench.trajectories.pose import Array

DEVIATION_PX = 0.5
"""Prior standard deviation of the displacements of blue and of red against green, px: outwards at the corner of an
image, and along u and v everywhere. Not tuned."""
NUMBERS = np.array([[0, 2, 3], [1, 4, 5]])
"""Places of the displacements of blue and of red among six numbers: those outwards first."""
LENS = Slabs(np.array([0, 2, 6]), np.array([0.5, 0.1]), np.array([True, True]))
"""Prior probabilities that colours are displaced outwards, as by most lenses, even odds; and by the same everywhere, as
by a lens that is off its axis or a video code whose colours are sampled beside its pixels. Not tuned."""
WORSE = 12.0
"""Ratio of the variance of a channel to that of its fits up to which it may be that of all: the 99.9th percentile of
F(8, 8), as some eight edges are measured. With 3.4, the 95th, weights of channels that are as good are learned of few
edges, and errors beside lateral colour are up to 15 % larger."""


class Colours:
    """State: by how much blue and red are displaced against green, and how well each channel tells of edges.

    known (3, 4): of each channel, as of `Optics`.
    """

    def __init__(self) -> None:
        self.information, self.vector = np.zeros((2, 3, 3)), np.zeros((2, 3))
        self.apart_px2, self.of_fits_px2 = np.zeros(3), np.zeros(3)
        self.frames, self.unasked_s, self.known = 0, 0.0, ALIGNED

    def learn(self, seen: SeenColours, dt_s: float, rate: float) -> None:
        """Update with what a frame says of its colours, dt_s after the previous one; rate, in [0, 1]: its least weight.

        A second counts as one frame: all that see the same edges say no more than one. The first counts as a whole.
        """
        self.unasked_s += dt_s
        if not seen.points:
            return
        new = min(1.0, self.unasked_s) if self.information.any() else 1.0
        self.unasked_s = 0.0
        for total, of_frame in (self.information, seen.information), (self.vector, seen.vector):
            total += new * (of_frame - rate * total)
        displaced_px, before = self.displaced_px, self.known[:, OUTWARDS:]
        if np.square(displaced_px - before).max() > seen.of_fits_px2.min():
            self.frames, weights = 0, np.ones(3)  # what is left was measured beside other displacements
        else:
            self.frames += 1
            for mean, of_frame in (self.apart_px2, seen.apart_px2), (self.of_fits_px2, seen.of_fits_px2):
                mean += max(rate, 1 / self.frames) * (of_frame - mean)
            weights = self.weights
        self.known = np.column_stack([weights, displaced_px])

    @property
    def displaced_px(self) -> Array:
        """Displacements (3, 3) of the channels from green, where the model is projected: outwards, along u and v."""
        information, vector = np.zeros((6, 6)), np.zeros(6)
        for k, at in enumerate(NUMBERS):
            information[np.ix_(at, at)], vector[at] = self.information[k], self.vector[k]
        told = unchecked(mixture)(information, vector, LENS, DEVIATION_PX)
        displaced_px = np.zeros((3, 3))
        displaced_px[[BLUE, RED]] = told.mean[NUMBERS]
        return displaced_px

    @property
    def weights(self) -> Array:
        """Weights (3,) of the channels, that of the best 1: by how much more the variance of each is than of its fits.

        Of three that are compared in pairs the variance of each is known: the three-cornered hat of clocks (Gray &
        Allan 1974).
        """
        blue_green, red_green, blue_red = self.apart_px2
        px2 = np.zeros(3)
        px2[BLUE] = (blue_green + blue_red - red_green) / 2
        px2[GREEN] = (blue_green + red_green - blue_red) / 2
        px2[RED] = (red_green + blue_red - blue_green) / 2
        more = px2 / np.maximum(self.of_fits_px2, TINY_PX2)
        weights = 1 / np.where(more > WORSE, more, 1.0)
        return np.asarray(weights / weights.max())
