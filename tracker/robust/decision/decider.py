"""Decision on the status of a frame: the fit is accepted (ok), rivals fit as well (ambiguous), or neither (lost)."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from uavbench.scenes.camera import Camera
from uavbench.tracker.robust.config import RobustConfig
from uavbench.tracker.robust.decision.beginnings import Beginnings
from uavbench.tracker.robust.decision.found_edges import FoundEdges
from uavbench.tracker.robust.fit.edge_fit import EdgeFitter
from uavbench.tracker.robust.fit.pose_fit import MIN_POINTS, Fit
from uavbench.tracker.robust.frames import Frame
from uavbench.tracker.robust.motion_model import isotropic_covariance
from uavbench.tracker.robust.places.places import Places, Recalled
from uavbench.tracker.robust.relocalization.doubts import Doubts, is_by_chance
from uavbench.tracker.robust.relocalization.look_alikes import LookAlikes, Lost, Verdict
from uavbench.tracker.robust.relocalization.ranking import SEARCHED_POSES, Contender, Likely, Sought, is_suspect
from uavbench.tracker.robust.relocalization.relocate import Relocator
from uavbench.tracker.robust.track_state import TrackState, Within
from uavbench.tracker.stage_clock import StageClock

SEARCH_EVERY = 8
"""Frames between searches that find nothing better, while support is sufficient: limits their time, where frames are so
close together that their budget is the least one."""
GAP_MEMORIES = 2.0
"""Time between frames, in time constants of the velocity, after which a structure may be seen from another side: what a
forgotten velocity leaves unknown is then more than what the last one tells."""
MOST_GUESSES = 3
"""Hypotheses around whose predictions a pose is searched: limits the time that each of them takes."""


class Decision(NamedTuple):
    """A fit, and whether it is accepted.

    settled: all poses that had to be tried were. rivalled: they were, and another pose explains the frame about as
    well. searched: the fit is that of a pose search. holds: chance would not find as much as was found at a look-alike,
    from which the surface tells it, or doubts ask that later. is_open: a settled pose that is not told apart (yet) from
    those around it: it is doubted, or not known well enough. leads: in this frame and the last one that was searched,
    an unsettled fit leads those at likely poses. contenders: the fits that may be right, where it is not settled.
    """

    fit: Fit
    settled: bool
    rivalled: bool = False
    searched: bool = False
    holds: bool = False
    is_open: bool = False
    leads: bool = False
    contenders: tuple[Contender, ...] = ()


class Decider:
    """Decides on the fit of each frame; searches for another pose where it has little support."""

    def __init__(self, fitter: EdgeFitter, camera: Camera, state: TrackState, config: RobustConfig) -> None:
        self.fitter, self.state, self.config = fitter, state, config
        self.relocator = Relocator(fitter, camera)
        self.doubts = Doubts(self.relocator)
        self.look_alikes = LookAlikes(self.doubts)
        self.places = Places(fitter.edges, camera, config.relocalization.search.view_step_rad, fitter.rng)
        self.kept_initial = self.led = False
        self.found_edges = FoundEdges(len(fitter.edges.ends), config.edges.appearance.learning_rate)
        self.until_search, self.searched_suspect, self.recalled = 0, False, Recalled()
        self.beginnings = Beginnings(self.doubts, self.found_edges, state, self.places.empty())

    def decide(self, frame: Frame, tracked: Fit, clock: StageClock) -> Decision:
        """The best fit of a frame; settled if it also has the required support."""
        first, was_lost = self.state.is_first, self.state.is_lost
        self.beginnings.note_begin()
        found = self.told_apart(frame, self.initialized_or_recovered(frame, tracked, clock), clock)
        patches = self.fitter.texture
        best = self.without_patches(frame, found.fit, clock)
        given = best is tracked or (first and self.kept_initial)
        fit = best if given else self.beginnings.freed(best)
        recent = not self.is_slow(frame)
        held = found.holds or self.holds(frame, fit, searched=found.searched)
        slid = found.settled and held and self.found_edges.has_slid(fit, again=recent and not first)
        settled = found.settled and held and not slid
        self.state.is_lost = not settled
        self.fitter.texture = self.fitter.texture if settled else patches
        self.led &= not settled
        if settled and first and not self.kept_initial:
            self.beginnings.doubt_first(fit)
        found_again = settled and not first and (was_lost or (found.searched and recent))
        if found_again and self.is_doubtful(frame, fit, told=was_lost):
            self.beginnings.doubt_again(frame, fit, told=was_lost)
        anew = self.beginnings.begun_again(frame, fit, clock) if found.leads and not settled else None
        if anew is not None:
            fit, settled, self.led = anew, True, False
        if not settled or not self.beginnings.in_doubt:
            others = found.contenders if best is found.fit else ()
            is_open, contenders = settled and self.is_open(fit), () if slid else others or (Contender(fit),)
            return Decision(fit, settled, found.rivalled, is_open=is_open, contenders=contenders)
        fit = self.beginnings.doubted(frame, fit, clock)
        if self.doubts.settled:
            untold = self.beginnings.untold
            told = None if untold is None else self.told(frame, fit, untold.within, clock)
            fit = self.beginnings.placed(fit, told, clock)
        return Decision(fit, True, is_open=self.is_open(fit))

    def is_doubtful(self, frame: Frame, fit: Fit, told: bool) -> bool:
        """Whether a fit after a loss, or one that a search found, may be another pose near the right one.

        told: it was told from those at which the structure looks alike. Then it is not if the last pose is recent, or
        if its edges and patches leave no doubt; nor where the vehicle said, or where the run was going.
        """
        now_s = self.fitter.now_s
        recent = self.state.told_before_s(now_s) < self.config.slow_s
        if self.beginnings.in_doubt or (told and (recent or self.state.is_recognized(fit))):
            return False
        if frame.extrapolated_s == 0.0:
            return not self.state.is_expected(fit, frame.predicted)
        return not (recent and self.state.is_expected(fit, self.state.carried_on(now_s)))

    def told_apart(self, frame: Frame, found: Decision, clock: StageClock) -> Decision:
        """After a loss or a long gap, the likeliest pose of those at which the structure looks as at the one found."""
        state, fit = self.state, found.fit
        known = fit.finite and not self.beginnings.in_doubt and (found.settled or found.rivalled)
        anywhere = state.is_lost or frame.dt_s > GAP_MEMORIES * self.config.motion.memory_s
        if state.is_first or not (anywhere and known):
            return found
        told = self.told(frame, fit, state.within(self.fitter.now_s), clock)
        if told is None:
            return found
        holds = told.is_seen and told.fit.finite and self.holds(frame, fit, searched=found.searched)
        searched = found.searched or told.fit is not fit
        return Decision(told.fit, told.leads, not told.leads, searched, holds, contenders=told.contenders)

    def holds(self, frame: Frame, fit: Fit, searched: bool) -> bool:
        """Whether chance would not find as much as a fit does."""
        recent, landmarks = not self.is_slow(frame), self.recalled.landmarks
        return self.state.holds(fit, frame.predicted, searched, recent, landmarks)

    def told(self, frame: Frame, fit: Fit, within: Within, clock: StageClock) -> Verdict | None:
        """The likeliest pose of those at which the structure looks as at a fit, and where the camera may be."""
        with clock.stage("relocalize"):
            seen = self.places.between_edges(self.relocator.reader, self.fitter.work)
            return self.look_alikes.compared(Lost(frame.image, *within, frame.likely, seen), fit)

    def is_open(self, fit: Fit) -> bool:
        """Whether a pose is doubted, or two standard deviations of it are more than the error that it may have."""
        return self.beginnings.in_doubt or 2.0 * fit.sigma > self.config.loss.accuracy

    def initialized_or_recovered(self, frame: Frame, fit: Fit, clock: StageClock) -> Decision:
        """The given fit; on the first frame a prior-constrained fit, with low support the best fit of a pose search."""
        self.until_search, self.recalled = self.until_search - 1, Recalled()
        first = self.state.is_first
        given = first and not self.beginnings.gave_up and not self.relocator.under_way
        kept = self.prior_constrained(frame, fit, clock) if given else None
        if kept is not None:
            self.kept_initial = True
            return Decision(kept, True)
        if not (first or self.search_is_due(frame, fit) or not fit.finite):
            if self.relocator.under_way:
                self.relocator.forget()
            return self.confirmed(frame, fit, clock)
        with clock.stage("relocalize"):
            found = self.recover(frame, fit)
        if found.settled and not self.relocator.under_way:
            spared = found.fit is fit and self.config.budget.is_least(frame.step_s)
            self.until_search = SEARCH_EVERY if spared else 0
            self.searched_suspect = is_suspect(fit)
        return found

    def without_patches(self, frame: Frame, fit: Fit, clock: StageClock) -> Fit:
        """The fit, or one of the edges alone if they contradict the patches and have clearly more support."""
        loss, lead = self.config.loss, self.config.relocalization.lead
        contradict = fit.edge_support < min(loss.min_support, fit.support) and fit.control_points >= MIN_POINTS
        if not (contradict and self.fitter.has_room_for(1)):
            return fit
        with clock.stage("relocalize"):
            kept = self.fitter.texture
            self.fitter.forget_patches()
            narrow = isotropic_covariance(self.config.initialization.sigma, self.state.range_m)
            alone = self.fitter.fit(frame.image, fit.cam_from_world, narrow, clock)
            if alone.finite and alone.support >= max(loss.min_support, fit.edge_support + lead):
                return alone
            self.fitter.texture = kept
            return fit

    def prior_constrained(self, frame: Frame, fit: Fit, clock: StageClock) -> Fit | None:
        """A fit constrained to the initial pose; None if chance explains it or another has clearly more support."""
        narrow = isotropic_covariance(self.config.initialization.kept_sigma, self.state.range_m)
        kept = self.fitter.fit(frame.image, self.state.motion.cam_from_world, narrow, clock)
        led = kept.support < fit.support - self.config.relocalization.lead
        if led or not self.state.may_stay_at(kept, frame.predicted):
            return None
        sure = max(self.config.good_support, kept.edge_support)  # patches are created there immediately
        return replace(kept, edge_support=sure)

    def confirmed(self, frame: Frame, fit: Fit, clock: StageClock) -> Decision:
        """The fit; where the motion is hardly known it is compared with fits at similar-looking poses.

        That is after a long extrapolation, and before a velocity is known, unless so short a time after the first pose
        that the frame has the least budget; doubts of it compare poses themselves.
        """
        known = self.state.motion.velocity is not None or self.config.budget.is_least(frame.extrapolated_s)
        begun = not (known or self.state.is_first or self.beginnings.in_doubt)
        if not (self.is_slow(frame) or begun):
            return Decision(fit, True)
        with clock.stage("relocalize"):
            guess, covariance = frame.predicted.cam_from_world, frame.predicted.covariance
            sought = Sought(
                frame.image,
                [guess],
                covariance,
                self.state.range_m,
                fit,
                thorough=True,
                likely=frame.likely,
                lost=self.state.is_lost,
            )
            with self.fitter.work.reserved(self.look_alikes.taken()):
                found = self.relocator.confirm(sought)
        return Decision(found.fit, found.leads, not found.leads, contenders=found.contenders)

    def search_is_due(self, frame: Frame, fit: Fit) -> bool:
        """Whether a fit's support is so low that a pose search is required.

        A fit that chance would find among the poses of a search is believed as little here as there, and is not put off
        for a search of another fit. After a long frame interval it is compared with other poses anyway. Where frames
        have more than the least budget, a fit of less than the usual support is, too, unless chance is beyond doubt.
        """
        loss, slow = self.config.loss, self.is_slow(frame)
        suspect = not slow and is_suspect(fit)
        doubtful = fit.log10_false_alarms(SEARCHED_POSES) >= loss.log10_false_alarms
        unusual = slow or (doubtful and not self.config.budget.is_least(frame.step_s))
        wanted = self.state.usual_or_good() if unusual else self.config.good_support
        if not suspect and fit.support >= wanted:
            return False
        put_off = self.until_search >= 0 and not self.relocator.under_way and self.searched_suspect >= suspect
        return slow or not put_off or not fit.support >= loss.min_support

    def recall(self, frame: Frame, fit: Fit) -> Recalled:
        """Likely poses of a frame that nothing explains yet, by what the run saw; none where others need the budget."""
        spent = frame.follows_hypotheses or self.relocator.needs_budget
        places = self.places if self.places.last else self.beginnings.places
        if not places.last or fit.support >= self.config.loss.min_support or spent:
            return Recalled()
        return places.recalled(frame.image, self.fitter.work, self.fitter.cost(1))

    def remember(self, frame: Frame, decision: Decision) -> None:
        """Remember the place of a pose that was told; that of a doubted one apart, until it is told."""
        told, fit = not decision.is_open, decision.fit
        if told or self.beginnings.in_doubt:
            places = self.places if told else self.beginnings.places
            places.add(frame.image, fit.cam_from_world, fit.range_m)
        if told:
            self.beginnings.places.forget()

    def is_slow(self, frame: Frame) -> bool:
        """Whether motion was extrapolated for so long that the fit may be to a neighbouring edge."""
        return frame.extrapolated_s >= self.config.slow_s

    def recover(self, frame: Frame, fit: Fit) -> Decision:
        """The best fit of a slice of the search around the prediction and the last pose, or the given fit."""
        loss, config, predicted = self.config.loss, self.config.relocalization, frame.predicted.cam_from_world
        covariance = self.state.spread(Likely(frame.predicted), frame.dt_s).predicted.covariance
        if self.state.is_first or not self.doubts.settled:
            covariance = covariance + isotropic_covariance(config.guess_sigma, self.state.range_m)
        first, slow = self.state.is_first, self.is_slow(frame)
        tracked = not (first or slow or self.state.is_lost)
        others = [each.predicted.cam_from_world for each in frame.likely[1:MOST_GUESSES]]
        carried = self.state.motion.carried_on(frame.dt_s) if frame.extrapolated_s > 0.0 else None  # not the vehicle's
        lasting, nearest = [carried] if carried else [], [predicted, *others]
        nearest = nearest + lasting if frame.dt_s < self.config.motion.memory_s else lasting + nearest
        guesses = [predicted] if first else [*nearest, self.state.motion.cam_from_world]
        if frame.step_s >= self.config.slow_s:
            self.relocator.forget()
        sure = np.inf if first else self.state.usual_or_good()
        self.recalled, work = self.recall(frame, fit), self.fitter.work
        # For a fit where the run may begin again; for those without memory around a doubted pose, or at look-alikes.
        doubted = not (self.doubts.settled or self.config.budget.is_least(frame.step_s))
        anew = self.led and not first
        reserve = self.fitter.cost(1) if anew else work.left // 2 if doubted else self.look_alikes.taken()
        with work.reserved(reserve):
            sought = Sought(
                frame.image,
                guesses,
                covariance,
                self.state.range_m,
                fit,
                sure=sure,
                thorough=slow,
                recalled=[*self.recalled.landmarks, *self.recalled.alike],
                likely=frame.likely,
                lost=self.state.is_lost,
                carried=carried,
                goes_on=frame.step_s < self.config.slow_s,
                tracked=tracked,
                surfaces=() if first or self.recalled.alike else self.places.surfaces(self.relocator.reader, work),
            )
            found = self.relocator.search(sought)
        self.recalled = self.recalled.also_at(found.remembered)
        unvouched = first and not self.beginnings.is_as_given(fit)
        near = fit.finite and self.relocator.turned.ends_at(fit, found.fit, self.state.range_m)
        searched = unvouched or not (near or (tracked and self.state.is_expected(found.fit, frame.predicted)))
        enough = self.state.holds(found.fit, frame.predicted, searched, not slow, self.recalled.landmarks)
        leads = found.leads and found.near_done
        if first and not enough and self.leads_again(leads and self.state.may_follow(found.fit)):
            self.relocator.forget()  # the camera moves on: doubts ask of later frames whether chance explains it
            return Decision(found.fit, True, searched=searched, holds=True)
        # After a long frame interval another pose that looks alike may have the usual support.
        is_sure = enough and found.fit.support >= sure and (found.leads or not slow or found.fit is fit)
        rivalled = enough and found.near_done and not found.leads and not is_sure
        # Where a pose is known well, by motion or by what the surface looks like, few are compared with it.
        sole = not is_by_chance(found.fit, 1) if first else found.expected and self.is_led(frame, found.fit)
        known = found.remembered or sole
        compared = found.near_done or (found.leads and known)
        settled = not rivalled and (is_sure or found.all_done or (compared and enough))
        if settled or found.all_done:
            self.relocator.forget()
        holds = not unvouched if first else fit.support >= loss.min_support
        if settled and found.advantage > (config.lead if holds and not slow else 0.0):
            return Decision(found.fit, True, searched=searched)
        there = not slow and fit.finite and self.state.is_there(fit, frame.predicted, True)
        elsewhere = found.fit is not fit and not near  # a track's fit may have been drawn along
        if settled or (((tracked and holds) or there) and not (elsewhere or found.outdoes(fit, config.lead))):
            return Decision(fit, True, searched=unvouched)
        # The track's fit, with the points seen where it ends; where there is time, others are compared with it first.
        alone = found.near_done or self.config.budget.is_least(frame.step_s)
        again = found.fit.finite and alone and not (searched or slow)
        if again and self.state.is_there(found.fit, frame.predicted, True):
            return Decision(found.fit, True)
        rivalled = rivalled or (enough and found.rivalled) or (tracked and holds and elsewhere)
        if first or not found.near_done:
            return Decision(found.fit, False, rivalled, contenders=found.contenders)
        led = self.leads_again(leads and self.state.may_begin_at(found.fit))
        return Decision(found.fit, False, rivalled, leads=led, contenders=found.contenders)

    def is_led(self, frame: Frame, fit: Fit) -> bool:
        """Whether the motion tells that a fit near its prediction is the one: after a long frame interval, where
        others that look alike were compared with it, or if a search that knew nothing of the motion could find it.

        Before a velocity is known a pose near the last one is no more expected than its neighbours.
        """
        moving = self.state.motion.velocity is not None
        return self.is_slow(frame) or (moving and self.state.stands_alone(fit, frame.predicted))

    def leads_again(self, leads: bool) -> bool:
        """Whether a fit of a complete search leads those at other poses, as one of the last frame searched did."""
        led, self.led = self.led, leads
        return led and leads
