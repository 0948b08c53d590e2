"""Poses that agree with the edge pixels of an image: near guesses, far from them, and from all sides after a loss."""

from functools import reduce

import numpy as np

from uavbench.scenes.camera import Camera
from uavbench.tracker.geometry_kernels import RigidMotion
from uavbench.tracker.robust.fit.edge_fit import EdgeFitter
from uavbench.tracker.robust.fit.pose_fit import Fit
from uavbench.tracker.robust.relocalization.pose_arrays import NONE, PoseStack, distinct, motion, product_of
from uavbench.tracker.robust.relocalization.ranking import Ranking, Sought
from uavbench.tracker.robust.relocalization.scoring.overview import APART_PART, STEP_RAD, Overview
from uavbench.tracker.robust.relocalization.scoring.pose_search import (
    CANDIDATES,
    EDGE_POINTS,
    Candidate,
    PoseSearch,
)
from uavbench.tracker.robust.relocalization.scoring.pose_search_kernels import Target
from uavbench.tracker.robust.relocalization.scoring.rounds import Around, Rounds, best_first, taken
from uavbench.tracker.robust.relocalization.surfaces.aligner import REMEMBERED, Aligner
from uavbench.tracker.robust.relocalization.tried_poses import TriedPoses
from uavbench.tracker.robust.work import DISTANCES, LOOK
from uavbench.trajectories.pose import Pose

KEPT = 24
"""Poses of an overview that are kept until they are fitted: three slices' worth."""
ALIGNED = 8
"""Poses of a slice for whose alignments work is left."""
REMEMBERED_FITS = 2
"""Poses of a slice that are fitted for how the surface looks from there."""


class Candidates:
    """Candidates of a search, those of earlier slices among them.

    searches: how many were begun since a pose was accepted; all_round: whether the guesses may be so far off that
    poses from all sides of them are looked at; waiting: whether some of these are to be fitted; near_done: whether all
    likely poses were fitted since the search began; at: poses at which the image looks as remembered.
    """

    def __init__(self, fitter: EdgeFitter, camera: Camera, searcher: PoseSearch) -> None:
        self.fitter, self.searcher, self.config = fitter, searcher, fitter.config.relocalization
        self.rounds, self.overview = Rounds(searcher, self.config), Overview(fitter, camera, searcher)
        self.aligner, self.seen_from, self.searches = Aligner(fitter.edges, searcher), list[RigidMotion](), 0
        self.begin()

    def look(self, guesses: list[RigidMotion], sought: Sought) -> None:
        """Look at an image."""
        self.at = NONE
        self.aligner.look(sought.image, sought.surfaces, self.fitter.work)
        self.look_all_round(guesses, sought)

    def begin(self) -> None:
        """Begin a search; it goes on with what is left of an overview."""
        self.at, self.begun = NONE, False
        self.kept: list[Candidate] = []
        self.rounds.begin()
        if self.overview.is_complete(len(self.seen_from)):
            self.overview.begin()
        self.aligner.begin()
        self.all_round = self.waiting = self.near_done = False

    def begin_near(self) -> None:
        """Begin with the guesses, and with the views nearest to them."""
        self.searches = 0
        self.overview.begin()

    def look_all_round(self, guesses: list[RigidMotion], sought: Sought) -> None:
        """Look at poses from all sides if a guess may be off by a view, and one shows the whole structure.

        Or would show it from as far back as it may be off, in every other search, the first one among them. Not from
        where the mean velocity leads, the first guess, but only about where the run has been: far from there a box
        looks alike from its other side.
        """
        if not sought.lost:
            self.begin_near()
        self.searches, self.begun = self.searches + (not self.begun), True
        seen_from = (sought.carried and guesses[1:]) or guesses
        back_m = max(map(self.overview.back_m, seen_from))
        afar = self.searches % 2 == 1 and back_m <= sigma_m(sought)
        shown = any(self.overview.back_m(guess) == 0.0 for guess in guesses)
        self.all_round = may_be_off_by(STEP_RAD, sought) and (shown or afar)
        seen_from = list(map(self.overview.from_afar, seen_from)) if afar else seen_from
        self.seen_from = distinct(seen_from, sought.range_m, APART_PART)

    @property
    def looking(self) -> bool:
        """Whether poses from all sides are left to be scored."""
        return self.all_round and not self.overview.is_complete(len(self.seen_from))

    def is_complete(self, guesses: int) -> bool:
        """Whether all poses about so many guesses were scored."""
        return not self.looking if self.all_round else self.rounds.is_complete(guesses)

    def move(self, by: RigidMotion) -> None:
        """Multiply the poses of earlier slices by `by` from the left."""
        self.kept = [each._replace(pose=product_of(by, each.pose)) for each in self.kept]

    @property
    def most_again(self) -> int:
        """Most evaluations of scoring those of earlier slices in another image."""
        return len(self.kept) * self.searcher.most_again

    @property
    def spared(self) -> int:
        """Evaluations that are left for alignments, where there are surfaces to align to."""
        return ALIGNED * self.aligner.most if self.aligner.surfaces else 0

    def remembered(self, guesses: list[RigidMotion], ranking: Ranking, tried: TriedPoses) -> list[RigidMotion]:
        """Poses about a guess at which the image looks as remembered, the likeliest first, which were not fitted yet.

        Once about each guess; of a whole structure, whose other sides may come into view, again and again while as much
        work is left for other poses.
        """
        room = self.fitter.work.left - self.fitter.cost(2) - self.spared >= 2 * LOOK + DISTANCES
        again = self.all_round and room
        if not self.aligner.surfaces or (self.aligner.looked_about(guesses) and not again):
            return []

        def cost(pose: RigidMotion) -> float:
            return self.config.sigma_cost * ranking.chi2(pose) / self.config.lead

        found, part = self.aligner.found(guesses, cost, self.fitter.work), 0.5 * self.searcher.step_part
        self.at = reduce(PoseStack.added, found, self.at)
        apart = [each for each in found if tried.fitted.apart(each, ranking.range_m, part).all()]
        return distinct(apart, ranking.range_m, part)[:REMEMBERED_FITS]

    def remembered_near(self, fit: Fit, range_m: float) -> tuple[Pose, ...]:
        """Poses where a fit is from which the image looks as remembered."""
        near = ~self.at.apart(motion(fit.cam_from_world), range_m, self.searcher.step_part)
        return tuple(Pose(self.at.R[k], self.at.t[k]) for k in np.flatnonzero(near))

    def scored(self, around: Around, ranking: Ranking, sought: Sought, tried: TriedPoses) -> list[Candidate]:
        """Poses that agree best with the edge pixels, and look as remembered, best first."""
        return self.as_remembered(self.matched(around, ranking, sought, tried), ranking, tried)

    def as_remembered(self, candidates: list[Candidate], ranking: Ranking, tried: TriedPoses) -> list[Candidate]:
        """Candidates, best first, aligned to where they look most as remembered, which adds to their scores."""
        work, reserve, aligned = self.fitter.work, self.fitter.cost(2), list(candidates)
        for k, each in enumerate(candidates if self.aligner.surfaces else ()):
            if work.left - reserve < self.aligner.most:
                break
            found = None if tried.holds(each) else self.aligner.aligned(each.pose, work)
            if found is not None and found.rarity > 0.0:
                score = each.score + self.config.lead * found.rarity
                aligned[k] = ranking.weighed(each._replace(pose=found.pose, score=score))
                self.at = self.at.added(found.pose) if found.rarity > REMEMBERED else self.at
        return best_first(aligned)

    def matched(self, around: Around, ranking: Ranking, sought: Sought, tried: TriedPoses) -> list[Candidate]:
        """Poses that agree best with the edge pixels, best first; leaves half of the budget, and that of two fits.

        While poses from all sides are left to be scored, that of one fit. Of these only those are told about which no
        pose was fitted yet.
        """
        work, reserve = self.fitter.work, self.fitter.cost(2) + self.spared
        until = work.done + min(work.left // 2, work.left - reserve)
        kept = [found for each in self.kept for found in taken(self.searcher.again(around.target, each), work)]
        near = [ranking.weighed(each) for each in self.near(around, sought, until)]
        if self.all_round:
            sides = around._replace(guesses=self.seen_from)
            last = work.done + work.left - self.fitter.cost(1) - self.spared
            kept += self.overview.found(sought.image, sides, sought.range_m, work, last)
        else:
            kept += self.rounds.far(around, work, until)
        kept = best_first([ranking.weighed(each) for each in kept])
        if not self.all_round:
            self.kept, self.waiting = kept[:CANDIDATES], False
            return self.refined(best_first([*near, *self.kept]), CANDIDATES, around.target, ranking)
        near = self.refined(best_first(near)[:CANDIDATES], CANDIDATES // 2, around.target, ranking)
        kept = self.fresh(kept, tried, sought)[:KEPT]
        self.kept = self.refined(kept, CANDIDATES // 2, around.target, ranking)
        self.waiting = bool(kept)
        return best_first([*near, *self.fresh(self.kept, tried, sought)])

    def refined(self, best: list[Candidate], most: int, target: Target, ranking: Ranking) -> list[Candidate]:
        """Candidates, best first, of which the best ones are refined as far as the work allows."""
        work, reserve, best = self.fitter.work, self.fitter.cost(2) + self.spared, list(best)
        for k, each in enumerate(best[:most]):
            if work.left - reserve >= self.searcher.most_refining(len(each.seen.points)):
                best[k] = ranking.weighed(*taken(self.searcher.refined(target, each), work))
        return best_first(best)

    def near(self, around: Around, sought: Sought, until: int) -> list[Candidate]:
        """The best poses near the guesses: for half of the time once all of them were scored and the best fitted.

        Or once all were scored, where poses from all sides are left.
        """
        work, once = self.fitter.work, self.rounds.next_guess >= len(around.guesses)
        share = (until - work.done) // 2 if self.near_done or (once and self.looking) else 0
        near = self.rounds.near(around, work, until - share)
        if may_be_off_by(0.5 * self.config.search.view_step_rad, sought):
            near = self.rounds.beside(near, around.target, work, until - (share if self.looking else 0))
        return near

    def fresh(self, candidates: list[Candidate], tried: TriedPoses, sought: Sought) -> list[Candidate]:
        """Candidates about which no pose was fitted yet, within a step of viewing directions."""
        part = self.config.search.view_step_rad
        return [each for each in candidates if tried.fitted.apart(each.pose, sought.range_m, part).all()]

    def seen_from_there(self, candidate: Candidate, target: Target) -> Candidate:
        """A candidate of an overview refined by the edges that are visible where it is by now, others as they are."""
        work = self.fitter.work
        if not self.all_round or work.left < self.searcher.sampling + self.searcher.most_refining(2 * EDGE_POINTS):
            return candidate
        work.done += self.searcher.sampling
        there = candidate._replace(seen=self.searcher.seen(candidate.pose))
        return taken(self.searcher.refined(target, there), work)[0]


def may_be_off_by(part: float, sought: Sought) -> bool:
    """Whether the standard deviation of the most likely guess is larger than a part of the range."""
    return sigma_m(sought) > part * sought.range_m


def sigma_m(sought: Sought) -> float:
    """Standard deviation of the place of the most likely guess."""
    return float(np.sqrt(sought.covariance[:3, :3].trace() / 3))
