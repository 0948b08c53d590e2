"""How much an image looks, between the edges of a structure, as a run saw its surface."""

from collections.abc import Sequence

import numpy as np

from uavbench.tracker.geometry_kernels import RigidMotion
from uavbench.tracker.robust.relocalization.pose_arrays import centre_of
from uavbench.tracker.robust.relocalization.surfaces.aligner import rarity, seen_from
from uavbench.tracker.robust.relocalization.surfaces.alignment_kernels import AlignedPose, Surface, aligned_pose
from uavbench.tracker.robust.relocalization.surfaces.surface import MOST_POINTS, Shown, SurfaceReader, some_of
from uavbench.tracker.robust.work import ALIGNED_POINT, ALIGNMENT, Work

LEAST_SEEN = 40
"""Points of a surface that say whether it is seen: of fewer, one window is most."""
NEAREST = 3
"""Surfaces that are looked at for a pose, those seen from nearest to it: limits the time."""
UNSEEN = rarity(0.98, 1.0)
"""Powers of ten of a surface that was not seen before, or looks otherwise now: something may stand before it. Measured
on walls of brick, plaster and panels after a loss: at the right pose the correlation is 0.95 to 1, nearly always 0.99,
where windows look alike up to 0.98.
"""


class KnownSurfaces:
    """An image, and what a run saw between the edges of a structure before."""

    def __init__(self, reader: SurfaceReader, surfaces: Sequence[Surface], shown: Shown, work: Work) -> None:
        self.reader, self.searcher = reader, reader.searcher
        self.surfaces, self.shown, self.work = surfaces, shown, work
        self.focus = np.array([each.focus for each in surfaces]).reshape(-1, 3)
        self.centres = np.array([centre_of(seen_from(each)) for each in surfaces]).reshape(-1, 3)

    @staticmethod
    def cost(poses: int) -> int:
        """Most evaluations of looking at so many poses."""
        return poses * (NEAREST + 1) * (ALIGNMENT + MOST_POINTS * ALIGNED_POINT)

    def rarity(self, pose: RigidMotion) -> float:
        """Powers of ten by which chance does not explain how much the image looks from a pose as it did before.

        By the surface of which most is in view. It speaks for a pose, and never against one. Where what is made but
        once is in view, too, that has to look as before: of copies one may look as another.
        """
        most, seen = AlignedPose(pose, 0.0, LEAST_SEEN - 1, 0), None
        for k in self.nearest(pose):
            alike = self.likeness(self.surfaces[k], pose)
            if alike.points > most.points:
                most, seen = alike, self.surfaces[k]
        found = UNSEEN if seen is None else rarity(most.correlation, 1.0)
        if seen is not None and found > UNSEEN and self.reader.copied[seen.faces].any():
            alone = self.likeness(some_of(seen, ~self.reader.copied[seen.faces]), pose)
            if alone.points:
                found = min(found, rarity(alone.correlation, 1.0))
        return max(UNSEEN, found)

    def likeness(self, surface: Surface, pose: RigidMotion) -> AlignedPose:
        """How much the image looks from a pose as a surface did."""
        searcher = self.searcher
        alike = aligned_pose(surface, 1, pose, 0, searcher.steps, searcher.camera, self.shown.little)
        self.work.done += ALIGNMENT + alike.looked_up * ALIGNED_POINT
        return alike

    def nearest(self, pose: RigidMotion) -> list[int]:
        """The surfaces whose middle is in view at a pose, those seen from nearest to it first."""
        f, size = self.searcher.f, self.searcher.size
        ahead = self.focus @ pose.R.T + pose.t
        at = ahead[:, :2] / np.maximum(ahead[:, 2:], self.searcher.camera.near) * f[:2] + f[2:]
        seen = (ahead[:, 2] > self.searcher.camera.near) & ((at > -0.5) & (at < np.array(size) - 0.5)).all(axis=1)
        apart = np.linalg.norm(self.centres - centre_of(pose), axis=1)
        first = np.argsort(np.where(seen, apart, np.inf), kind="stable")[: min(NEAREST, np.count_nonzero(seen))]
        return [int(k) for k in first]
