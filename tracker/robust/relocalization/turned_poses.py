"""Poses turned to either side of the best fit: whether fits from there end where it does.

A view of few edges may look about as right over a range of poses, none of which its covariance tells of.
"""

from collections.abc import Iterator
from itertools import product

import numpy as np

from uavbench.tracker.geometry_kernels import RigidMotion
from uavbench.tracker.robust.config.relocalization import RelocalizationConfig
from uavbench.tracker.robust.fit.edge_fit import EdgeFitter
from uavbench.tracker.robust.fit.pose_fit import Fit
from uavbench.tracker.robust.motion_model import isotropic_covariance
from uavbench.tracker.robust.relocalization.pose_arrays import motion
from uavbench.tracker.robust.relocalization.ranking import Ranking, Sought, believed_support, ends_at
from uavbench.tracker.robust.relocalization.scoring.pose_search import PoseSearch
from uavbench.tracker.robust.relocalization.scoring.pose_search_kernels import turned_about
from uavbench.tracker.robust.relocalization.tried_poses import TriedPoses
from uavbench.tracker.stage_clock import StageClock
from uavbench.trajectories.pose import Pose


class TurnedPoses:
    """Fits poses that are turned about the edges seen, and compares them with the best fit."""

    def __init__(self, fitter: EdgeFitter, searcher: PoseSearch, config: RelocalizationConfig) -> None:
        self.fitter, self.searcher, self.config = fitter, searcher, config

    def agree(self, sought: Sought, ranking: Ranking, tried: TriedPoses) -> bool:
        """Fit the poses beside the best fit, and beside a better one elsewhere, while the budget lasts.

        Returns whether all of these fits that explain the frame about as well end where the best one does.
        """
        fits: list[Fit] = []
        best: Fit | None = None
        while best is None or not self.ends_at(best, ranking.top, sought.range_m):
            best = ranking.top
            for pose in self.beside(best):
                if self.fitter.work.left < self.fitter.cost(1, located=2):  # its edges, and those of the best fit
                    break
                fits.append(self.fit(pose, sought))
                ranking.add(fits[-1])
                tried.add(pose, 0.0, motion(fits[-1].cam_from_world), believed_support(fits[-1]))
        least = believed_support(ranking.top) - self.config.lead
        likely = [fit for fit in fits if believed_support(fit) > least]
        return all(self.ends_at(ranking.top, fit, sought.range_m) for fit in likely)

    def fit(self, pose: RigidMotion, sought: Sought) -> Fit:
        """The fit from a pose that is as uncertain as one that a search found."""
        covariance = isotropic_covariance(self.config.found_sigma, sought.range_m)
        return self.fitter.fit(sought.image, Pose(*pose), covariance, StageClock(), self.searcher.half_px)

    def beside(self, fit: Fit) -> Iterator[RigidMotion]:
        """The pose of a fit, turned to the left, right, up and down; none without control points."""
        pose, focus = motion(fit.cam_from_world), fit.focus
        for axis, sign in product((0, 1), (1.0, -1.0)):
            if focus is not None:
                change = np.zeros(6)
                change[axis] = sign * self.searcher.turn_rad
                yield turned_about(pose.R, pose.t, focus, change)

    def ends_at(self, fit: Fit, other: Fit, range_m: float) -> bool:
        """Whether two fits end at the same pose, within the standard deviation of one that a search found."""
        return ends_at(fit, other, self.config.found_sigma, range_m)
