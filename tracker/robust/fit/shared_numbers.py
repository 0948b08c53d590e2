"""Numbers that the distances of all edges share: those of an unknown response, and the radius of rounded borders.

Models have sharp borders, and structures round ones, which displace their edges by known functions of the view: see
`rounding_kernels`. The radius is told by how this differs from edge to edge and from view to view.
"""

import numpy as np

from uavbench.scenes.camera import Camera
from uavbench.tracker.robust.config.solver import BiasConfig
from uavbench.tracker.robust.edges.columns import BLOWN, ROUNDED
from uavbench.tracker.robust.edges.rounding_kernels import Rounding
from uavbench.tracker.robust.optics.mixture_kernels import Slabs, mixture
from uavbench.tracker.robust.optics.response import DIFFERENCE, IS_ANOTHER, Response
from uavbench.tracker.robust.solver.number_kernels import NumbersSeen
from uavbench.tracker.robust.solver.number_state import KnownNumbers
from uavbench.trajectories.kernels.compiled import unchecked
from uavbench.trajectories.pose import Array

SIGMA = 0.5
"""Prior standard deviation of numbers that are not 0, 1: of a camera whose response is not sRGB, and of a radius."""
RADIUS_UNIT = 0.01
"""Unit of the radius, as a part of the smallest extent of the structure: by SIGMA, one radius in 20 is more than that.
A carton of 0.3 m has a deviation of 1.5 mm, a hut of 3 m one of 15 mm."""
IS_ROUNDED = 0.02
"""Prior probability that a structure has round borders where its model has none. With 0.003 to 0.05 those of 15 and
30 mm of two structures are learned alike; with even odds errors of sharp boxes are up to 17 % larger."""


class SharedNumbers:
    """State: what the frames say of the numbers, information (r, r) and vector (r,), those `at` (r,) which edges are
    located, and since when none was asked, unasked_s.

    The response is sRGB and borders are sharp, or their numbers are normal: a spike and a slab each.
    """

    def __init__(self, camera: Camera, smallest_m: float, config: BiasConfig) -> None:
        self.response, self.unit_m, self.config = Response(camera), RADIUS_UNIT * smallest_m, config
        of_light = self.response.numbers
        self.count = n = of_light + 2
        first = [0, of_light, of_light + 1, n] if of_light else [0, 1, n]
        groups = len(first) - 1
        chances, decided = np.array([IS_ANOTHER, 1.0, IS_ROUNDED]), np.array([False, False, True])
        self.slabs = Slabs(np.array(first), chances[-groups:].copy(), decided[-groups:].copy())
        self.information, self.vector = np.zeros((n, n)), np.zeros(n)
        self.posterior = mixture(self.information, self.vector, self.slabs, SIGMA)
        self.unmoved, self.unasked_s = np.zeros(n), 0.0
        self.locate_at(np.zeros(n))

    def learn(self, seen: NumbersSeen, dt_s: float) -> None:
        """Add what a frame says, dt_s after the previous one, relative to the numbers by which its edges were located.

        A second counts as one frame: all that see the same offsets say no more than one. The first counts as a whole.
        """
        if not (np.isfinite(seen.information).all() and np.isfinite(seen.vector).all()):
            return
        new = min(1.0, dt_s / self.config.correlation_s) if self.information.any() else 1.0
        kept = 1.0 - self.config.forgotten_part * new
        self.information = kept * self.information + new * seen.information
        self.vector = kept * self.vector + new * (seen.vector + seen.information @ self.at)
        self.posterior = unchecked(mixture)(self.information, self.vector, self.slabs, SIGMA)
        self.locate_at(self.at)

    def locate(self) -> Array:
        """Choose the numbers by which edges are located, the mean; their change (r,)."""
        moved = self.posterior.mean - self.at
        moved[BLOWN] = 0.0
        if not (np.abs(moved) > 2 * DIFFERENCE).any():
            return self.unmoved
        self.locate_at(self.at + moved)
        self.response.locate(self.at[:BLOWN])
        return np.asarray(moved)

    def locate_at(self, numbers: Array) -> None:
        """Locate edges by numbers (r,); `rounding` is their radius, `known` is what is known relative to them."""
        self.at = numbers
        self.rounding = Rounding(float(numbers[ROUNDED]) * self.unit_m, self.unit_m, self.count)
        self.known = KnownNumbers(self.posterior.mean - numbers, self.posterior.covariance)
