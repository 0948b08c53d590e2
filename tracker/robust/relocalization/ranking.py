"""The fits of one frame, the best one first."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from uavbench.tracker.protocol import Image
from uavbench.tracker.robust.config.relocalization import RelocalizationConfig
from uavbench.tracker.robust.pose_fit import Fit
from uavbench.tracker.robust.relocalization.pose_search import Candidate
from uavbench.trajectories.pose import Array, Pose

UNKNOWNS = 6
"""Degrees of freedom of a pose, the expectation of its squared Mahalanobis distance."""


SEARCHED_POSES = 1_000_000
"""Poses of a complete search, of some 60 edge points each, that may look right by chance."""
DOUBT = 0.3
"""Factor on the support of a fit that chance explains: less than any frame needs, in the order of such fits."""


class Sought(NamedTuple):
    """Input of a slice of the search.

    guesses: poses around which to search, the most likely first, with its covariance (6, 6); first: a fit that was
    already made; sure: support at which a slice ends, unless it is `thorough`: then with the frame's budget;
    prediction_scale: squared errors of this run's predictions relative to their covariances; recalled: likely poses by
    what the run saw before.
    """

    image: Image
    guesses: list[Pose]
    covariance: Array
    range_m: float
    first: Fit | None = None
    sure: float = np.inf
    prediction_scale: float = 1.0
    thorough: bool = False
    recalled: Sequence[Pose] = ()


class Ranking:
    """The fits of one frame, ranked by support, weight of inliers, and distance from a likely guess."""

    def __init__(self, sought: Sought, config: RelocalizationConfig) -> None:
        self.config = config
        self.from_guess = [pose.inverse() for pose in (sought.guesses[0], *sought.recalled)]
        self.information = np.linalg.inv(sought.covariance)
        self.usual_chi2 = UNKNOWNS * sought.prediction_scale
        self.top = Fit(sought.guesses[0], sought.covariance, 0.0, 0, 0, 0, float("nan"))
        self.score = self.first = -np.inf
        if sought.first is not None and sought.first.finite:
            self.add(sought.first)
            self.first = self.score

    @property
    def advantage(self) -> float:
        """Advantage of the best fit over the given one; inf without one."""
        return self.score - self.first

    def chi2(self, pose: Pose) -> float:
        """Squared Mahalanobis distance of a pose from the most likely guess, or from a recalled pose that is nearer."""
        away = np.array([(pose @ inverse).log() for inverse in self.from_guess])
        return float(np.einsum("ki,ij,kj->k", away, self.information, away).min())

    def weighed(self, candidate: Candidate) -> Candidate:
        """A candidate, its score reduced by the log-probability of its pose."""
        cost = self.config.sigma_cost * self.chi2(Pose(*candidate.pose))
        return candidate._replace(score=candidate.score + candidate.cost - cost, cost=cost)

    def add(self, fit: Fit) -> None:
        """Rank one more fit."""
        if not fit.finite:
            return
        found = self.config.found_support * float(np.log1p(fit.found))
        score = believed_support(fit) + found - self.config.sigma_cost * self.chi2(fit.cam_from_world)
        if score > self.score:
            self.top, self.score = fit, score

    def choose(self, fit: Fit) -> None:
        """Rank a rival first that explains the frame better than the best fit so far."""
        if fit is not self.top:
            self.score = max(self.score, self.first + fit.support - self.top.support)
            self.top = fit

    def worth(self, support: float, pose: Pose) -> float:
        """Support of a fit minus the cost of its distance from the prediction.

        The cost is the negative logarithm of a heavy-tailed prior (Student's t), with the width of the run's prediction
        errors.
        """
        return support - self.config.lead * float(np.log10(1 + self.chi2(pose) / self.usual_chi2))


def believed_support(fit: Fit) -> float:
    """Support of a fit in a search; less than any frame needs where a random one of its poses may look as right."""
    return fit.support * (DOUBT if fit.log10_false_alarms(SEARCHED_POSES) >= 0.0 else 1.0)
