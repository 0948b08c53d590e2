"""Doubts about a first pose that a search found: poses around it are fitted as if nothing were known of the edges.

A track confirms itself, since the appearance of the edges is learned where they are thought to be. Poses are therefore
compared by a fitter that has learned nothing.
"""

from uavbench.tracker.protocol import Image
from uavbench.tracker.robust.edge_fit import EdgeFitter
from uavbench.tracker.robust.motion_model import isotropic_covariance
from uavbench.tracker.robust.pose_fit import Fit
from uavbench.tracker.robust.relocalization.pose_arrays import motion
from uavbench.tracker.robust.relocalization.pose_search import PoseSearch
from uavbench.tracker.stage_clock import StageClock
from uavbench.trajectories.pose import Pose

ENOUGH = 32
"""Poses tried in vain around one after which it is not doubted any more. Measured on 264 wrong initial poses: with 16,
three wrong poses of nine are kept, with 32 none."""
MOST_FRAMES = 15
"""Frames after which a pose is not doubted any more, where their budgets are too small for so many fits."""


class Doubts:
    """Poses around a tracked one, fitted without memory in as many frames as that takes."""

    def __init__(self, fitter: EdgeFitter, searcher: PoseSearch) -> None:
        self.fitter, self.searcher, self.config = fitter, searcher, fitter.config.relocalization
        self.innocent = fitter.without_memory()
        self.tried = self.in_vain = self.frames = 0

    @property
    def settled(self) -> bool:
        """Whether enough poses were tried around the present one."""
        return self.in_vain >= ENOUGH or self.frames >= MOST_FRAMES

    def better(self, image: Image, fit: Fit, range_m: float) -> Fit | None:
        """A fit with clearly more support than the given one, both without memory; None if none is found.

        It spends what is left of the frame's budget.
        """
        innocent, clock, config = self.innocent, StageClock(), self.config
        innocent.work, innocent.most_points = self.fitter.work, self.fitter.most_points
        self.frames += 1
        if not innocent.has_room_for(2):
            return None
        known = isotropic_covariance(innocent.config.initialization.sigma, range_m)
        base = best = innocent.searched(image, fit.cam_from_world, known, clock, config.refit_half_px)
        if base.focus is None:
            return None
        wide = isotropic_covariance(config.found_sigma, range_m)
        while innocent.has_room_for(1) and not self.settled:
            self.in_vain, self.tried = self.in_vain + 1, self.tried + 1
            pose = Pose(*self.searcher.nearby(motion(fit.cam_from_world), base.focus, self.tried))
            found = innocent.searched(image, pose, wide, clock, config.half_px)
            if found.finite and found.support > best.support:
                best = found
        by_chance = best.log10_false_alarms(1) >= innocent.config.loss.log10_false_alarms
        if by_chance or best.support <= base.support + config.lead_of_rivals:
            return None
        self.in_vain = self.frames = 0
        return best
