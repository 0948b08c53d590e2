"""The fits of one frame, the best one first."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from uavbench.tracker.geometry_kernels import RigidMotion, least_squared_mahalanobis
from uavbench.tracker.protocol import Image
from uavbench.tracker.robust.config.relocalization import RelocalizationConfig
from uavbench.tracker.robust.fit.pose_fit import Fit
from uavbench.tracker.robust.motion_model import FAR_CHI2, Motion
from uavbench.tracker.robust.relocalization.pose_arrays import motion, stack_of
from uavbench.tracker.robust.relocalization.scoring.pose_search import Candidate
from uavbench.tracker.robust.relocalization.surfaces.alignment_kernels import Surface
from uavbench.tracker.robust.solver.solve_kernels import UNKNOWNS
from uavbench.trajectories.pose import Array, Pose

MOST_CONTENDERS = 7
"""Hypotheses that are kept at a time: a pose and its nearest rivals."""


SEARCHED_POSES = 1_000_000_000
"""Poses that may look right by chance among those of a complete search: it scores a million, each of which stands for
some thousand that a fit tells apart, since shifts are scored 20 px apart in an image 640 px wide.
"""
SURE = -3.0
"""Decimal logarithm of the number of false alarms below which chance does not explain a pose; above its opposite it
surely does.
"""
DOUBT = 0.3
"""Factor on the support of a fit that chance explains, and on its lead: less than any frame needs to be `ok`."""


class Likely(NamedTuple):
    """The predicted motion under one hypothesis of the run.

    worth: its support in earlier frames, relative to the best hypothesis; scale: squared errors of its predictions
    relative to their covariances.
    """

    predicted: Motion
    worth: float = 0.0
    scale: float = 1.0

    def prior(self, pose: Pose, lead: float) -> float:
        """Worth of a pose before its frame: that of the hypothesis, minus a cost; lead: the cost of a tenth.

        The cost is the negative logarithm of a heavy-tailed prior (Student's t) around the prediction, with the width
        of the run's prediction errors.
        """
        usual_chi2 = UNKNOWNS * self.scale
        return self.worth - lead * math.log10(1.0 + self.predicted.squared_mahalanobis(pose) / usual_chi2)


class Contender(NamedTuple):
    """A fit that may be the right one: its worth, and the row of the likely pose of which it is the continuation."""

    fit: Fit
    worth: float = 0.0
    follows: int = 0


class Sought(NamedTuple):
    """Input of a slice of the search.

    guesses: poses around which to search, the most likely first, with its covariance (6, 6); first: a fit that was
    already made; sure: support at which a slice ends, unless it is `thorough`: then with the frame's budget;
    recalled: likely poses by what the run saw before; likely: predictions under the hypotheses that the run has kept,
    none for the first guess alone; lost: whether no pose of the last frame was accepted; carried: where the mean
    velocity leads, with which what earlier slices found is moved, None for the first guess; goes_on: whether the next
    frame goes on with the search; tracked: whether the run predicts the frame from a pose shortly before; surfaces: as
    the run saw them.
    """

    image: Image
    guesses: list[Pose]
    covariance: Array
    range_m: float
    first: Fit | None = None
    sure: float = np.inf
    thorough: bool = False
    recalled: Sequence[Pose] = ()
    likely: Sequence[Likely] = ()
    lost: bool = False
    carried: Pose | None = None
    goes_on: bool = False
    tracked: bool = False
    surfaces: Sequence[Surface] = ()


class Ranking:
    """The fits of one frame, ranked by support, weight of inliers, and distance from a likely guess."""

    def __init__(self, sought: Sought, config: RelocalizationConfig) -> None:
        self.config = config
        self.likely = sought.likely or [Likely(Motion(sought.guesses[0], sought.covariance))]
        near = [*(each.predicted.cam_from_world for each in self.likely), sought.carried, *sought.recalled]
        self.near = stack_of([motion(pose) for pose in near if pose is not None])
        self.fits: list[Fit] = []
        self.credits: dict[Fit, float] = {}
        self.rarer: Sequence[Fit] = ()
        self.range_m, self.lost, self.tracked = sought.range_m, sought.lost, sought.tracked
        self.covariance = np.ascontiguousarray(sought.covariance)
        self.given, self.top = sought.first, Fit(sought.guesses[0], sought.covariance, 0.0, 0, 0, 0, float("nan"))
        self.score = self.first = -np.inf
        if sought.first is not None and sought.first.finite:
            self.add(sought.first)
            self.first = self.score

    @property
    def advantage(self) -> float:
        """Advantage of the best fit over the given one; inf without one."""
        return self.score - self.first

    @property
    def is_found(self) -> bool:
        """Whether the best fit is not the given one, and chance would not find it among the poses of a search."""
        return self.top is not self.given and self.top.finite and not is_suspect(self.top)

    def chi2_of_rival(self, pose: RigidMotion) -> float:
        """As `chi2`, by the covariance of the likeliest prediction: how far the camera may have come since."""
        covariance = np.ascontiguousarray(self.likely[0].predicted.covariance)
        return least_squared_mahalanobis(*self.near, *pose, covariance)

    def chi2(self, pose: RigidMotion) -> float:
        """Squared Mahalanobis distance of a pose from the nearest likely or recalled one."""
        return least_squared_mahalanobis(*self.near, *pose, self.covariance)

    def weighed(self, candidate: Candidate) -> Candidate:
        """A candidate, its score reduced by the log-probability of its pose."""
        cost = self.config.sigma_cost * self.chi2(candidate.pose)
        return candidate._replace(score=candidate.score + candidate.cost - cost, cost=cost)

    def add(self, fit: Fit) -> None:
        """Rank one more fit."""
        if not fit.finite:
            return
        self.fits.append(fit)
        found = self.config.found_support * float(np.log1p(fit.found))
        score = believed_support(fit) + found - self.config.sigma_cost * self.chi2(motion(fit.cam_from_world))
        score += max(self.prior(fit.cam_from_world)) if self.tracked else 0.0
        if score > self.score:
            self.top, self.score = fit, score

    def choose(self, fit: Fit) -> None:
        """Rank a rival first that explains the frame better than the best fit so far."""
        if fit is not self.top:
            self.score = max(self.score, self.first + fit.support - self.top.support)
            self.top = fit

    def believe_as_the_best(self, fits: Sequence[Fit]) -> None:
        """Credit fits with the support that they lack of that of the best one; they contend whatever they are worth."""
        self.rarer = fits
        for fit in fits:
            self.credits[fit] = max(self.credits.get(fit, 0.0), self.top.support - fit.support)

    def prior(self, pose: Pose) -> list[float]:
        """Worth of a pose before this frame under each hypothesis."""
        return [each.prior(pose, self.config.lead) for each in self.likely]

    def compared(self, fit: Fit) -> float:
        """Support of a fit in comparisons with others: its own, and what it is credited with."""
        return fit.support + self.credits.get(fit, 0.0)

    def worth(self, support: float, pose: Pose) -> float:
        """Support at a pose, and its worth before this frame under the likeliest hypothesis."""
        return support + max(self.prior(pose))

    @property
    def is_expected(self) -> bool:
        """Whether the best fit is as near to the best hypothesis' prediction as this run's poses usually are."""
        usual = self.config.lead * math.log10(1.0 + FAR_CHI2 / UNKNOWNS)
        return self.likely[0].worth - self.likely[0].prior(self.top.cam_from_world, self.config.lead) < usual

    @property
    def outdone(self) -> float:
        """Worth up to which the best fit clearly leads another pose.

        The lead is larger where no pose of the last frame was accepted: it takes more to be found than to be followed.
        """
        lead = self.config.lead if self.lost else self.config.lead_of_rivals
        return self.worth(self.compared(self.top), self.top.cam_from_world) - lead

    def contenders(self) -> tuple[Contender, ...]:
        """The fits that may be right, the best first; of those that end at about the same pose only one."""
        least, found = self.compared(self.top) - self.config.lead, list[Contender]()
        for fit in self.fits:
            if self.compared(fit) > least:
                prior = self.prior(fit.cam_from_world)
                found.append(Contender(fit, self.compared(fit) + max(prior), prior.index(max(prior))))
        found.sort(key=lambda each: -each.worth)
        kept: list[Contender] = []
        for each in found:
            worthy = each.worth > found[0].worth - self.config.lead or each.fit in self.rarer
            if worthy and not any(
                ends_at(each.fit, other.fit, self.config.found_sigma, self.range_m) for other in kept
            ):
                kept.append(each)
        return tuple(kept[:MOST_CONTENDERS])


def ends_at(fit: Fit, other: Fit, sigma: float, range_m: float) -> bool:
    """Whether two fits end at the same pose, within a standard deviation sigma, relative to the range and in rad."""
    apart = (fit.cam_from_world @ other.cam_from_world.inverse()).log() / sigma
    apart[:3] /= range_m
    return float(apart @ apart) < 1.0


def is_suspect(fit: Fit) -> bool:
    """Whether a random one of the poses of a search may look as right."""
    return fit.log10_false_alarms(SEARCHED_POSES) >= 0.0


def believed_support(fit: Fit) -> float:
    """Support of a fit in a search; less than any frame needs where a random one of its poses may look as right."""
    return fit.support * belief(fit)


def belief(fit: Fit) -> float:
    """Factor on the support of a fit in a search, and on the lead that it has to have."""
    return DOUBT if is_suspect(fit) else 1.0
