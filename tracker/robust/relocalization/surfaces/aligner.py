"""Poses at which an image shows the structure's surface as a run saw it, sought about guesses."""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from uavbench.tracker.geometry_kernels import RigidMotion
from uavbench.tracker.protocol import Image
from uavbench.tracker.robust.edges.edge_graph import EdgeMap
from uavbench.tracker.robust.relocalization.pose_arrays import centre_of
from uavbench.tracker.robust.relocalization.scoring.overview import AZIMUTH_RAD, ELEVATION_RAD, STEP_RAD
from uavbench.tracker.robust.relocalization.scoring.pose_search import PoseSearch, grid, whole
from uavbench.tracker.robust.relocalization.scoring.pose_search_kernels import turned_about
from uavbench.tracker.robust.relocalization.scoring.rounds import views
from uavbench.tracker.robust.relocalization.surfaces.alignment_kernels import Surface, aligned_pose, best_shifts
from uavbench.tracker.robust.relocalization.surfaces.surface import MOST_POINTS, SurfaceReader, some_of
from uavbench.tracker.robust.work import ALIGNED_POINT, ALIGNMENT, SCANNED_POINT, SHOWN, Work

ITERATIONS = 6
"""Most changes of a pose in one image: limits their time."""
SHIFT_PX = 15
"""Extent of the shifts of a view, px of the small image, a tenth of its width; alignments bridge 5 px between them."""
SHADES = 12.0
"""Grey values that a blurred surface shows independently: correlations at wrong poses of boxes scatter by 0.3."""
MOST_ALIKE = 0.999
"""Correlation above which noise tells poses apart."""
REMEMBERED = 3.0
"""Powers of ten above which a pose is fitted before others: at true poses of boxes and facades they are 3.7 to 5, at
wrong ones up to 2.8."""
REFINED = 4
"""Poses of a guess that are aligned as well as can be."""


class Effort(NamedTuple):
    """How closely poses are looked at: so many of the best, in so many iterations, by every so manieth point."""

    poses: int
    iterations: int
    every: int


EFFORTS = Effort(24, 2, 3), Effort(12, 3, 2)
"""By which of 33 views those are found that are worth more: the true one is among them for all boxes."""


class Alike(NamedTuple):
    """A pose, and the powers of ten by which chance does not explain how alike the surface looks from there."""

    pose: RigidMotion
    rarity: float


class Aligner:
    """Aligns poses to an image by surfaces that the run saw before."""

    def __init__(self, edges: EdgeMap, searcher: PoseSearch) -> None:
        self.searcher, self.reader = searcher, SurfaceReader(edges, searcher)
        self.turns = views(AZIMUTH_RAD, ELEVATION_RAD, STEP_RAD)
        shifts = grid(SHIFT_PX, searcher.config.truncation_px)
        self.shifts = whole([(right, down) for right in shifts for down in shifts])
        self.surfaces: Sequence[Surface] = ()
        self.begin()

    def begin(self) -> None:
        """Begin a search."""
        self.looks = 0

    def look(self, image: Image, surfaces: Sequence[Surface], work: Work) -> None:
        """Look at an image, in which these surfaces may be seen."""
        self.surfaces = surfaces
        if surfaces:
            work.done += SHOWN
            self.shown = self.reader.shown(image)
            self.focus = np.stack([each.focus for each in surfaces])
            toward = np.stack([centre_of(pose) for pose in map(seen_from, surfaces)]) - self.focus
            self.toward = toward / np.linalg.norm(toward, axis=1)[:, None]

    @property
    def most(self) -> int:
        """Most evaluations of an alignment."""
        return 2 * (ALIGNMENT + (ITERATIONS + 1) * MOST_POINTS * ALIGNED_POINT)

    def looked_about(self, guesses: list[RigidMotion]) -> bool:
        """Whether each guess had its turn."""
        return self.looks >= len(guesses)

    def found(self, guesses: list[RigidMotion], cost: Callable[[RigidMotion], float], work: Work) -> list[RigidMotion]:
        """Poses about one of the guesses, each in its turn, at which the image looks as remembered, likeliest first.

        cost: powers of ten by which a pose is less likely than the likeliest.
        """
        guess = guesses[self.looks % len(guesses)]
        self.looks += 1

        def best(poses: list[Alike], most: int) -> list[Alike]:
            return sorted(poses, key=lambda each: cost(each.pose) - each.rarity)[:most]

        poses = self.views(guess, work)
        for effort in EFFORTS:
            some = best(poses, effort.poses)
            poses = [self.aligned(each.pose, work, (0,), effort.iterations, effort.every) for each in some]
        starts = [guess, *(each.pose for each in best(poses, REFINED))]
        found = best([self.aligned(pose, work) for pose in starts], len(starts))
        return [each.pose for each in found if each.rarity > REMEMBERED]

    def views(self, guess: RigidMotion, work: Work) -> list[Alike]:
        """A guess turned to all sides, each with the shift of the image with which it looks most alike."""
        focus, changes = guess.R @ self.focus[self.nearest(guess)] + guess.t, np.zeros((len(self.turns), 6))
        for k, turn in enumerate(self.turns):
            changes[k, :3] = turn.azimuth_rad * guess.R[:, 2] + [turn.elevation_rad, 0.0, 0.0]
        poses = [turned_about(guess.R, guess.t, focus, change) for change in changes]
        seen_in = np.array([self.nearest(pose) for pose in poses])
        return [
            each
            for surface in np.unique(seen_in)
            for each in self.shifted(surface, [poses[k] for k in np.flatnonzero(seen_in == surface)], work)
        ]

    def shifted(self, surface: int, poses: list[RigidMotion], work: Work) -> list[Alike]:
        """Poses with the shift of the image with which they look most like a surface."""
        seen, R, t = self.surfaces[surface], *(np.ascontiguousarray(each) for each in zip(*poses, strict=True))
        found = best_shifts(seen, R, t, self.shifts, self.searcher.camera, self.shown.much)
        work.done += ALIGNMENT + found.looked_up * SCANNED_POINT
        changes = np.zeros((len(poses), 6))
        changes[:, 4:] = np.arctan(found.shifts / self.searcher.f[:2])
        return [
            Alike(turned_about(*pose, pose.R @ seen.focus + pose.t, change), rarity(correlation, part))
            for pose, change, correlation, part in zip(poses, changes, found.correlation, found.part, strict=True)
        ]

    def aligned(
        self,
        pose: RigidMotion,
        work: Work,
        levels: Sequence[int] = (0, 1),
        iterations: int = ITERATIONS,
        every: int = 1,
    ) -> Alike:
        """The pose near one at which the image looks most like the surface that was seen from nearest to there."""
        surface, alike = self.surfaces[self.nearest(pose)], 0.0
        surface = surface if every == 1 else some_of(surface, np.s_[::every])
        for level in levels:
            image = self.shown[level]
            found = aligned_pose(surface, level, pose, iterations, self.searcher.steps, self.searcher.camera, image)
            pose, alike = found.pose, rarity(found.correlation, found.points / len(surface.points))
            work.done += ALIGNMENT + found.looked_up * ALIGNED_POINT
        return Alike(pose, alike)

    def nearest(self, pose: RigidMotion) -> int:
        """The surface that was seen from the direction nearest to that of a pose."""
        toward = centre_of(pose) - self.focus
        return int(np.argmax(np.einsum("ij,ij->i", toward, self.toward) / np.linalg.norm(toward, axis=1)))


def seen_from(surface: Surface) -> RigidMotion:
    """The pose of the camera that saw a surface."""
    return RigidMotion(surface.R, surface.t)


def rarity(correlation: float, part: float) -> float:
    """Powers of ten by which chance does not explain a correlation over a part of a surface.

    The logarithm of the likelihood ratio of normal samples with this correlation and without any.
    """
    return -0.5 * SHADES * part * math.log10(1.0 - max(0.0, min(correlation, MOST_ALIKE)) ** 2)
