"""Spread of the fits from poses around one: how well a frame tells the pose, whatever its edges are taken for.

The covariance of a fit is that of its own matches. Where the border of a face, the shadow at its foot and a line behind
it are seen a pixel apart, fits from poses around end at others, by other matches that explain the frame as well.
"""

import numpy as np

from uavbench.tracker.robust.fit.pose_fit import Fit
from uavbench.trajectories.pose import Array


class Spread:
    """Where fits end that began around a pose: twists from the fit there, weighted by their likelihood relative to it.

    A fit that is more likely than the one there counts as one that is as likely: the likelihoods of fits to the same
    edges scatter by powers of ten, and a few would outweigh all others.
    """

    def __init__(self) -> None:
        self.away: list[Array] = []
        self.weights: list[float] = []

    def add(self, there: Fit, found: Fit, range_m: float) -> None:
        """Add a fit that began around the pose of another one, or that one itself."""
        self.away.append(away(there, found, range_m))
        self.weights.append(10.0 ** min(0.0, there.chance.whole - found.chance.whole))

    @property
    def sigma(self) -> float:
        """Standard deviation of a fit, as a fraction of the range and in rad together; 0 without fits."""
        if not self.away:
            return 0.0
        away, weights = np.array(self.away), np.array(self.weights)
        deviation = away - np.average(away, axis=0, weights=weights)
        return float(np.sqrt(np.average((deviation**2).sum(axis=1), weights=weights)))


def away(there: Fit, found: Fit, range_m: float) -> Array:
    """Twist (6,) from the pose of one fit to that of another, its translation relative to the range."""
    twist = (found.cam_from_world @ there.cam_from_world.inverse()).log()
    return np.asarray(np.r_[twist[:3] / range_m, twist[3:]])
