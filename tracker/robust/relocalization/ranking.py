"""The fits of one frame, the best one first."""

from typing import NamedTuple

import numpy as np

from uavbench.tracker.protocol import Image
from uavbench.tracker.robust.config.relocalization import RelocalizationConfig
from uavbench.tracker.robust.pose_fit import Fit
from uavbench.trajectories.pose import Array, Pose

UNKNOWNS = 6
"""Of a pose: what its squared Mahalanobis distance is on average where the covariance is right."""


class Sought(NamedTuple):
    """What a slice searches.

    guesses are poses around which to search, the likeliest one first with its covariance (6, 6); first is a fit that
    was made already; sure is the support with which a slice ends; prediction_scale is how large squared errors of this
    run's predictions are, in parts of what their covariances say.
    """

    image: Image
    guesses: list[Pose]
    covariance: Array
    range_m: float
    first: Fit | None = None
    sure: float = np.inf
    prediction_scale: float = 1.0


class Ranking:
    """The fits of one frame, by support, by what was found, and by their distance from the likeliest guess."""

    def __init__(self, sought: Sought, config: RelocalizationConfig) -> None:
        self.config, self.from_guess = config, sought.guesses[0].inverse()
        self.information = np.linalg.inv(sought.covariance)
        self.usual_chi2 = UNKNOWNS * sought.prediction_scale
        self.top = Fit(sought.guesses[0], sought.covariance, 0.0, 0, 0, 0, float("nan"))
        self.score = self.first = -np.inf
        if sought.first is not None and sought.first.finite:
            self.add(sought.first)
            self.first = self.score

    @property
    def advantage(self) -> float:
        """How much better the best fit is than the one at hand; inf where there was none."""
        return self.score - self.first

    def chi2(self, pose: Pose) -> float:
        """Squared Mahalanobis distance of a pose from the likeliest guess."""
        away = (pose @ self.from_guess).log()
        return float(away @ self.information @ away)

    def add(self, fit: Fit) -> None:
        """Rank one more fit."""
        if not fit.finite:
            return
        found = self.config.found_support * float(np.log1p(fit.found))
        score = fit.support + found - self.config.sigma_cost * self.chi2(fit.cam_from_world)
        if score > self.score:
            self.top, self.score = fit, score

    def choose(self, fit: Fit) -> None:
        """Put a fit first that explains the frame better than the best one so far at a place that looks like its."""
        if fit is not self.top:
            self.score = max(self.score, self.first + fit.support - self.top.support)
            self.top = fit

    def worth(self, support: float, pose: Pose) -> float:
        """Support of a fit less what its distance from the prediction costs.

        The cost is the logarithm of a heavy-tailed prior (Student's), whose width is that of the run's own predictions.
        """
        return support - self.config.lead * float(np.log10(1 + self.chi2(pose) / self.usual_chi2))
