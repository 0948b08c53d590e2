"""Rivals of a fit: poses at which the structure looks alike, which are fitted and compared with it."""

import numpy as np

from uavbench.tracker.geometry_kernels import RigidMotion
from uavbench.tracker.robust.config.relocalization import RelocalizationConfig
from uavbench.tracker.robust.edge_fit import EdgeFitter
from uavbench.tracker.robust.motion_model import isotropic_covariance
from uavbench.tracker.robust.pose_fit import Fit
from uavbench.tracker.robust.relocalization.pose_arrays import motion
from uavbench.tracker.robust.relocalization.pose_search import PoseSearch
from uavbench.tracker.robust.relocalization.ranking import Ranking, Sought, believed_support
from uavbench.tracker.robust.relocalization.self_similarity import SelfSimilarity
from uavbench.tracker.robust.relocalization.tried_poses import TriedPoses
from uavbench.tracker.stage_clock import StageClock
from uavbench.trajectories.pose import Pose

SHARED = 48
"""Number of edge points by which shifts of the structure are scored, spread over all visible edges."""
SHARED_EVALUATIONS = 40
"""Cost of looking up one of them, in evaluations (see `BudgetConfig`). Measured on the same core."""

RIVALS = 6
"""Most rivals fitted at a time, most likely first: four direct and two diagonal neighbours of a window."""
RIVAL_CHI2 = 25.0
"""Largest squared Mahalanobis distance of a rival from the prediction: 99.97 % quantile of chi-square with six degrees
of freedom.
"""


class Rivals:
    """Finds and fits the rivals of fits; stores how many fits were made the last time."""

    def __init__(self, fitter: EdgeFitter, searcher: PoseSearch, config: RelocalizationConfig) -> None:
        self.fitter, self.searcher, self.config = fitter, searcher, config
        self.similarity = SelfSimilarity(fitter.edges)
        self.reserved_fits = 0

    def fit(self, sought: Sought, ranking: Ranking, tried: TriedPoses) -> bool:
        """Fit the rivals of the best fit, and recursively those of a better rival; returns whether there were any."""
        clock, fits = StageClock(), [ranking.top]
        while rivals := self.of(ranking, tried):
            top = ranking.top
            for pose in rivals:
                if not self.fitter.has_room_for(1):
                    break
                covariance = isotropic_covariance(self.config.found_sigma, sought.range_m)
                fit = self.fitter.searched(sought.image, Pose(*pose), covariance, clock, self.searcher.half_px)
                tried.add(pose, 0.0, motion(fit.cam_from_world), believed_support(fit))
                tried.rivals = tried.rivals.added(pose)
                fits += [fit] if fit.finite else []
            self.choose(fits, ranking)
            if ranking.top is top or not self.fitter.has_room_for(1):
                break
        self.reserved_fits = len(fits) - 1
        return len(fits) > 1

    def choose(self, fits: list[Fit], ranking: Ranking) -> None:
        """Rank the fit of highest worth first; among those of about equal worth, the one nearest to the prediction."""
        worth = [ranking.worth(believed_support(fit), fit.cam_from_world) for fit in fits]
        least = max(worth) - self.config.lead_of_rivals
        contending = [fit for fit, each in zip(fits, worth, strict=True) if each > least]
        ranking.choose(min(contending, key=lambda fit: ranking.chi2(fit.cam_from_world)))

    def of(self, ranking: Ranking, tried: TriedPoses) -> list[RigidMotion]:
        """Untried poses at which the structure looks as at the best fit, most likely first."""
        fit, config = ranking.top, self.config.similarity
        if not (fit.finite and fit.support >= self.fitter.config.loss.min_support):
            return []
        pose = motion(fit.cam_from_world)
        seen = self.searcher.seen(pose)
        tried.seen = seen.points
        shares = self.similarity.shares(seen.points[:SHARED], seen.direction[:SHARED])
        self.fitter.work.done += len(shares) * SHARED * SHARED_EVALUATIONS + self.searcher.sampling
        places = [
            RigidMotion(pose.R, pose.t - pose.R @ shift) for shift in self.similarity.shifts[shares >= config.share]
        ]
        chi2 = np.array([ranking.chi2(Pose(*place)) for place in places])
        found: list[RigidMotion] = []
        known = tried.rivals.added(pose)
        for k in np.argsort(chi2, kind="stable")[: np.count_nonzero(chi2 <= RIVAL_CHI2)]:
            if len(found) < RIVALS and not tried.within_reach(places[k], known).any():
                found.append(places[k])
                known = known.added(places[k])
        return found

    def trail(self, ranking: Ranking, tried: TriedPoses) -> bool:
        """Whether the best fit has clearly more worth than those that converged to other poses in this search."""
        top, reached = ranking.top, tried.reached
        least = ranking.worth(believed_support(top), top.cam_from_world) - self.config.lead_of_rivals
        others = ~tried.within_reach(motion(top.cam_from_world), reached) & (tried.supports > least)
        poses = ((k, Pose(reached.R[k], reached.t[k])) for k in np.flatnonzero(others))
        return not any(ranking.worth(tried.supports[k], pose) > least for k, pose in poses)
