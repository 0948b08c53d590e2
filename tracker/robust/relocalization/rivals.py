"""Rivals of a fit: poses at which the structure looks alike, which are fitted and compared with it.

They are few, and known beforehand, so that their whole support counts, unlike that of poses among a million tried.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.tracker.geometry_kernels import RigidMotion
from uavbench.tracker.robust.config.relocalization import RelocalizationConfig
from uavbench.tracker.robust.edges.columns import EDGE
from uavbench.tracker.robust.fit.edge_fit import EdgeFitter
from uavbench.tracker.robust.fit.pose_fit import Fit, Searched
from uavbench.tracker.robust.motion_model import isotropic_covariance
from uavbench.tracker.robust.relocalization.pose_arrays import motion
from uavbench.tracker.robust.relocalization.pose_search import PoseSearch
from uavbench.tracker.robust.relocalization.ranking import SEARCHED_POSES, Ranking, Sought
from uavbench.tracker.robust.relocalization.self_similarity import SelfSimilarity
from uavbench.tracker.robust.relocalization.tried_poses import TriedPoses
from uavbench.tracker.stage_clock import StageClock
from uavbench.trajectories.pose import Array, Pose

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


class Compared(NamedTuple):
    """Whether the best fit has any rivals; left: those without room to be fitted, as their fits are taken to be."""

    any: bool = False
    left: tuple[Fit, ...] = ()


class SharedPoints(NamedTuple):
    """Part (n,) of each control point that was found, and the mask (n,) of those that a rival shares."""

    parts: Array
    shared: NDArray[np.bool_]


class Rivals:
    """Finds and fits the rivals of fits."""

    def __init__(self, fitter: EdgeFitter, searcher: PoseSearch, config: RelocalizationConfig) -> None:
        self.fitter, self.searcher, self.config = fitter, searcher, config
        self.similarity = SelfSimilarity(fitter.edges)
        self.found_of: Fit | None = None
        self.found: list[RigidMotion] = []
        self.made = 0

    @property
    def min_support(self) -> float:
        """Least support of a fit that has rivals, whatever chance may do."""
        return self.fitter.config.loss.min_support

    def awaited(self, sought: Sought, ranking: Ranking, tried: TriedPoses) -> int:
        """Number of rivals for which a search leaves room.

        Those of the best fit so far in a thorough search; otherwise as many as were fitted the last time.
        """
        if not sought.thorough:
            return self.made
        return len(self.of(sought, ranking, tried)) if ranking.top.support >= self.min_support else 0

    def fit(self, sought: Sought, ranking: Ranking, tried: TriedPoses) -> Compared:
        """Fit the rivals of the best fit, and recursively those of a better rival.

        In a thorough search those without room are taken for as good as the best that were fitted and, if these were
        fewer than half, as the fit that they look like.
        """
        fits, compared = [ranking.top], Compared()
        while rivals := self.of(sought, ranking, tried):
            top, made = ranking.top, list[Fit]()
            for pose in rivals:
                if not self.fitter.has_room_for(1):
                    break
                fit = self.fitted(sought, ranking.top, pose)
                tried.add(pose, 0.0, motion(fit.cam_from_world), fit.compared_support)
                tried.rivals = tried.rivals.added(pose)
                made.append(fit)
            fits += [fit for fit in made if fit.finite]
            known = made if 2 * len(made) >= len(rivals) else [top, *made]
            most = max(fit.support for fit in known)
            left = [replace(top, cam_from_world=Pose(*pose), support=most) for pose in rivals[len(made) :]]
            left = left if sought.thorough else []
            ranking.fits += [*(fit for fit in made if fit.finite), *left]
            compared = Compared(compared.any or bool(made or left), tuple(left))
            self.choose(fits, ranking)
            if ranking.top is top or not self.fitter.has_room_for(1):
                break
        self.made = len(fits) - 1
        return compared

    def fitted(self, sought: Sought, top: Fit, pose: RigidMotion) -> Fit:
        """The better of two fits of a rival: from anywhere near, and from its pose, known as well as the top is."""
        best = None
        for sigma in (self.config.found_sigma, self.fitter.config.initialization.sigma):
            if best is not None and not self.fitter.has_room_for(1):
                break
            covariance = isotropic_covariance(sigma, sought.range_m)
            fit = self.fitter.searched(sought.image, Pose(*pose), covariance, StageClock(), self.searcher.half_px)
            if best is None or (fit.finite and not best.support >= fit.support):
                best = fit
        assert best is not None
        return replace(best, credit=self.credit(top, best, pose)) if best.finite else best

    def credit(self, top: Fit, rival: Fit, pose: RigidMotion) -> float:
        """Support that a rival lacks although the image is the same: that of the points that it shares with the top.

        The points of the one that the shift between them brings onto edges are the other's. Where more of them are
        found at the top, as its edges were seen before or its fit was repeated, this does not speak against the rival.
        """
        if top.searched is None or rival.searched is None:
            return 0.0
        at = top.cam_from_world
        shift = at.rotation.T @ (at.translation - pose.t)
        there, here = self.points(top.searched, shift), self.points(rival.searched, -shift)
        if not (there.shared.any() and here.shared.any()):
            return 0.0
        counts = rival.searched.problem.counts
        part = np.average(there.parts[there.shared], weights=top.searched.problem.counts[there.shared])
        lacking = (counts * (part - here.parts))[here.shared].sum()
        searched = np.count_nonzero(rival.searched.aligned.matches.correlation >= 0)
        return max(0.0, float(lacking / max(1.0, counts.sum() + searched)))

    def points(self, searched: Searched, shift: Array) -> SharedPoints:
        """Which parts of a fit's control points were found, and which of them a shift (3,) brings onto edges."""
        points, ends = searched.problem.points, self.fitter.edges.ends
        along = ends[points.keys[:, EDGE], 1] - ends[points.keys[:, EDGE], 0]
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        return SharedPoints(self.fitter.found_parts(searched), self.similarity.on_edges(points.points + shift, along))

    def choose(self, fits: list[Fit], ranking: Ranking) -> None:
        """Rank the fit of highest worth first; among those of about equal worth, the one nearest to the prediction."""
        worth = [ranking.worth(fit.compared_support, fit.cam_from_world) for fit in fits]
        least = max(worth) - self.config.lead_of_rivals
        contending = [fit for fit, each in zip(fits, worth, strict=True) if each > least]
        ranking.choose(min(contending, key=lambda fit: ranking.chi2(fit.cam_from_world)))

    def of(self, sought: Sought, ranking: Ranking, tried: TriedPoses) -> list[RigidMotion]:
        """Untried poses at which the structure looks as at the best fit, most likely first."""
        fit = ranking.top
        unlikely = fit.log10_false_alarms(SEARCHED_POSES) >= 0.0 if sought.thorough else fit.support < self.min_support
        if not fit.finite or unlikely:
            return []
        if self.found_of is not fit:
            self.found_of, self.found = fit, self.looking_like(ranking, tried)
        return [pose for pose in self.found if not tried.within_reach(pose, tried.rivals).any()]

    def looking_like(self, ranking: Ranking, tried: TriedPoses) -> list[RigidMotion]:
        """Poses at which the structure looks as at the best fit and which may be the right one, most likely first."""
        fit, config = ranking.top, self.config.similarity
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
        least = ranking.outdone
        for k in np.argsort(chi2, kind="stable")[: np.count_nonzero(chi2 <= RIVAL_CHI2)]:
            possible = len(found) < RIVALS and ranking.worth(1.0, Pose(*places[k])) > least
            if possible and not tried.within_reach(places[k], known).any():
                found.append(places[k])
                known = known.added(places[k])
        return found

    def trail_left(self, ranking: Ranking, compared: Compared) -> bool:
        """Whether the best fit has clearly more worth than the rivals that were left are taken to have."""
        least = ranking.outdone
        return all(ranking.worth(fit.compared_support, fit.cam_from_world) <= least for fit in compared.left)

    def trail(self, ranking: Ranking, tried: TriedPoses) -> bool:
        """Whether the best fit has clearly more worth than those that converged to other poses in this search."""
        reached, least = tried.reached, ranking.outdone
        others = ~tried.within_reach(motion(ranking.top.cam_from_world), reached) & (tried.supports > least)
        poses = ((k, Pose(reached.R[k], reached.t[k])) for k in np.flatnonzero(others))
        return not any(ranking.worth(tried.supports[k], pose) > least for k, pose in poses)
