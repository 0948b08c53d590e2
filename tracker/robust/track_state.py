"""State of a run of `robust` after its frames so far, and the support required of the next one."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from typing import NamedTuple

from uavbench.tracker.robust.config import RobustConfig
from uavbench.tracker.robust.fit.pose_fit import Fit
from uavbench.tracker.robust.motion_model import FAR_CHI2, Motion, PredictionErrors, isotropic_covariance
from uavbench.tracker.robust.near_poses import log10_poses_as_near
from uavbench.tracker.robust.relocalization.ranking import SEARCHED_POSES, SURE, Contender, Likely
from uavbench.tracker.robust.solver.hypothesis_kernels import HYPOTHESES
from uavbench.tracker.robust.solver.solve_kernels import UNKNOWNS
from uavbench.trajectories.pose import Pose


class Hypothesis(NamedTuple):
    """The motion if a fit of an undecided frame is right, that frame's stamp, and its worth relative to the best fit.

    errors: of the predictions that led to it.
    """

    motion: Motion
    stamp_ns: int
    worth: float
    errors: PredictionErrors


class Told(NamedTuple):
    """Motion and range (m) at the last pose that was told, and its stamp, s."""

    motion: Motion
    range_m: float
    stamp_s: float


class Within(NamedTuple):
    """Where the camera may be, whatever was found since, and how far that is from the structure, m."""

    reach: tuple[Motion, ...]
    range_m: float

    def moved(self, by: Pose) -> "Within":
        """The same after a motion of the camera."""
        return Within(
            tuple(replace(each, cam_from_world=by @ each.cam_from_world) for each in self.reach), self.range_m
        )


@dataclass
class TrackState:
    """Motion and range (m) at the last frame that was ok, its stamp (None before the first), and the usual support.

    told: the last of these poses that was not open, before it the initial one; None before the first frame.
    """

    config: RobustConfig
    motion: Motion
    range_m: float
    ok_ns: int | None = None
    usual_support: float = 0.0
    frames_ok: int = 0
    is_lost: bool = False
    hypotheses: tuple[Hypothesis, ...] = ()
    prediction_errors: PredictionErrors = field(default_factory=PredictionErrors)
    told: Told | None = None

    @property
    def is_first(self) -> bool:
        """Whether no frame was ok yet."""
        return self.ok_ns is None

    def predicted(self, dt_s: float, stamp_ns: int) -> Motion:
        """The motion model's prediction for a frame, dt_s after the last one that was ok."""
        predicted = self.motion.predict(dt_s, self.range_m, self.config.motion)
        if not self.hypotheses:
            return predicted
        likely = self.likely(predicted, stamp_ns)[0].predicted.cam_from_world
        return replace(predicted, cam_from_world=likely)  # likelier, but not more certain

    def likely(self, predicted: Motion, stamp_ns: int) -> tuple[Likely, ...]:
        """The predictions under the hypotheses that were kept, the likeliest first; a given prediction without any.

        Once a velocity is forgotten it is unknown, and what a search compares may be as far away as that leads. What
        the errors of predictions were from frame to frame says nothing of that.
        """
        found = []
        for motion, since_ns, worth, errors in self.hypotheses:
            since_s = (stamp_ns - since_ns) * 1e-9
            moved = motion.predict(since_s, self.range_m, self.config.motion)
            found.append(self.spread(Likely(moved, worth, errors.scale), since_s))
        if found:
            return tuple(found)
        lost_s = 0.0 if self.ok_ns is None else (stamp_ns - self.ok_ns) * 1e-9
        return (self.spread(Likely(predicted, scale=self.prediction_errors.scale), lost_s),)

    def within(self, now_s: float) -> Within:
        """Where the camera may be since the last pose that was told, whatever frames since then suggested."""
        assert self.told is not None
        motion, range_m, told_s = self.told
        predicted = self.spread(Likely(self.carried_on(now_s)), now_s - told_s, usual_rate_1_s(self.told, self.config))
        still = replace(predicted.predicted, cam_from_world=motion.cam_from_world)
        return Within((predicted.predicted, still), range_m)

    def told_before_s(self, now_s: float) -> float:
        """Time since the last pose that was told."""
        return math.inf if self.told is None else now_s - self.told.stamp_s

    def carried_on(self, now_s: float) -> Motion:
        """Where motion leads since the last pose that was told."""
        assert self.told is not None
        motion, range_m, told_s = self.told
        return motion.predict(now_s - told_s, range_m, self.config.motion)

    def spread(self, likely: Likely, after_s: float, rate_1_s: float | None = None) -> Likely:
        """A prediction so long after its last pose, with what a forgotten velocity leaves unknown.

        rate_1_s: standard deviation of that velocity, in ranges/s and rad/s; None for the one assumed.
        """
        unknown_s = after_s - self.config.motion.memory_s
        if unknown_s <= 0.0:
            return likely
        rate_1_s = self.config.motion.initial_rate_1_s if rate_1_s is None else rate_1_s
        wider = isotropic_covariance(unknown_s * rate_1_s, self.range_m)
        predicted = replace(likely.predicted, covariance=likely.predicted.covariance + wider)
        return Likely(predicted, likely.worth)

    def usual_or_good(self) -> float:
        """The larger of a good support and a part of the usual one."""
        return max(self.config.good_support, self.config.loss.slow_part * self.usual_support)

    def holds(self, fit: Fit, predicted: Motion, searched: bool, recent: bool, landmarks: Sequence[Pose] = ()) -> bool:
        """Whether chance would not find as much, and a fit has the required support or edges that leave no doubt.

        recent: whether the last pose is; landmarks: poses by what the run has seen before. A fit that was searched may
        have any support where hardly a pose among all those of a search, or those as near to one of landmarks, is
        expected to find as many of its edges by chance.
        """
        if not fit.finite or self.is_by_chance(fit, predicted, searched):
            return False
        given = self.is_first and not searched  # of which chance alone decides: in the dark hardly a point is found
        enough = given or fit.support >= self.required_support(fit, predicted, searched)
        poses = SEARCHED_POSES if searched else HYPOTHESES
        beyond_doubt = searched and not self.is_first and self.is_beyond_doubt(fit, landmarks)
        return enough or beyond_doubt or self.is_there(fit, predicted, recent, poses)

    def stands_alone(self, fit: Fit, predicted: Motion) -> bool:
        """Whether a fit has the support, or the edges, of one that a search found wherever it may be."""
        enough = fit.support >= self.required_support(fit, predicted, True) or self.is_beyond_doubt(fit)
        return fit.finite and enough and not self.is_by_chance(fit, predicted, True)

    def log10_searched(self, fit: Fit, landmarks: Sequence[Pose]) -> float:
        """Decimal logarithm of the number of poses among which a search found a fit, no less than those of a fit.

        Landmarks tell where to look, and are nothing that the model's edges have in common with chance.
        """
        if not landmarks:
            return max(math.log10(HYPOTHESES), math.log10(SEARCHED_POSES))
        known = isotropic_covariance(self.config.relocalization.found_sigma, self.range_m)
        apart_px = self.config.solver.estimator.last_width_px
        near = [log10_poses_as_near(fit, Motion(pose, known), apart_px) for pose in landmarks]
        return max(math.log10(HYPOTHESES), min([math.log10(SEARCHED_POSES), *near]))

    def is_by_chance(self, fit: Fit, predicted: Motion, searched: bool) -> bool:
        """Whether chance explains a fit, among the poses of a search or, without one, those as near to a prediction."""
        enough, apart_px = 0.0 if self.is_first else SURE, self.config.solver.estimator.last_width_px
        if fit.chance.whole + math.log10(SEARCHED_POSES) < enough:  # a track has no more of them than a search
            return False
        return searched or fit.chance.whole + log10_poses_as_near(fit, predicted, apart_px) >= SURE

    def may_stay_at(self, fit: Fit, given: Motion) -> bool:
        """Whether a fit held at the given initial pose has the support of a first one, or any where chance has none."""
        sure = fit.finite and fit.log10_false_alarms(HYPOTHESES) < SURE
        enough = sure or fit.support >= self.config.initialization.min_support
        return fit.finite and enough and not self.is_by_chance(fit, given, False)

    def may_begin_at(self, fit: Fit) -> bool:
        """Whether a fit that a search found would do as a first one, of which nothing is known."""
        enough = fit.finite and fit.support >= self.config.initialization.min_support
        return enough and fit.log10_false_alarms(SEARCHED_POSES) < 0.0

    def may_follow(self, fit: Fit) -> bool:
        """Whether a track could go on at a fit with the support of a first one, if nothing had moved."""
        return fit.finite and fit.support >= self.config.initialization.min_support and fit.chance.whole < SURE

    def required_support(self, fit: Fit, predicted: Motion, searched: bool = False) -> float:
        """Support required of a fit: nearly the usual one if it was searched, or is far from the prediction."""
        loss = self.config.loss
        if self.is_first:
            return self.config.initialization.min_support
        unusual = not fit.support >= self.usual_support
        far = unusual and predicted.squared_mahalanobis(fit.cam_from_world) > FAR_CHI2
        return max(loss.min_support, loss.far_part * self.usual_support if far or searched or self.is_lost else 0.0)

    def is_there(self, fit: Fit, predicted: Motion, recent: bool, poses: int = HYPOTHESES) -> bool:
        """Whether a track goes on near the prediction because chance would not match as many edges.

        Near is what the run's own predictions are. What chance would not find among the poses as near is enough,
        however much is hidden. Of a recent pose (recent) half of the edges are, also after a few frames that were lost:
        patches that an occluder hides say nothing against it.
        """
        if not self.is_expected(fit, predicted):
            return False
        loss, log10_nfa = self.config.loss, fit.chance.edges + math.log10(poses)
        if recent and fit.edge_support >= loss.min_support and log10_nfa < SURE:
            return True
        as_near = log10_poses_as_near(fit, predicted, self.config.solver.estimator.last_width_px)
        if fit.chance.whole + as_near < SURE:
            return True
        return not self.is_lost and log10_nfa < loss.log10_false_alarms

    def is_expected(self, fit: Fit, predicted: Motion) -> bool:
        """Whether a fit is as near to its prediction as those of this run are, so that few poses can be meant."""
        usual_chi2 = FAR_CHI2 * self.prediction_errors.scale
        return fit.finite and not self.is_first and predicted.squared_mahalanobis(fit.cam_from_world) <= usual_chi2

    def suppose(self, contenders: Sequence[Contender], likely: Sequence[Likely], dt_s: float, stamp_ns: int) -> None:
        """Keep the fits of an undecided frame as hypotheses, if the support of the best is that of a correct pose.

        likely: the predictions that they follow; dt_s: time since the last frame that was ok.
        """
        rate = self.config.edges.appearance.learning_rate
        least = max(self.config.loss.min_support, self.config.loss.far_part * self.usual_support)
        sound = [each for each in contenders if self.is_sound(each.fit, least)]
        if self.is_first or not sound or sound[0] is not contenders[0]:
            return
        accepted = Hypothesis(self.motion, stamp_ns - round(dt_s * 1e9), 0.0, self.prediction_errors)
        found = []
        for fit, worth, follows in sound:
            goes_on = self.hypotheses and self.goes_on(fit, likely[follows].predicted, stamp_ns * 1e-9)
            motion, since_ns, _, errors = self.hypotheses[follows] if goes_on else accepted
            since_s = (stamp_ns - since_ns) * 1e-9
            moved = motion.update(fit.cam_from_world, fit.covariance, since_s, self.config.motion.memory_s)
            errors = errors.updated(likely[follows].predicted, fit.cam_from_world, rate)
            found.append(Hypothesis(moved, stamp_ns, worth - sound[0].worth, errors))
        self.hypotheses = tuple(found)

    def goes_on(self, fit: Fit, predicted: Motion, now_s: float) -> bool:
        """Whether a fit is the continuation of a prediction, and not as far from it as one of the last pose told.

        A place at which the structure looks alike is no motion from the other one.
        """
        near, there = predicted.squared_mahalanobis(fit.cam_from_world), self.within(now_s).reach
        return near <= max(FAR_CHI2, min(each.squared_mahalanobis(fit.cam_from_world) for each in there))

    def is_sound(self, fit: Fit, least: float) -> bool:
        """Whether a fit has a least support that chance does not explain, or edges that leave no doubt."""
        enough = fit.support >= least or self.is_beyond_doubt(fit)
        return fit.finite and enough and fit.log10_false_alarms(SEARCHED_POSES) < 0.0

    def is_beyond_doubt(self, fit: Fit, landmarks: Sequence[Pose] = ()) -> bool:
        """Whether hardly a pose among all those of a search, or near landmarks, finds as many edges by chance."""
        return fit.chance.edges + self.log10_searched(fit, landmarks) < self.config.loss.log10_false_alarms

    def is_recognized(self, fit: Fit) -> bool:
        """Whether hardly a pose among all those of a search finds as much of edges and patches by chance."""
        return fit.log10_false_alarms(SEARCHED_POSES) < self.config.loss.log10_false_alarms

    def return_to(self, before: "TrackState") -> None:
        """Return to an earlier state."""
        for each in fields(self):
            setattr(self, each.name, getattr(before, each.name))

    def begin_again(self, motion: Motion, range_m: float) -> None:
        """Begin again at a pose, as if no frame had been ok before."""
        self.motion, self.range_m, self.hypotheses = motion, range_m, ()
        self.ok_ns, self.usual_support, self.frames_ok = None, 0.0, 0
        self.prediction_errors = PredictionErrors()

    def learn(self, predicted: Motion, fit: Fit, dt_s: float, stamp_ns: int, step_s: float) -> None:
        """Update motion, usual support and the errors of predictions with a frame that is ok.

        dt_s: time since the last one that was; step_s: since the last one. A pose tells no velocity where there is none
        before it, or where it was found after a loss, farther away than what a vehicle may do.
        """
        rate = self.config.edges.appearance.learning_rate
        far = dt_s > step_s and predicted.squared_mahalanobis(fit.cam_from_world) > FAR_CHI2
        if self.is_first or far:
            dt_s = 0.0
        if not self.is_first:
            self.prediction_errors = self.prediction_errors.updated(predicted, fit.cam_from_world, rate)
        memory_s = self.config.motion.memory_s
        self.motion = self.motion.update(fit.cam_from_world, fit.covariance, dt_s, memory_s)
        self.hypotheses = ()
        # The first frame says little about the next ones, since the appearance of its edges is not known yet.
        self.usual_support += max(rate, 1 / max(1, self.frames_ok)) * (fit.support - self.usual_support)
        self.ok_ns, self.range_m, self.frames_ok = stamp_ns, fit.range_m, self.frames_ok + 1


def usual_rate_1_s(told: Told, config: RobustConfig) -> float:
    """Standard deviation of a forgotten velocity, in ranges/s and rad/s: by the one assumed, and by the last one.

    Each counts as the squares of six unknowns.
    """
    assumed, last = config.motion.initial_rate_1_s, told.motion.mean_velocity
    if last is None:
        return assumed
    squares = float(last[:3] @ last[:3]) / told.range_m**2 + float(last[3:] @ last[3:])
    return math.sqrt((UNKNOWNS * assumed**2 + squares) / (2 * UNKNOWNS))
