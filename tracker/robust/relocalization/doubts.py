"""Doubts about a pose that a search found, at first or anew: poses around it and the best other one are fitted.

A track confirms itself, since the appearance of the edges is learned where they are thought to be. Poses are therefore
compared, and judged, by a fitter that has learned nothing.
"""

import numpy as np

from uavbench.tracker.protocol import Image
from uavbench.tracker.robust.fit.edge_fit import EdgeFitter
from uavbench.tracker.robust.fit.pose_fit import Fit
from uavbench.tracker.robust.fit.spread import Spread, away
from uavbench.tracker.robust.motion_model import isotropic_covariance
from uavbench.tracker.robust.relocalization.pose_arrays import NONE, motion
from uavbench.tracker.robust.relocalization.ranking import SEARCHED_POSES, SURE, believed_support
from uavbench.tracker.robust.relocalization.relocate import Relocator
from uavbench.tracker.robust.relocalization.tried_poses import COMPARED, TriedPoses
from uavbench.tracker.stage_clock import StageClock
from uavbench.trajectories.pose import Pose

ENOUGH = 32
"""Poses tried around one after which it is not doubted any more, if they tell it well enough. Measured on 264 wrong
initial poses, before their spread was: with 16, three wrong poses of nine are kept, with 32 none."""
ELSEWHERE_EVERY = 4
"""Of so many poses that are fitted, the last is around the best other pose: of two equal boxes a search may have found
one, and of the other no more than where it is."""
MOST_FRAMES = 15
"""Frames without room for a fit after which no more are awaited."""


class Doubts:
    """Poses around a tracked one, fitted without memory in as many frames as that takes.

    A pose is doubted until enough fits in succession spread no farther than an accepted pose may be off, and until one
    of the frames leaves no doubt that it was not found by chance.
    """

    def __init__(self, relocator: Relocator) -> None:
        self.fitter, self.config = relocator.fitter, relocator.fitter.config
        self.relocator, self.searcher = relocator, relocator.searcher
        self.innocent = self.fitter.without_memory()
        self.tried = 0
        self.end()

    def begin(self, fit: Fit, judged: int = 1) -> None:
        """Doubt the pose of a fit by which nothing was learned yet, the best one of so many frames that were judged."""
        self.surrounding, self.without_room, self.spread = 0, 0, Spread()
        self.judged, self.by_chance = judged, is_by_chance(fit, judged)
        self.elsewhere, self.support_elsewhere = self.relocator.elsewhere, 0.0

    def end(self) -> None:
        """Doubt no pose."""
        self.surrounding, self.without_room, self.judged, self.by_chance = ENOUGH, 0, 0, False
        self.spread, self.elsewhere, self.support_elsewhere = Spread(), None, 0.0

    @property
    def settled(self) -> bool:
        """Whether no pose is doubted (any more)."""
        return self.surrounded and not self.by_chance

    @property
    def surrounded(self) -> bool:
        """Whether enough poses were tried around the present one."""
        return self.surrounding >= ENOUGH or self.without_room >= MOST_FRAMES

    def anew(self, image: Image, fit: Fit, range_m: float) -> Fit:
        """A fit at the pose of a given one, without memory."""
        known = isotropic_covariance(self.config.initialization.sigma, range_m)
        return self.without_memory().searched(image, fit.cam_from_world, known, StageClock())

    def without_memory(self) -> EdgeFitter:
        """The fitter that has learned nothing, with what is left of the frame's budget."""
        self.innocent.view = self.fitter.view
        self.innocent.work, self.innocent.most_points = self.fitter.work, self.fitter.most_points
        self.innocent.most_edges = self.fitter.most_edges
        return self.innocent

    def better(self, image: Image, fit: Fit, range_m: float) -> Fit | None:
        """A fit with clearly more support than the given one, both without memory; None if none is found.

        It spends what is left of the frame's budget.
        """
        config = self.config.relocalization
        if not self.without_memory().has_room_for(2):
            self.without_room += 1
            return None
        base = self.anew(image, fit, range_m)
        if base.focus is None or not base.finite:
            return None
        self.judged += 1
        self.by_chance &= is_by_chance(base, self.judged)
        best = self.best_around(image, base, range_m)
        told = 2.0 * self.spread.sigma <= self.config.loss.accuracy
        if self.surrounding >= ENOUGH and not (told and self.leads(base)):
            self.surrounding, self.without_room, self.spread = 0, 0, Spread()
            self.support_elsewhere = 0.0
        if is_by_chance(best, 1) or best.support <= base.support + config.lead_of_rivals:
            return None
        elsewhere = self.elsewhere if self.is_within_reach(best, base) else from_other(best, base)
        self.begin(best, self.judged)
        self.elsewhere = elsewhere
        return best

    def best_around(self, image: Image, base: Fit, range_m: float) -> Fit:
        """The best of a fit and the other poses to which those around it and around the best one elsewhere lead.

        All of them are added to the spread.
        """
        best = base
        wide = isotropic_covariance(self.config.relocalization.found_sigma, range_m)
        if not self.spread.away:
            self.spread.add(base, base, range_m)
        while self.innocent.has_room_for(1) and not self.surrounded:
            self.surrounding, self.tried = self.surrounding + 1, self.tried + 1
            found = self.innocent.searched(image, self.next_pose(base), wide, StageClock(), self.searcher.half_px)
            if found.finite:
                self.spread.add(base, found, range_m)
                self.see_elsewhere(base, found)
                if self.is_other(base, found, range_m):
                    best = max(best, found, key=lambda each: each.support)
        return best

    def next_pose(self, base: Fit) -> Pose:
        """The next pose to fit: around a fit, or around the best other pose."""
        focus, at = base.focus, base.cam_from_world
        assert focus is not None
        if self.elsewhere is not None and self.surrounding % ELSEWHERE_EVERY == 0:
            at = at @ self.elsewhere
            focus = at.transform(base.cam_from_world.inverse().transform(focus[None]))[0]
        return Pose(*self.searcher.nearby(motion(at), focus, self.tried))

    def see_elsewhere(self, base: Fit, found: Fit) -> None:
        """Take a fit that ends elsewhere for the best other pose if it has more support than that had."""
        support = believed_support(found)
        if support > self.support_elsewhere and not self.is_within_reach(base, found):
            self.elsewhere, self.support_elsewhere = from_other(base, found), support

    def is_other(self, fit: Fit, found: Fit, range_m: float) -> bool:
        """Whether a fit ends farther from another one than an accepted pose may be off."""
        return float(np.linalg.norm(away(fit, found, range_m))) > self.config.loss.accuracy

    def leads(self, base: Fit) -> bool:
        """Whether a fit has clearly more support than the best one elsewhere."""
        return base.support > self.support_elsewhere + self.config.relocalization.lead

    def is_within_reach(self, fit: Fit, other: Fit) -> bool:
        """Whether a fit from where another one ends may reach a fit."""
        assert fit.searched is not None
        points = fit.searched.problem.points.points
        tried = TriedPoses(self.searcher, seen=points[:: max(1, len(points) // COMPARED)].copy())
        return bool(tried.within_reach(motion(fit.cam_from_world), NONE.added(motion(other.cam_from_world))).any())


def from_other(fit: Fit, other: Fit) -> Pose:
    """Where the pose of another fit is from one, as world_from_other: the same while the camera moves."""
    return fit.cam_from_world.inverse() @ other.cam_from_world


def is_by_chance(fit: Fit, frames: int) -> bool:
    """Whether chance may explain the best of as many frames, at one of the poses that a search looks at."""
    return fit.log10_false_alarms(frames * SEARCHED_POSES) >= SURE
