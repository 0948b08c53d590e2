"""Relocalization: pose search without a usable prediction, each pose found refined by a fit."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from uavbench.scenes.camera import Camera
from uavbench.tracker.protocol import Image
from uavbench.tracker.robust.config.relocalization import RelocalizationConfig
from uavbench.tracker.robust.edge_fit import EdgeFitter
from uavbench.tracker.robust.pose_fit import Fit
from uavbench.tracker.robust.relocalization.pose_search import PoseSearch, SearchRange
from uavbench.tracker.robust.relocalization.pose_search_kernels import turned_about
from uavbench.tracker.stage_clock import StageClock
from uavbench.trajectories.pose import Array, Pose

ROBERTS = 1.0 / 1.1127756842787055 ** np.arange(1, 7)
"""Steps of the sequence that fills a cube of six dimensions evenly (Roberts 2018)."""


class Relocalized(NamedTuple):
    """The best supported fit, and how much better it is than the one at hand; inf where there was none."""

    fit: Fit
    advantage: float


@dataclass(frozen=True, eq=False)
class Relocator:
    """Searches the pose of an image."""

    fitter: EdgeFitter
    searcher: PoseSearch
    config: RelocalizationConfig

    @classmethod
    def of(cls, fitter: EdgeFitter, camera: Camera, config: RelocalizationConfig) -> "Relocator":
        """Relocator that fits with a fitter."""
        return cls(fitter, PoseSearch(fitter.edges, camera, fitter.view.near, config.search), config)

    def best(
        self, image: Image, guesses: list[Pose], covariance: Array, range_m: float, first: Fit | None = None
    ) -> Relocalized:
        """The best supported fit of all, against the first one that was made already.

        guesses are poses around which to search, the likeliest one first with its covariance (6, 6).
        """
        config, information = self.config, np.linalg.inv(covariance)

        def score(fit: Fit) -> float:
            away = (fit.cam_from_world @ guesses[0].inverse()).log()
            found = config.found_support * float(np.log1p(fit.found))
            return fit.support + found - config.distance_cost * float(away @ information @ away)

        clock = StageClock()
        found = sigmas(config.found_sigma, range_m)
        fits = [] if first is None else [first]
        near = [pose for guess in guesses for pose in self.near(image, guess)]
        fits += [self.fitter.fit(image, pose, found, clock, config.near_half_px) for pose in [*guesses, *near]]
        if not max(fit.support for fit in fits) >= config.good_support:
            far = [scored.pose for scored in self.searcher.best_poses(image, guesses, self.far(), config.far_fits)]
            fits += [self.fitter.fit(image, pose, found, clock, config.far_half_px) for pose in far]
        fitted = sigmas(config.fitted_sigma, range_m)
        for _ in range(config.refits):
            fits = sorted((fit for fit in fits if fit.finite), key=score)
            best = fits[-config.refitted :]
            fits += [self.fitter.fit(image, fit.cam_from_world, fitted, clock, config.refit_half_px) for fit in best]
        for generation in range(config.generations):
            fits = sorted((fit for fit in fits if fit.finite), key=score)[-config.refitted :]
            if not fits or fits[-1].support >= config.sure_support:
                break
            turns = range(generation * config.refitted, (generation + 1) * config.refitted)
            sampled = [pose for turn, fit in zip(turns, fits, strict=False) for pose in self.perturbed(fit, turn)]
            fits += [self.fitter.fit(image, pose, found, clock, config.refit_half_px) for pose in sampled]
        top = max((fit for fit in fits if fit.finite), key=score, default=fits[0])
        return Relocalized(top, score(top) - score(first) if first is not None and first.finite else np.inf)

    def near(self, image: Image, guess: Pose) -> list[Pose]:
        """Poses near a guess whose projected edges agree with the image."""
        config, seen = self.config, self.fitter.seen(guess)
        reach = (config.near_reach_rad, config.near_shift_rad)
        return [scored.pose for scored in self.searcher.near_poses(image, guess, seen, *reach, config.near_fits)]

    def far(self) -> SearchRange:
        """Range of the pose search where no pose near a guess fits."""
        c = self.config
        return self.searcher.search_range(c.far_view_rad, c.far_roll_rad, c.far_range_part, c.far_shift_part)

    def perturbed(self, fit: Fit, turn: int) -> list[Pose]:
        """Perturbations of a fit's pose, others in every turn (evolution strategy: Rechenberg 1973)."""
        if fit.residuals is None or not len(fit.residuals.points.points):
            return []
        R, t = fit.cam_from_world.rotation, fit.cam_from_world.translation
        focus = fit.cam_from_world.transform(fit.residuals.points.points).mean(axis=0)
        count = self.config.perturbations
        k = np.arange(1, count + 1)[:, None] + turn * count
        changes = (k * ROBERTS % 1.0 * 2 - 1) * self.reach()
        return [Pose(*turned_about(R, t, focus, a)) for a in changes]

    def reach(self) -> Array:
        """Reach (6,) of perturbations as `turned_about` takes them."""
        c = self.config
        return np.repeat([c.perturbation_turn_rad, c.perturbation_part, c.perturbation_shift_rad], 2)


def sigmas(sigma: float, range_m: float) -> Array:
    """Covariance (6, 6) of a pose known to sigma, in parts of the range and in rad."""
    return np.diag([(sigma * range_m) ** 2] * 3 + [sigma**2] * 3)
