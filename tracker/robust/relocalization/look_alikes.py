"""Poses at which a structure looks alike, after a loss: told apart by its surface between the edges.

Where windows or panels repeat, edges say that one of them is seen, and not which. Those that were seen before have more
support, since what they look like is known, whether they are seen or others like them. So poses are compared by what
the run saw of the surface, and by their edges as if nothing had been learned.
"""

from collections.abc import Sequence
from math import log10
from typing import NamedTuple

import numpy as np

from uavbench.tracker.geometry_kernels import RigidMotion
from uavbench.tracker.protocol import Image
from uavbench.tracker.robust.fit.pose_fit import Fit
from uavbench.tracker.robust.motion_model import Motion, isotropic_covariance
from uavbench.tracker.robust.relocalization.doubts import Doubts
from uavbench.tracker.robust.relocalization.pose_arrays import distinct, motion
from uavbench.tracker.robust.relocalization.ranking import SURE, Contender, Likely
from uavbench.tracker.robust.relocalization.rivals import RIVAL_CHI2
from uavbench.tracker.robust.relocalization.surfaces.alignment_kernels import Surface
from uavbench.tracker.robust.relocalization.surfaces.known_surfaces import UNSEEN, KnownSurfaces
from uavbench.tracker.robust.work import SHOWN
from uavbench.tracker.stage_clock import StageClock
from uavbench.trajectories.pose import Array, Pose

EXPLAINED = 0.8
"""Least part of what was found at a pose that another one explains, too, if the structure looks alike there: at a wrong
pose all but what was found by chance. Measured on walls: 0.9 to 1; on bridges, from one girder or panel to another, 0.6
to 0.85.
"""
MOST_COMPARED = 16
"""Poses that are compared, the likeliest first: limits the time before a facade of many windows. Others count as not
seen."""
CLEARLY = 1.0
"""Powers of ten by which a pose has to be likelier than others at which the structure looks alike, by its surface."""
BY_EDGES = 2.0
"""The same where edges tell it: more than what is missing tells alone. Measured on walls after losses of 5 and 9 s, in
338 comparisons of the true place with another one: that one leads in 28 of them, in one by 2.4, in the others by less.
"""


class Lost(NamedTuple):
    """An image after a loss, and what is known beforehand.

    reach: where the camera may be since its last pose, range_m: from the structure; likely: where hypotheses lead;
    seen: what the run saw of the surface between the edges.
    """

    image: Image
    reach: Sequence[Motion]
    range_m: float
    likely: Sequence[Likely]
    seen: Sequence[Surface]


class Verdict(NamedTuple):
    """The likeliest of poses at which a structure looks alike.

    leads: whether it is clearly likelier than the others; contenders: where it is not, it and others as likely;
    is_seen: whether it leads, and the surface looks there as the run saw it, at the given fit clearly less so.
    """

    fit: Fit
    leads: bool
    contenders: tuple[Contender, ...] = ()
    is_seen: bool = False


class Placed(NamedTuple):
    """A pose at which a structure looks alike, and a fit there without memory."""

    pose: RigidMotion
    fit: Fit


class LookAlikes:
    """Compares a fit with others at poses at which the structure looks alike."""

    def __init__(self, doubts: Doubts) -> None:
        self.doubts, self.relocator, self.fitter = doubts, doubts.relocator, doubts.fitter
        self.config, self.awaited, self.looks = self.fitter.config, 0, 0

    def taken(self) -> int:
        """Evaluations to be left for a comparison that the last frame had no room for, but those of two fits; once."""
        awaited, self.awaited = self.awaited, 0
        return max(0, min(awaited, self.fitter.work.left - self.fitter.cost(2)))

    def compared(self, lost: Lost, fit: Fit) -> Verdict | None:
        """The likeliest of a fit and those at poses where the structure looks as there; None if there are none.

        Where the frame's budget is not enough the fit does not lead. Edges are compared where surfaces do not decide: a
        lead by chance is a hundred times as likely by the hundredth frame in a row that they leave undecided.
        """
        poses = self.poses(lost, fit)
        if len(poses) == 1:
            self.looks = 0
            return None
        poses, others = poses[:MOST_COMPARED], poses[MOST_COMPARED:]
        looks = SHOWN + KnownSurfaces.cost(len(poses))
        moves = self.relocator.rivals.cost_of_moves  # which was spent already
        if self.fitter.work.left < looks:
            self.awaited = moves + looks
            return self.undecided(lost, fit)
        rarity, anew, outdone = self.by_surface(lost, poses), dict[int, Fit](), set[int]()
        likely = rarity + by_motion(lost, poses)
        best = 0 if likely[0] > likely.max() - CLEARLY else int(np.argmax(likely))
        while left := as_likely(likely, rarity, best, outdone):
            k = left[0]
            for each in (best, k):
                if each not in anew and not self.doubts.without_memory().has_room_for(1):
                    self.awaited = moves + looks + self.fitter.cost(len(anew) + 2)  # one tells more than this frame did
                    return self.undecided(lost, fit)
                anew[each] = anew.get(each) or self.anew(lost, poses[each])
            lead = likely[best] - likely[k] + self.lead(Placed(poses[best], anew[best]), Placed(poses[k], anew[k]))
            if abs(lead) < BY_EDGES + log10(1 + self.looks):
                self.looks += 1
                return self.undecided(lost, anew[best] if best else fit, anew[k])
            outdone.add(k if lead > 0.0 else best)
            best = best if lead > 0.0 else k
        if others and rarity[best] < UNSEEN + CLEARLY:
            return self.undecided(lost, fit)
        if best and not self.fitter.has_room_for(1 if best in anew else 2):
            self.awaited = moves + looks + self.fitter.cost(2)
            return self.undecided(lost, anew.get(best, fit), fit)
        self.looks = 0
        is_seen = bool(rarity[best] >= rarity[0] + CLEARLY)
        found = self.at(lost, anew.get(best) or self.anew(lost, poses[best])) if best else fit
        return Verdict(found, leads=True, is_seen=is_seen)

    def poses(self, lost: Lost, fit: Fit) -> list[RigidMotion]:
        """The pose of a fit, and those within reach at which the structure looks as there, the likeliest first.

        Of those at about the same place it is the one to which most length of edges is moved: what both show is told
        by the move from one to the other, which the others are aside of.
        """
        pose, rivals = motion(fit.cam_from_world), self.relocator.rivals
        places = [after(move, pose) for move in rivals.moves(fit, EXPLAINED)]
        within = [places[k] for k in np.flatnonzero(squared_distances(lost, places) <= RIVAL_CHI2)]
        pose, *apart = distinct([pose, *within], lost.range_m, rivals.config.found_sigma)
        return [pose, *(apart[k] for k in np.argsort(squared_distances(lost, apart), kind="stable"))]

    def lead(self, one: Placed, other: Placed) -> float:
        """Powers of ten by which what one pose shows beside another one is likelier than what that shows beside it.

        What both show is not compared: it may be hidden or lit otherwise where its points are taken, and tells nothing.
        """
        rivals, both = self.relocator.rivals, ((one, other), (other, one))
        beside = [rivals.evidence_beside(moved(there.pose, here.pose), here.fit) for here, there in both]
        return beside[0] - beside[1]

    def by_surface(self, lost: Lost, poses: list[RigidMotion]) -> Array:
        """Powers of ten (k,) by which chance does not explain what the surface looks like from poses."""
        reader, work = self.relocator.reader, self.fitter.work
        work.done += SHOWN
        known = KnownSurfaces(reader, lost.seen, reader.shown(lost.image), work)
        return np.array([known.rarity(pose) for pose in poses])

    def anew(self, lost: Lost, pose: RigidMotion) -> Fit:
        """A fit at a pose without memory."""
        return self.doubts.without_memory().searched(lost.image, Pose(*pose), self.near(lost), StageClock())

    def at(self, lost: Lost, fit: Fit) -> Fit:
        """A fit with memory at the pose of one without it."""
        found = self.fitter.searched(lost.image, fit.cam_from_world, self.near(lost), StageClock())
        return self.fitter.located(found, StageClock())

    def near(self, lost: Lost) -> Array:
        """Covariance (6, 6) of a pose at which a structure looks as at a fit."""
        return isotropic_covariance(self.config.initialization.sigma, lost.range_m)

    def undecided(self, lost: Lost, fit: Fit, *others: Fit) -> Verdict:
        """A fit that does not lead, and others that are as likely, each the continuation of the nearest hypothesis."""
        contenders = []
        for each in (fit, *others):
            prior = [likely.prior(each.cam_from_world, self.config.relocalization.lead) for likely in lost.likely]
            contenders.append(Contender(each, 0.0, int(np.argmax(prior))))
        return Verdict(fit, leads=False, contenders=tuple(each for each in contenders if each.fit.finite))


def squared_distances(lost: Lost, poses: Sequence[RigidMotion]) -> Array:
    """Squared Mahalanobis distances (k,) of poses from the nearest place where the camera may be."""
    return np.array([min(each.squared_mahalanobis(Pose(*pose)) for each in lost.reach) for pose in poses])


def by_motion(lost: Lost, poses: Sequence[RigidMotion]) -> Array:
    """Powers of ten (k,) by which poses are likely before the image: those of a normal density, but a constant."""
    return np.asarray(-0.5 * squared_distances(lost, poses) / np.log(10.0))


def after(move: RigidMotion, pose: RigidMotion) -> RigidMotion:
    """The pose at which a structure looks, moved so, as it looks at a pose."""
    R = pose.R @ move.R.T
    return RigidMotion(R, pose.t - R @ move.t)


def moved(there: RigidMotion, here: RigidMotion) -> RigidMotion:
    """How a structure is moved that looks from there as it looks from here."""
    return RigidMotion(there.R.T @ here.R, there.R.T @ (here.t - there.t))


def lead_by(rarity: float, other: float) -> float:
    """Powers of ten by which one of two poses of these rarities has to be likelier: more where motion decides alone."""
    return CLEARLY if abs(rarity - other) >= CLEARLY else -SURE


def as_likely(likely: Array, rarity: Array, best: int, outdone: set[int]) -> list[int]:
    """Those of poses so likely (k,) that the best one does not clearly lead, but not those that it outdid."""
    others = (k for k in range(len(likely)) if k != best and k not in outdone)
    return [k for k in others if likely[k] > likely[best] - lead_by(rarity[best], rarity[k])]
