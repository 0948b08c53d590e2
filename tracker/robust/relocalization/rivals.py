"""Rivals of a fit: poses at which the structure looks alike, which are fitted and compared with it.

They are few, and known beforehand, so that their whole support counts, unlike that of poses among a million tried.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from uavbench.tracker.geometry_kernels import RigidMotion
from uavbench.tracker.robust.config.relocalization import RelocalizationConfig
from uavbench.tracker.robust.edges.columns import EDGE
from uavbench.tracker.robust.fit.edge_fit import EdgeFitter
from uavbench.tracker.robust.fit.judging import evidence_of_some, parts_found
from uavbench.tracker.robust.fit.pose_fit import Fit, Searched
from uavbench.tracker.robust.motion_model import isotropic_covariance
from uavbench.tracker.robust.relocalization.pose_arrays import motion
from uavbench.tracker.robust.relocalization.ranking import SEARCHED_POSES, SURE, Ranking, Sought
from uavbench.tracker.robust.relocalization.scoring.pose_search import PoseSearch
from uavbench.tracker.robust.relocalization.self_similarity import SelfSimilarity
from uavbench.tracker.robust.relocalization.tried_poses import TriedPoses
from uavbench.tracker.stage_clock import StageClock
from uavbench.trajectories.pose import Array, Pose

SHARED = 48
"""Number of edge points by which shifts of the structure are scored, spread over all visible edges."""
SHARED_EVALUATIONS = 4
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
    """Control points that another pose shares: what each counts (n,) in the support, and which part (n,) was found."""

    counts: Array
    parts: Array


class OnEdges(NamedTuple):
    """Points (n, 3) on edges, and the unit directions (n, 3) of these."""

    points: Array
    along: Array


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

    @property
    def cost(self) -> int:
        """Evaluations in which the rivals of a fit are found."""
        return len(self.similarity.shifts) * SHARED * SHARED_EVALUATIONS + self.searcher.sampling

    @property
    def cost_of_moves(self) -> int:
        """Evaluations in which the moves that explain a fit are found."""
        tried = (1 + len(self.similarity.turns)) * (1 + len(self.similarity.shifts))
        return tried * SHARED * SHARED_EVALUATIONS

    def awaited(self, sought: Sought, ranking: Ranking, tried: TriedPoses) -> int:
        """Number of rivals for which a search leaves room.

        Those of the best fit so far in a thorough search; otherwise as many as were fitted the last time.
        """
        if not sought.thorough:
            return self.made
        return len(self.of(sought, ranking, tried))

    def fit(self, sought: Sought, ranking: Ranking, tried: TriedPoses) -> Compared:
        """Fit the rivals of the best fit, and recursively those of a better rival.

        In a thorough search those without room are taken for as good as the fit that they look like, if the next frame
        goes on with them, or if fewer than half were fitted, and otherwise as the best that were.
        """
        fits, compared = [ranking.top], Compared()
        while rivals := self.of(sought, ranking, tried):
            top, made = ranking.top, list[Fit]()
            for pose in rivals:
                if self.fitter.work.left < self.fitter.cost(1) + self.cost:  # and for rivals of a better one
                    break
                made.append(fit := self.fitted(sought, pose))
                ranking.credits[fit] = self.lacking(fit, top, pose)
                tried.add(pose, 0.0, motion(fit.cam_from_world), ranking.compared(fit))
                tried.rivals = tried.rivals.added(pose)
            fits += [fit for fit in made if fit.finite]
            enough = not sought.goes_on and 2 * len(made) >= len(rivals)
            known = made if enough else [top, *made]
            most = max(map(ranking.compared, known))
            left = [replace(top, cam_from_world=Pose(*pose), support=most) for pose in rivals[len(made) :]]
            left = left if sought.thorough else []
            ranking.fits += [*(fit for fit in made if fit.finite), *left]
            compared = Compared(compared.any or bool(made or left), tuple(left))
            self.choose(fits, ranking)
            if ranking.top is top:
                break
        self.made = self.made if sought.thorough else len(fits) - 1  # for which the next search leaves room
        return compared

    def fitted(self, sought: Sought, pose: RigidMotion) -> Fit:
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
        return best

    def lacking(self, rival: Fit, top: Fit, pose: RigidMotion) -> float:
        """Support, at least 0, that the fit of a rival at a pose lacks although it shows the same pixels as the top.

        The points of the one that the shift between them brings onto edges are the other's. Where more of them are
        found at the top, as its edges were seen before or its fit was repeated, this does not speak against the rival.
        """
        if top.searched is None or rival.searched is None or not rival.finite:
            return 0.0
        shift = shift_between(top.cam_from_world, pose.t)
        there, here = self.shared(top.searched, shift), self.shared(rival.searched, -shift)
        if not (there.counts.any() and here.counts.any()):
            return 0.0
        lacking = here.counts.sum() * np.average(there.parts, weights=there.counts) - here.counts @ here.parts
        patches = np.count_nonzero(rival.searched.aligned.matches.correlation >= 0)
        return max(0.0, float(lacking / max(1.0, rival.searched.problem.counts.sum() + patches)))

    def shared(self, searched: Searched, shift: Array) -> SharedPoints:
        """The control points that a shift (3,) brings onto edges."""
        points, counts = searched.problem.points, searched.problem.counts
        onto = self.similarity.on_edges(points.points + shift, self.along(searched))
        return SharedPoints(counts[onto], parts_found(searched, self.fitter.appearance, self.fitter.values)[onto])

    def along(self, searched: Searched) -> Array:
        """Unit directions (n, 3) of the edges of control points."""
        return self.fitter.edges.directions(searched.problem.points.keys[:, EDGE])

    def choose(self, fits: list[Fit], ranking: Ranking) -> None:
        """Rank the fit of highest worth first; among those of about equal worth, the one nearest to the prediction."""
        worth = [ranking.worth(ranking.compared(fit), fit.cam_from_world) for fit in fits]
        least = max(worth) - self.config.lead_of_rivals
        contending = [fit for fit, each in zip(fits, worth, strict=True) if each > least]
        ranking.choose(min(contending, key=lambda fit: ranking.chi2(motion(fit.cam_from_world))))

    def of(self, sought: Sought, ranking: Ranking, tried: TriedPoses) -> list[RigidMotion]:
        """Untried poses at which the structure looks as at the best fit, most likely first."""
        fit = ranking.top
        by_chance = fit.log10_false_alarms(SEARCHED_POSES) >= -SURE
        unlikely = by_chance if sought.thorough else fit.support < self.min_support
        if not fit.finite or unlikely:
            return []
        if self.found_of is not fit:
            self.found_of, self.found = fit, self.looking_like(ranking, tried)
        return [pose for pose in self.found if not tried.within_reach(pose, tried.rivals).any()]

    def looking_like(self, ranking: Ranking, tried: TriedPoses) -> list[RigidMotion]:
        """Poses at which the structure looks as at the best fit and which may be the right one, most likely first."""
        fit, config = ranking.top, self.config.similarity
        pose = motion(fit.cam_from_world)
        tried.seen = self.searcher.seen(pose).points
        shares = self.shares(fit)
        self.fitter.work.done += self.cost
        places = [
            RigidMotion(pose.R, pose.t - pose.R @ shift) for shift in self.similarity.shifts[shares >= config.share]
        ]
        chi2 = np.array([ranking.chi2_of_rival(place) for place in places])
        found: list[RigidMotion] = []
        known = tried.rivals.added(pose)
        least = ranking.outdone
        for k in np.argsort(chi2, kind="stable")[: np.count_nonzero(chi2 <= RIVAL_CHI2)]:
            possible = len(found) < RIVALS and ranking.worth(1.0, Pose(*places[k])) > least
            if possible and not tried.within_reach(places[k], known).any():
                found.append(places[k])
                known = known.added(places[k])
        return found

    def shares(self, fit: Fit) -> Array:
        """Part (k,) of what was found that each shift of the structure explains as well.

        Of a wrong pose it is all; of what was not found there, the true one may show nothing.
        """
        return self.similarity.shares(*self.some_found(fit))

    def moves(self, fit: Fit, least: float) -> list[RigidMotion]:
        """Shifts and turns of the structure that explain at least this part of what was found as well."""
        self.fitter.work.done += self.cost_of_moves
        return self.similarity.moves(*self.some_found(fit), least)

    def evidence_beside(self, move: RigidMotion, fit: Fit) -> float:
        """Powers of ten by which what a fit finds of edges is likelier than chance, of those that a move of the
        structure brings onto no others.
        """
        if fit.searched is None:
            return 0.0
        points, along = fit.searched.problem.points.points, self.along(fit.searched)
        onto = self.similarity.on_edges(points @ move.R.T + move.t, along @ move.R.T)
        return evidence_of_some(fit.searched, ~onto, self.fitter.values)

    def some_found(self, fit: Fit) -> OnEdges:
        """Some of the control points that a search found, spread over all of them."""
        if fit.searched is None:
            return OnEdges(np.zeros((0, 3)), np.zeros((0, 3)))
        points, found = fit.searched.problem.points.points, fit.searched.found.estimate.weighting.weight > 0
        some = np.flatnonzero(found)
        some = some[np.linspace(0, len(some) - 1, min(len(some), SHARED)).round().astype(np.int64)]
        return OnEdges(points[some], self.along(fit.searched)[some])

    def look_alike(self, fit: Fit, other: Fit, range_m: float) -> bool:
        """Whether what was found at a fit is explained by another one as well, a shift of the structure away."""
        apart = shift_between(fit.cam_from_world, other.cam_from_world.translation)
        near = np.linalg.norm(self.similarity.shifts - apart, axis=1) < self.config.found_sigma * range_m
        return bool(near.any() and self.shares(fit)[near].max() >= self.config.similarity.share)

    def trail_left(self, ranking: Ranking, compared: Compared) -> bool:
        """Whether the best fit has clearly more worth than the rivals that were left are taken to have."""
        least = ranking.outdone
        return all(ranking.worth(ranking.compared(fit), fit.cam_from_world) <= least for fit in compared.left)

    def trail(self, ranking: Ranking, tried: TriedPoses) -> bool:
        """Whether the best fit has clearly more worth than those that converged to other poses in this search."""
        reached, least = tried.reached, ranking.outdone
        others = ~tried.within_reach(motion(ranking.top.cam_from_world), reached) & (tried.supports > least)
        poses = ((k, Pose(reached.R[k], reached.t[k])) for k in np.flatnonzero(others))
        return not any(ranking.worth(tried.supports[k], pose) > least for k, pose in poses)


def shift_between(pose: Pose, translation: Array) -> Array:
    """Shift (3,) of the structure that brings it from a pose to one of the same rotation and this translation (3,)."""
    return np.asarray(pose.rotation.T @ (pose.translation - translation))
