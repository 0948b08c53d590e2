"""Scale of the covariance that is reported: the variance of unit weight, learned from how the edges spread."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from uavbench.scenes.camera import Camera
from uavbench.tracker.robust.config.solver import EstimatorConfig
from uavbench.tracker.robust.edges.columns import BOTH_FACES
from uavbench.tracker.robust.fit.displaced_kernels import left_by_displaced
from uavbench.tracker.robust.fit.pose_fit import NO_ROWS, Fit
from uavbench.tracker.robust.solver.bias_state import BiasState
from uavbench.tracker.robust.solver.spread_kernels import Spread, edge_spread, mean_residuals
from uavbench.trajectories.kernels.compiled import compiled, unchecked
from uavbench.trajectories.pose import Array

PRIOR_FREEDOM, PRIOR_VARIANCE = 6.0, 0.75
"""Degrees of freedom of the prior, as many as a pose has, and its variance of unit weight, of those assumed: that of
edges is 0.2 to 0.5 on 20 rendered flights of boxes, walls and bridges, and the squares of errors of the pose 0.5."""
SHARED_PX = 0.01
"""Deviation, in px, of a shift that all of an image shares and no spread shows, as from light that comes from above:
0.005 to 0.04 px on rendered facades, less on bridges."""
CODES_PART2 = 1 / 3
"""Mean square of the part of an image's blur, beyond that of a pixel, that is of its codes, and not of its light as is
thought: any from none to all is as likely. Not tuned."""
NOTHING_SEEN = Spread(0.0, 0.0)

Indices = NDArray[np.int64]


@compiled("f2 f0 f1 (f0 f0)")
def reported(of_fit: Array, variance: float, by_codes: Array, shared2: tuple[float, float]) -> Array:
    """Covariance (6, 6) of a fit with a variance of unit weight, as of `UnitWeight.covariance`.

    shared2: mean squares of what the shift of the image turns the camera by, about x and y.
    """
    covariance = np.empty((6, 6))
    for i in range(6):
        for j in range(6):
            of_codes = CODES_PART2 * (by_codes[i] * by_codes[j])
            covariance[i, j] = variance * of_fit[i, j] + of_codes + 0.0  # no number is a negative zero
    covariance[3, 3] += shared2[0]
    covariance[4, 4] += shared2[1]
    return covariance


@dataclass
class UnitWeight:
    """Running means of the edges' spread in the frames of a run, a new one of which weighs at least `rate`.

    members (e,): the member that each of the model's edges is of; none where each is one. width_px: of the last
    iteration of a fit.
    """

    rate: float
    spread: Spread = NOTHING_SEEN
    frames: int = 0
    members: Indices = field(default_factory=lambda: NO_ROWS)
    width_px: float = EstimatorConfig().last_width_px

    def learn(self, fit: Fit, state: BiasState) -> None:
        """Update with the fit of an accepted frame; nothing is learned from one without edges between the pixels."""
        used = fit.residuals
        if used is None or not np.count_nonzero(used.steps):
            return
        response, first = used.step.to_numbers, used.points.first
        seen = unchecked(edge_spread)(used.sums, used.edges, state, first, used.steps, response, fit.covariance)
        self.frames += 1
        new = max(self.rate, 1 / self.frames)
        old = self.spread
        self.spread = Spread((1 - new) * old.chi2 + new * seen.chi2, (1 - new) * old.freedom + new * seen.freedom)

    @property
    def variance(self) -> float:
        """Variance of an observation of unit weight: the mean of its posterior.

        Its prior is inverse chi-square with PRIOR_FREEDOM degrees of freedom and a scale of PRIOR_VARIANCE (Gelman et
        al. 2013, Bayesian Data Analysis, sec. 3.2); the edges of one frame count, since the next frames see the same
        offsets.
        """
        freedom = max(0.0, self.spread.freedom)
        return (PRIOR_FREEDOM * PRIOR_VARIANCE + self.spread.chi2) / (PRIOR_FREEDOM + freedom - 2.0)

    def covariance(self, of_fit: Array, camera: Camera, by_codes: Array) -> Array:
        """Covariance (6, 6) that is reported of a fit with a covariance: scaled, with the shift of the image.

        by_codes (6,): twist by which the pose is displaced if the blur of the image is of its codes, which is not told.
        """
        shared2 = (SHARED_PX / camera.fy) ** 2, (SHARED_PX / camera.fx) ** 2
        return unchecked(reported)(of_fit, self.variance, by_codes, shared2)

    def displaced(self, fit: Fit) -> Array:
        """What `covariance` lacks (6, 6) where the edges of a fit are displaced alike, as by a model that is not exact.

        It is weighed by how probable that is by their residuals. A fit follows those that happen to agree.
        """
        used = fit.residuals
        if used is None:
            return np.zeros((6, 6))
        residual = unchecked(mean_residuals)(used.sums, used.points.first, used.steps, used.step.to_numbers)
        rows = used.edges.rows
        members = self.members[rows // BOTH_FACES] if len(self.members) else rows
        given = used.sums, used.edges, residual, members, fit.covariance
        return np.asarray(unchecked(left_by_displaced)(*given, self.variance, self.width_px))
