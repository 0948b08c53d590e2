"""Relocalization: pose search without a usable prediction, in slices over as many frames as it needs.

A slice scores poses near the guesses in its own image, continues far from them where the previous slice stopped, and
fits the best poses that were not fitted yet, until the frame's work budget is spent. Candidates of earlier slices are
moved with the prediction.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from uavbench.scenes.camera import Camera
from uavbench.tracker.geometry_kernels import RigidMotion
from uavbench.tracker.protocol import Image
from uavbench.tracker.robust.fit.edge_fit import EdgeFitter
from uavbench.tracker.robust.fit.pose_fit import Fit
from uavbench.tracker.robust.motion_model import isotropic_covariance
from uavbench.tracker.robust.preprocessing.small_images import grey, small_image
from uavbench.tracker.robust.relocalization.candidates import Candidates
from uavbench.tracker.robust.relocalization.pose_arrays import NONE, distinct, motion, product_of
from uavbench.tracker.robust.relocalization.ranking import (
    Contender,
    Ranking,
    Sought,
    belief,
    believed_support,
    ends_at,
    is_suspect,
)
from uavbench.tracker.robust.relocalization.rivals import Rivals
from uavbench.tracker.robust.relocalization.scoring.pose_search import CANDIDATES, Candidate, PoseSearch
from uavbench.tracker.robust.relocalization.scoring.pose_search_kernels import Target
from uavbench.tracker.robust.relocalization.scoring.rounds import Around
from uavbench.tracker.robust.relocalization.surfaces.surface import SurfaceReader
from uavbench.tracker.robust.relocalization.tried_poses import TriedPoses
from uavbench.tracker.robust.relocalization.turned_poses import TurnedPoses
from uavbench.tracker.robust.work import DISTANCES
from uavbench.tracker.stage_clock import StageClock
from uavbench.trajectories.pose import Array, Pose

MOST_FITS = 64
"""Number of fits after which a complete search ends."""
LEAST_ALIKE = 0.5
"""Correlation of small images of successive frames below which they show other things: of 20 flights at 5 Hz it is at
least 0.83, and about 0 between a scene and noise or darkness, but 0.39 in one case."""
CLEARLY_RARER = 1.0
"""Powers of ten by which chance explains one of two windows less, so that it is kept beside one of more support after a
loss. Chosen on seed 1027, where the true one had 1 to 7."""
PLACES_FIRST = 6
"""Slices in which places are recalled although poses from all sides wait: each of three then had its turn."""
PERTURBATIONS = 24
"""Number of poses sampled around the best fits of a search."""


class Relocalized(NamedTuple):
    """The best supported fit of a slice, and the progress of the search.

    advantage: over the given fit, inf without one. near_done: all likely poses were fitted since the search began;
    all_done: all poses were. leads: it has clearly more support than the fits that converged to other poses, near ones
    among them. rivalled: it has rivals that it does not lead. expected: it is near the prediction. remembered: poses
    there from which the image looks as the run saw the surface. contenders: the fits that may be right.
    """

    fit: Fit
    advantage: float
    near_done: bool
    all_done: bool
    leads: bool
    rivalled: bool
    expected: bool
    remembered: tuple[Pose, ...]
    contenders: tuple[Contender, ...]

    def outdoes(self, fit: Fit, lead: float) -> bool:
        """Whether the best fit leads the given one, which chance explains, and is not explained by it itself."""
        return self.leads and self.advantage > lead and is_suspect(fit) and not is_suspect(self.fit)


class Done(NamedTuple):
    """Progress of a search: whether all likely poses were fitted since it began, and whether all poses were."""

    near: bool
    all: bool


class Attempt(NamedTuple):
    """A pose to be fitted.

    sigma: its standard deviation, as a fraction of the range and in rad; half_px: half length of the search lines;
    score: its agreement with the edge pixels, 0 if it is not from the pose search.
    """

    pose: RigidMotion
    sigma: float
    half_px: float
    score: float = 0.0


class Relocator:
    """Pose search of an image; keeps the state of the search between frames."""

    def __init__(self, fitter: EdgeFitter, camera: Camera) -> None:
        self.fitter, self.config = fitter, fitter.config.relocalization
        config = self.config
        self.searcher = PoseSearch(fitter.edges, camera, fitter.view.near, fitter.config)
        self.rivals = Rivals(fitter, self.searcher, config)
        self.turned = TurnedPoses(fitter, self.searcher, config)
        self.candidates = Candidates(fitter, camera, self.searcher)
        self.known_sigma = fitter.config.initialization.sigma
        self.elsewhere: Pose | None = None
        self.shown: Array | None = None
        self.forget()

    def forget(self) -> None:
        """Restart the search."""
        self.reference: RigidMotion | None = None
        self.best_before: RigidMotion | None = None
        self.tried = TriedPoses(self.searcher)
        self.slices = self.perturbations = 0
        self.candidates.begin()
        self.found_before = False

    @property
    def reader(self) -> SurfaceReader:
        """Reads the surfaces that a search takes."""
        return self.candidates.aligner.reader

    @property
    def needs_budget(self) -> bool:
        """Whether a pose that chance does not explain is to be fitted again, or poses from all sides wait to be."""
        return self.found_before or (self.candidates.waiting and self.slices >= PLACES_FIRST)

    @property
    def under_way(self) -> bool:
        """Whether a search is in progress."""
        return self.reference is not None

    def search(self, sought: Sought) -> Relocalized:
        """One slice of the search."""
        work, config = self.fitter.work, self.config
        self.begin_where_cut(sought.image)
        guesses = distinct([motion(guess) for guess in sought.guesses], sought.range_m, config.search.view_step_rad)
        self.candidates.look(guesses, sought)
        self.move_along(guesses[0] if sought.carried is None else motion(sought.carried))
        recalled = [motion(pose) for pose in sought.recalled]
        ranking, exhausted = Ranking(sought, config), False
        left = self.fit_in_turn(self.likely(guesses, recalled, ranking), sought, ranking)
        if not left and work.left >= DISTANCES + self.candidates.most_again + self.fitter.cost(0):
            target = self.searcher.target(sought.image, self.shift_sigma_px(sought))
            work.done += DISTANCES
            candidates = self.candidates.scored(Around(target, guesses), ranking, sought, self.tried)
            exhausted = not self.fit_in_turn(self.attempts(candidates, ranking, target), sought, ranking)
        compared = self.rivals.fit(sought, ranking, self.tried)
        usual = ranking.top.support >= sought.sure or (sought.thorough and ranking.is_expected)
        least = config.lead * belief(ranking.top)
        leads = self.rivals.trail(ranking, self.tried) if compared.any and usual else self.lead(ranking.top) >= least
        leads = leads and self.rivals.trail_left(ranking, compared)
        if ranking.top is not sought.first:  # compared before the fits beside it, so that each place counts once
            leads = self.turned.agree(sought, ranking, self.tried) and leads
        leads = not self.outdone_by_rarer(ranking) and leads
        if ranking.top is not sought.first and ranking.top.finite:
            self.best_before = motion(ranking.top.cam_from_world)
        self.found_before = ranking.is_found
        self.elsewhere = self.beyond(ranking.top)
        exhausted = exhausted or len(self.tried) >= MOST_FITS
        done = Done(self.candidates.near_done, exhausted and self.candidates.is_complete(len(guesses)))
        return self.relocalized(ranking, sought, done, leads, rivalled=compared.any and not leads)

    def beyond(self, fit: Fit) -> Pose | None:
        """Where the best other pose of this search is from a fit, as world_from_other; None without any."""
        other = self.tried.best_elsewhere(motion(fit.cam_from_world))
        return None if other is None else fit.cam_from_world.inverse() @ Pose(*other)

    def begin_where_cut(self, image: Image) -> None:
        """Restart where the image shows something else than the one before, in which nothing was to be found."""
        before, self.shown = self.shown, small_image(grey(image))
        if before is not None and before @ self.shown < LEAST_ALIKE:
            self.forget()
            self.candidates.begin_near()

    def relocalized(self, ranking: Ranking, sought: Sought, done: Done, leads: bool, *, rivalled: bool) -> Relocalized:
        """The outcome of a slice."""
        fit, contenders = self.located(ranking.top, sought), () if leads else ranking.contenders()
        remembered = self.candidates.remembered_near(fit, ranking.range_m)
        return Relocalized(fit, ranking.advantage, *done, leads, rivalled, ranking.is_expected, remembered, contenders)

    def located(self, fit: Fit, sought: Sought) -> Fit:
        """The fit, with its edges located between the pixels if it is one of the search."""
        return fit if fit is sought.first else self.fitter.located(fit, StageClock())

    def confirm(self, sought: Sought) -> Relocalized:
        """Compare the given fit with its rivals, the poses at which the structure looks alike."""
        self.forget()
        ranking = Ranking(sought, self.config)
        compared = self.rivals.fit(sought, ranking, self.tried)
        leads = self.rivals.trail_left(ranking, compared) and self.rivals.trail(ranking, self.tried)
        leads = leads and self.turned.agree(sought, ranking, self.tried)
        if ranking.lost:  # a track that goes on is where it was
            leads = not self.outdone_by_rarer(ranking) and leads
        self.forget()
        return self.relocalized(ranking, sought, Done(True, True), leads, rivalled=not leads)

    def fit_in_turn(self, attempts: "Iterator[Attempt]", sought: Sought, ranking: Ranking) -> bool:
        """Fit poses until one has enough support or the budget is spent; returns whether poses are left.

        Room is left for the rivals of the best fit.
        """
        clock = StageClock()
        for attempt in attempts:
            fits = 1 + self.rivals.awaited(sought, ranking, self.tried)
            if not self.fitter.has_room_for(fits):
                return True
            covariance = isotropic_covariance(attempt.sigma, sought.range_m)
            fit = self.fitter.searched(sought.image, Pose(*attempt.pose), covariance, clock, attempt.half_px)
            ranking.add(fit)
            self.tried.add(attempt.pose, attempt.score, motion(fit.cam_from_world), believed_support(fit))
            if believed_support(ranking.top) >= sought.sure and not sought.thorough:
                return True
        return False

    def lead(self, fit: Fit) -> float:
        """Lead in support of a fit over those that converged to other poses since the search began."""
        same = self.tried.within_reach(motion(fit.cam_from_world), self.tried.reached)
        return believed_support(fit) - float(self.tried.supports[~same].max(initial=0.0))

    def outdone_by_rarer(self, ranking: Ranking) -> bool:
        """Whether fits elsewhere are rarer than the best one, which are then compared as if of its support."""
        rarer = self.rarer(ranking)
        ranking.believe_as_the_best(rarer)
        return bool(rarer)

    def rarer(self, ranking: Ranking) -> list[Fit]:
        """Fits that end elsewhere than the best one, and find what chance explains less than what the best one finds.

        Behind people the true pose may have less support than a pose at a box of theirs that has fewer edges to show.
        Poses at which the structure looks alike are among them only where no pose of the last frame was accepted, and
        by a power of ten: both find edges of it, but behind a tree fewer of the true one's, by their share.
        """
        top, least = ranking.top, self.fitter.config.initialization.min_support
        return [
            fit
            for fit in ranking.fits
            if fit.support >= least
            and fit.chance.whole < top.chance.whole
            and not ends_at(fit, top, self.config.found_sigma, ranking.range_m)
            and (self.is_clearly_rarer(fit, ranking) or not self.rivals.look_alike(top, fit, ranking.range_m))
        ]

    def is_clearly_rarer(self, fit: Fit, ranking: Ranking) -> bool:
        """Whether a fit outdoes a best one that is to be found again in what chance explains."""
        apart = ranking.top.chance.whole - fit.chance.whole
        return ranking.lost and fit.searched is not None and apart > CLEARLY_RARER

    def shift_sigma_px(self, sought: Sought) -> float:
        """Standard deviation of the image shift at the most likely guess, px of the small image."""
        moved, turned = sought.covariance[:3, :3].trace() / 3, sought.covariance[3:, 3:].trace() / 3
        return float(np.sqrt(moved / sought.range_m**2 + turned) * self.searcher.f[0])

    def move_along(self, reference: RigidMotion) -> None:
        """Move what earlier slices found by the motion of a reference since then."""
        before, self.reference = self.reference, reference
        if before is None:
            return
        if self.best_before is not None:
            self.tried.give_up(self.best_before)
        R = reference.R @ before.R.T
        by = RigidMotion(R, reference.t - R @ before.t)
        self.candidates.move(by)
        self.tried.move(by)
        self.best_before = self.best_before and product_of(by, self.best_before)

    def likely(self, guesses: list[RigidMotion], recalled: list[RigidMotion], ranking: Ranking) -> Iterator[Attempt]:
        """Poses to fit first: what the last slice found, if chance does not explain it; unless it is found again also
        where the image looks as remembered, what is recalled, and the guesses, since a prediction is usually better
        than its covariance.

        Each slice has one guess, but the first one all of them where nothing is remembered: where a fit fails, it
        mostly fails in the next image.
        While poses from all sides are left to be scored, each has had its turn.
        """
        if self.found_before and self.best_before is not None:
            yield from self.found(self.best_before, 0.0, ranking)
            if ranking.is_found:
                return
        for pose in self.candidates.remembered(guesses, ranking, self.tried):
            yield Attempt(pose, self.config.found_sigma, self.searcher.half_px)
            if ranking.is_found:
                yield Attempt(motion(ranking.top.cam_from_world), self.known_sigma, self.searcher.half_px)
                return
        for pose in recalled:
            yield from self.found(pose, 0.0, ranking)
        turn = self.slices % len(guesses)
        turns = guesses[turn : turn + 1] if self.slices or self.candidates.aligner.surfaces else guesses
        turns = [] if self.candidates.looking and self.slices >= len(guesses) else turns
        self.slices += 1  # not where the work was spent before
        for guess in turns:
            yield from self.found(guess, 0.0, ranking)

    def found(self, pose: RigidMotion, score: float, ranking: Ranking) -> Iterator[Attempt]:
        """A pose to fit, and that fit's pose to be fitted again if it is the best so far, or finds more than the best.

        The points of a fit are those that are visible where it begins: elsewhere fewer of them are to be found. From
        all sides, one that would do as a first pose is fitted again, too: what leads may be something else.
        """
        best = ranking.top
        yield Attempt(pose, self.config.found_sigma, self.searcher.half_px, score)
        last = ranking.fits[-1] if ranking.fits else best
        enough = self.candidates.all_round and last.support >= self.fitter.config.initialization.min_support
        if last is not best and (last is ranking.top or last.found > best.found or enough):
            yield Attempt(motion(last.cam_from_world), self.known_sigma, self.searcher.half_px)

    def attempts(self, candidates: list[Candidate], ranking: Ranking, target: Target) -> Iterator[Attempt]:
        """Poses to fit in order: the moved best pose of earlier frames; untried poses that match the image about as
        well as the best; perturbations of the best fit, and all others.
        """
        config = self.config
        self.tried.seen = candidates[0].seen.points if candidates else self.tried.seen
        if self.best_before is not None and not self.found_before:
            again = [
                each.pose
                for each in candidates
                if self.tried.within_reach(each.pose, NONE.added(self.best_before)).any()
            ]
            yield Attempt((again or [self.best_before])[0], config.found_sigma, self.searcher.half_px)
        for hopeless in (False, True):
            for candidate in candidates:
                worse = candidate.score < candidates[0].score - config.lead and not self.candidates.all_round
                if worse != hopeless or self.tried.holds(candidate):
                    continue
                fresh = self.candidates.seen_from_there(candidate, target)
                yield from self.found(fresh.pose, candidate.score, ranking)
                self.candidates.near_done |= int(np.count_nonzero(self.tried.scores)) >= CANDIDATES
            self.candidates.near_done = True
            while not hopeless and self.perturbations < PERTURBATIONS:
                yield from self.perturbed(ranking.top)

    def perturbed(self, fit: Fit) -> Iterator[Attempt]:
        """The next perturbation of the best fit's pose, or of the best one elsewhere (evolution strategy: Rechenberg
        1973), in turn: of two poses that look right the fits of this search may not have reached one.
        """
        self.perturbations += 1
        pose, focus = motion(fit.cam_from_world), fit.focus
        if focus is None:
            return
        other = self.tried.best_elsewhere(pose) if self.perturbations % 2 else None
        if other is not None:
            focus = other.R @ (pose.R.T @ (focus - pose.t)) + other.t
        near = self.searcher.nearby(other or pose, focus, self.perturbations)
        yield Attempt(near, self.config.found_sigma, self.searcher.half_px)
