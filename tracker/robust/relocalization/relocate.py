"""Where is the camera, when the prediction does not fit: poses that agree with the image are searched and fitted."""

from dataclasses import dataclass

import numpy as np

from uavbench.scenes.camera import Camera
from uavbench.tracker.protocol import Image
from uavbench.tracker.robust.edge_fit import EdgeFitter
from uavbench.tracker.robust.pose_fit import Fit
from uavbench.tracker.robust.relocalization.pose_search import PoseSearch, spread
from uavbench.tracker.robust.relocalization.pose_search_kernels import turned_about
from uavbench.tracker.stage_clock import StageClock
from uavbench.trajectories.pose import Array, Pose

GOOD_SUPPORT = 0.6
"""With less support than this a pose is searched farther away."""
NEAR_REACH, NEAR_SHIFT = 0.15, 0.22
"""How far from a guess poses are searched first: in rad and parts of the range, and in rad of the image's shift."""
FAR = spread(view_rad=0.4, roll_rad=0.12, range_part=0.25, shift_part=0.3)
"""How far they are searched then."""
NEAR_FITS, FAR_FITS, REFITS = 32, 16, 2
"""Poses that are fitted of the search near a guess and of that far from it; times that the best are fitted again."""
BEST = 4
"""Fits that are fitted again."""
NEAR_HALF_PX, FAR_HALF_PX, REFIT_HALF_PX = 20.0, 28.0, 12.0
"""Half lengths of the search lines from such poses."""
FOUND_SIGMA, FITTED_SIGMA = 0.04, 0.005
"""One standard deviation of a pose that a search found and of one fitted once, in parts of the range and in rad."""
AWAY_SIGMA = 0.06
"""One standard deviation by which a guess may be wrong."""
MORE_FOUND = 0.3
"""Support that it is worth where e times as much of a pose is found: one that shows a face less has less to miss.

Of a box seen level, 0.77 was found at a pose that hid its top, and 0.68 of 1.6 times as much at the true one.
"""
FAR_COST = 0.02
"""Support that a pose needs more for each squared standard deviation that it lies from the guess."""

SURE_SUPPORT = 0.7
"""A pose with this support is taken for the best there is."""
STREWN, GENERATIONS = 8, 3
"""Poses strewn about each of the best fits, and times that they are, while none is supported enough."""
STREW = np.array([0.1, 0.1, 0.05, 0.05, 0.01, 0.01])
"""How far at first: turns of the object about what is seen of it in rad, part of the range, shift of the image in rad.

Wrong fits have the right outline mostly, of a box turned by some 0.1 rad.
"""
ROBERTS = 1.0 / 1.1127756842787055 ** np.arange(1, 7)
"""Steps of the sequence that fills a cube of six dimensions evenly (Roberts 2018)."""


@dataclass(frozen=True, eq=False)
class Relocator:
    """Searches the pose of an image."""

    fitter: EdgeFitter
    searcher: PoseSearch

    @classmethod
    def of(cls, fitter: EdgeFitter, camera: Camera) -> "Relocator":
        """Relocator that fits with a fitter."""
        return cls(fitter, PoseSearch(fitter.map, camera))

    def best(
        self, image: Image, guesses: list[Pose], covariance: Array, range_m: float, first: Fit | None = None
    ) -> tuple[Fit, float]:
        """The best supported fit of all, and how much better it is than the first one that was made already.

        guesses are poses around which to search, the likeliest one first with its covariance (6, 6).
        """
        information = np.linalg.inv(covariance)

        def score(fit: Fit) -> float:
            away = (fit.cam_from_world @ guesses[0].inverse()).log()
            return fit.support + MORE_FOUND * float(np.log1p(fit.found)) - FAR_COST * float(away @ information @ away)

        clock = StageClock()
        found = sigmas(FOUND_SIGMA, range_m)
        fits = [] if first is None else [first]
        near = [pose for guess in guesses for pose in self.near(image, guess)]
        fits += [self.fitter.fit(image, pose, found, clock, NEAR_HALF_PX) for pose in [*guesses, *near]]
        if not max(fit.support for fit in fits) >= GOOD_SUPPORT:
            far = [pose for _, pose in self.searcher.best_poses(image, guesses, FAR, FAR_FITS)]
            fits += [self.fitter.fit(image, pose, found, clock, FAR_HALF_PX) for pose in far]
        fitted = sigmas(FITTED_SIGMA, range_m)
        for _ in range(REFITS):
            fits = sorted((fit for fit in fits if fit.finite), key=score)
            fits += [self.fitter.fit(image, fit.cam_from_world, fitted, clock, REFIT_HALF_PX) for fit in fits[-BEST:]]
        for turn in range(GENERATIONS):
            fits = sorted((fit for fit in fits if fit.finite), key=score)[-BEST:]
            if not fits or fits[-1].support >= SURE_SUPPORT:
                break
            strewn = [pose for k, fit in enumerate(fits) for pose in beside(fit, turn * BEST + k)]
            fits += [self.fitter.fit(image, pose, found, clock, REFIT_HALF_PX) for pose in strewn]
        best = max((fit for fit in fits if fit.finite), key=score, default=fits[0])
        return best, score(best) - score(first) if first is not None and first.finite else np.inf

    def near(self, image: Image, guess: Pose) -> list[Pose]:
        """Poses near a guess at which what it sees agrees with the image."""
        points, direction = self.fitter.seen(guess)
        found = self.searcher.near_poses(image, guess, points, direction, NEAR_REACH, NEAR_SHIFT, NEAR_FITS)
        return [pose for _, pose in found]


def beside(fit: Fit, turn: int) -> list[Pose]:
    """Poses strewn about that of a fit, others in every turn (evolution strategy: Rechenberg 1973)."""
    if fit.evidence is None or not len(fit.evidence.points):
        return []
    R, t = fit.cam_from_world.rotation, fit.cam_from_world.translation
    focus = fit.cam_from_world.transform(fit.evidence.points).mean(axis=0)
    k = np.arange(1, STREWN + 1)[:, None] + turn * STREWN
    changes = (k * ROBERTS % 1.0 * 2 - 1) * STREW
    return [Pose(*turned_about(R, t, focus, a)) for a in changes]


def sigmas(sigma: float, range_m: float) -> Array:
    """Covariance (6, 6) of a pose known to sigma, in parts of the range and in rad."""
    return np.diag([(sigma * range_m) ** 2] * 3 + [sigma**2] * 3)
