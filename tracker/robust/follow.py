"""The fit by which a track goes on: from its prediction, and from where that fit ends."""

from uavbench.tracker.robust.config import RobustConfig
from uavbench.tracker.robust.fit.edge_fit import EdgeFitter
from uavbench.tracker.robust.fit.pose_fit import Fit
from uavbench.tracker.robust.frames import Frame
from uavbench.tracker.robust.motion_model import FAR_CHI2, Motion, isotropic_covariance
from uavbench.tracker.robust.relocalization.scoring.pose_search import PoseSearch
from uavbench.tracker.robust.track_state import TrackState
from uavbench.tracker.stage_clock import StageClock
from uavbench.trajectories.pose import Array

PINNED_SIGMA = 1e-4
"""Standard deviation of a prediction by which a frame is matched as if nothing had moved from it, as a fraction of the
range and in rad: less than a tenth of a pixel of an image 640 px wide."""


class Follower:
    """Fits frames from their predictions."""

    def __init__(self, fitter: EdgeFitter, state: TrackState, searcher: PoseSearch, config: RobustConfig) -> None:
        self.fitter, self.state, self.searcher, self.config = fitter, state, searcher, config

    def fit(self, frame: Frame, clock: StageClock) -> Fit:
        """The fit from the prediction, matched where this run's poses usually are.

        Where that looks worse than usual, or is farther away, one not held there is made, and the likelier one counts;
        and one matched at the prediction itself, which counts if it is clearly likelier: somebody who passes an edge
        draws it along.
        """
        at, usual = frame.predicted, self.usual(frame)
        if usual is None:
            free = self.fitter.fit(frame.image, at.cam_from_world, at.covariance, clock)
            if not self.is_predicted(frame):
                return free
            near = self.state.is_expected(free, at)
            if near and free.support >= self.state.usual_or_good():
                return free
            if not near:
                held = self.held(frame, self.usual_covariance(frame), clock)
                free = max(free, held, key=lambda each: self.worth(frame, each))
            return self.or_pinned(frame, free, clock)
        held = self.held(frame, usual, clock)
        near = Motion(at.cam_from_world, usual).squared_mahalanobis(held.cam_from_world) <= FAR_CHI2
        if held.finite and near and held.support >= self.state.usual_or_good():
            return held
        free = self.fitter.fit(frame.image, at.cam_from_world, at.covariance, clock)
        return self.or_pinned(frame, max(free, held, key=lambda each: self.worth(frame, each)), clock)

    def or_pinned(self, frame: Frame, best: Fit, clock: StageClock) -> Fit:
        """The best fit so far, or one matched at the prediction itself if that is clearly likelier."""
        pinned = self.held(frame, isotropic_covariance(PINNED_SIGMA, self.state.range_m), clock)
        least = self.worth(frame, best) + self.config.relocalization.lead_of_rivals
        return pinned if self.worth(frame, pinned) > least else best

    def unrolled(self, frame: Frame, fit: Fit, clock: StageClock) -> Fit:
        """The fit; to the image of a rolling shutter one more, with the velocity that the first one tells.

        Velocities are means of intervals, the last of which ends with the frame: half of their change is added. After a
        long interval, or with little support, a fit tells nothing of the present velocity.
        """
        before, close = self.state.motion, 0.0 < frame.dt_s < self.config.slow_s
        sure = fit.finite and fit.support >= self.config.loss.min_support
        if not self.fitter.camera.readout_ms or before.velocity is None or not (close and sure):
            return fit
        memory_s = self.config.motion.memory_s
        now = before.update(fit.cam_from_world, fit.covariance, frame.dt_s, memory_s).velocity
        assert now is not None
        self.fitter.move(now + 0.5 * (now - before.velocity))
        return self.fit(frame, clock)

    def held(self, frame: Frame, usual: Array, clock: StageClock) -> Fit:
        """A fit that is matched by a prediction of this covariance (6, 6), and estimated by the frame's.

        So edges are those nearest to where the pose is thought to be, while the pose itself is told by the image: what
        made the prediction has the errors of the image before, which would count twice.
        """
        at = frame.predicted
        found = self.fitter.search(frame.image, at.cam_from_world, usual, clock)
        return found if isinstance(found, Fit) else self.fitter.concluded(found.with_covariance(at.covariance), clock)

    def worth(self, frame: Frame, fit: Fit) -> float:
        """Support of a fit, and its worth before its frame; -inf where it has no pose."""
        if not fit.finite:
            return -float("inf")
        return fit.support + frame.likely[0].prior(fit.cam_from_world, self.config.relocalization.lead)

    def compared(self, frame: Frame, fit: Fit) -> float:
        """What fits of a frame are compared by: their worth where the run predicts it, otherwise their support."""
        return self.worth(frame, fit) if self.is_predicted(frame) else fit.support

    def usual(self, frame: Frame) -> Array | None:
        """Covariance (6, 6) that the run's own predictions have shown; None where they say nothing of this frame.

        Where frames are farther apart than those of the least budget, motion between them is not smooth.
        """
        if not (self.is_predicted(frame) and self.config.budget.is_least(frame.step_s)):
            return None
        return self.usual_covariance(frame)

    def usual_covariance(self, frame: Frame) -> Array:
        """Covariance (6, 6) that the run's own predictions have shown."""
        state, known = self.state, self.state.motion.covariance
        return known + state.prediction_errors.scale * (frame.predicted.covariance - known)

    def is_predicted(self, frame: Frame) -> bool:
        """Whether the run itself predicts a frame from a pose of the last one, shortly before."""
        own = 0.0 < frame.extrapolated_s < self.config.slow_s and not self.state.hypotheses
        return own and not (self.state.is_first or self.state.is_lost)

    def repeated(self, frame: Frame, fit: Fit, clock: StageClock) -> Fit:
        """The fit, or one that begins where it ends, if that has more support; where frames have budget for it, or
        would begin a search with it.

        What the prediction was too far from to be found is found from there, in a fraction of a search's time. Where
        that is clearly more, so may more be from where it ends itself.
        """
        searched = fit.support < self.config.good_support and not self.state.is_lost
        has_budget = searched or not self.config.budget.is_least(frame.step_s)
        if self.state.is_first or not fit.finite or not has_budget:
            return fit
        wide = isotropic_covariance(self.config.relocalization.found_sigma, self.state.range_m)
        clearly = True
        while clearly and self.fitter.has_room_for(1):
            again = self.fitter.fit(frame.image, fit.cam_from_world, wide, clock, self.searcher.half_px)
            if not again.finite or self.compared(frame, again) <= self.compared(frame, fit):
                break
            clearly = again.support > fit.support + self.config.relocalization.lead
            fit = again
        return fit
