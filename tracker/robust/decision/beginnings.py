"""Where a run begins again: at a pose found after a loss, or a better first one, with an empty memory; and back."""

from dataclasses import replace
from typing import NamedTuple

from uavbench.tracker.geometry_kernels import inverse6
from uavbench.tracker.robust.decision.found_edges import FoundEdges
from uavbench.tracker.robust.fit.learning import Memory
from uavbench.tracker.robust.fit.pose_fit import Fit
from uavbench.tracker.robust.frames import Frame, Photometry
from uavbench.tracker.robust.motion_model import FAR_CHI2, Motion, isotropic_covariance
from uavbench.tracker.robust.places.places import Places
from uavbench.tracker.robust.relocalization.doubts import Doubts, is_by_chance
from uavbench.tracker.robust.relocalization.look_alikes import Verdict
from uavbench.tracker.robust.relocalization.ranking import ends_at
from uavbench.tracker.robust.track_state import Told, TrackState, Within
from uavbench.tracker.stage_clock import StageClock
from uavbench.trajectories.pose import Pose


class Before(NamedTuple):
    """What a run knew before it began again at a pose that is doubted."""

    memory: Memory
    state: TrackState
    photometry: Photometry


class Untold(NamedTuple):
    """A pose that a search found, not told yet from others at which the structure looks alike.

    within: where the camera might have been then, moved along with it.
    """

    cam_from_world: Pose
    within: Within

    def moved_to(self, cam_from_world: Pose) -> "Untold":
        """The same after the motion that a track tells, which is that from a look-alike, too."""
        return Untold(cam_from_world, self.within.moved(cam_from_world @ self.cam_from_world.inverse()))


class Beginnings:
    """Begins again, and returns to what was known before if the pose is given up.

    places: where the doubted pose was tracked; they tell where to look again once it is given up.
    """

    def __init__(self, doubts: Doubts, found_edges: FoundEdges, state: TrackState, places: Places) -> None:
        self.doubts, self.relocator, self.fitter = doubts, doubts.relocator, doubts.fitter
        self.found_edges, self.state, self.config = found_edges, state, doubts.fitter.config
        self.places = places
        self.initial, self.initial_range_m, self.gave_up = state.motion, state.range_m, False
        self.before: Before | None = None
        self.untold: Untold | None = None

    @property
    def in_doubt(self) -> bool:
        """Whether the pose is doubted, or not told yet from others at which the structure looks alike."""
        return not self.doubts.settled or self.untold is not None

    def note_begin(self) -> None:
        """Note when the run began, at its first frame; no pose is told before but the initial one, and that roughly."""
        if self.state.told is None:
            wide = isotropic_covariance(self.config.relocalization.guess_sigma, self.initial_range_m)
            roughly = replace(self.initial, covariance=self.initial.covariance + wide)
            self.state.told = Told(roughly, self.initial_range_m, self.fitter.now_s)

    def doubt_first(self, fit: Fit) -> None:
        """Tell a first pose that a search found from its look-alikes; doubt it, too, unless it is the initial one.

        That one is doubted if chance explains it. Its look-alikes are those that the initial pose leaves open.
        """
        as_given = self.is_as_given(fit) and not is_by_chance(fit, 1)
        self.untold = Untold(fit.cam_from_world, self.given()) if as_given else self.not_told(fit)
        self.places.forget()
        if not as_given:
            self.doubts.begin(fit)

    def given(self) -> Within:
        """Where the camera may be by the initial pose alone."""
        since_s = self.state.told_before_s(self.fitter.now_s)
        return Within((self.initial.predict(since_s, self.initial_range_m, self.config.motion),), self.initial_range_m)

    def doubt_again(self, frame: Frame, fit: Fit, told: bool) -> None:
        """Doubt a pose that was found elsewhere than the run expected it, and keep what was known before.

        told: whether it was told from those at which the structure looks alike.
        """
        self.before, self.untold = self.known_before(frame), None if told else self.not_told(fit)
        self.places.forget()
        self.doubts.begin(fit)

    def not_told(self, fit: Fit) -> Untold:
        """The pose of a fit, which is to be told from others within reach."""
        return Untold(fit.cam_from_world, self.state.within(self.fitter.now_s))

    def known_before(self, frame: Frame) -> Before:
        """What a run knew before a frame at which it found a pose after a loss."""
        known = self.fitter.memory._replace(appearance=frame.before.appearance)
        return Before(known, replace(self.state, is_lost=True), frame.before)

    def give_up_doubted(self, before: Photometry) -> Photometry:
        """Return from a doubted pose to what was known before, or the initial pose, and to the photometry from then."""
        if not self.in_doubt:
            return before
        self.doubts.end()
        self.untold = None
        self.found_edges.forget()
        self.relocator.forget()
        if self.before is not None:
            before = self.before.photometry
            self.fitter.remember(self.before.memory)
            self.state.return_to(self.before.state)
            self.before = None
            return before
        self.gave_up = True
        self.fitter.forget()
        self.state.begin_again(self.initial, self.initial_range_m)
        return before._replace(appearance=self.fitter.appearance)

    def begun_again(self, frame: Frame, fit: Fit, clock: StageClock) -> Fit | None:
        """A fit without memory at a pose found after a loss, at which the run begins again; None if it tells little.

        What the structure looks like from there may not be known, so that support is compared with nothing.
        """
        if self.in_doubt or not self.doubts.without_memory().has_room_for(1):
            return None
        with clock.stage("relocalize"):
            anew = self.doubts.anew(frame.image, fit, self.state.range_m)
        if not self.state.may_begin_at(anew):
            return None
        self.before, self.untold = self.known_before(frame), self.not_told(anew)
        self.relocator.forget()
        fit = self.begun_at(anew, clock)
        self.state.is_lost = False
        self.doubts.begin(anew)
        return fit

    def begun_at(self, fit: Fit, clock: StageClock) -> Fit:
        """The fit, its edges located, at which the run begins again with an empty memory."""
        self.fitter.forget()
        self.places.forget()
        self.found_edges.forget()
        start = self.freed(fit)
        self.state.begin_again(Motion(start.cam_from_world, start.covariance), start.range_m)
        return self.freed(self.fitter.located(fit, clock))

    def freed(self, fit: Fit) -> Fit:
        """A fit that was held near where it began, with the covariance that it has without that.

        No more is known beforehand than what a search tells.
        """
        wide = isotropic_covariance(self.config.relocalization.found_sigma, fit.range_m)
        return fit.with_prior(inverse6(wide)) if fit.finite else fit

    def is_as_given(self, fit: Fit) -> bool:
        """Whether a fit is at the initial pose, while no other was accepted."""
        near = fit.finite and self.state.motion.squared_mahalanobis(fit.cam_from_world) < FAR_CHI2
        return near and not self.gave_up

    def doubted(self, frame: Frame, fit: Fit, clock: StageClock) -> Fit:
        """The given fit of a first pose that was searched, or a better one, at which the run begins again."""
        if self.untold is not None:
            self.untold = self.untold.moved_to(fit.cam_from_world)
        if self.doubts.settled:
            return fit
        with clock.stage("relocalize"):
            better = self.doubts.better(frame.image, fit, self.state.range_m)
        if better is not None:
            same = ends_at(better, fit, self.config.relocalization.found_sigma, self.state.range_m)
            self.untold = self.untold or (None if same or self.before is None else self.not_told(better))
            fit = self.begun_at(better, clock)
        if self.untold is not None:
            self.untold = self.untold._replace(cam_from_world=fit.cam_from_world)
        return fit

    def placed(self, fit: Fit, told: Verdict | None, clock: StageClock) -> Fit:
        """The fit, or the one that leads it of those at look-alikes, at which the run begins again; no more in doubt.

        told: None if the structure looks alike nowhere else within reach, or that was told before.
        """
        if told is not None and not told.leads:
            return fit
        self.before = self.untold = None
        return fit if told is None or told.fit is fit else self.begun_at(told.fit, clock)
