"""Overview after a loss: poses from all sides of the guesses, in so little detail that they take a few frames."""

import math

import numpy as np

from uavbench.scenes.camera import Camera
from uavbench.tracker.geometry_kernels import RigidMotion
from uavbench.tracker.protocol import Image
from uavbench.tracker.robust.fit.edge_fit import EdgeFitter
from uavbench.tracker.robust.relocalization.pose_arrays import distinct
from uavbench.tracker.robust.relocalization.scoring.pose_search import (
    ANY_WORK,
    CANDIDATES,
    COARSE,
    Candidate,
    PoseSearch,
    Reach,
)
from uavbench.tracker.robust.relocalization.scoring.pose_search_kernels import Target
from uavbench.tracker.robust.relocalization.scoring.rounds import Around, best_first, taken, views
from uavbench.tracker.robust.work import COARSE_DISTANCES, Work

STEP_RAD = 0.08 * math.pi
"""Step of azimuth and elevation. Half of it is within the reach of a pattern search: of 32 views of boxes and a
building, up to 57 degrees beside the guess, 30 were among the best 16, as with smaller steps."""
AZIMUTH_RAD, ELEVATION_RAD = 5 * STEP_RAD, STEP_RAD
"""Extent of azimuth and elevation: less than a quarter of a turn, beyond which a box looks like itself."""
RANGE_PART, SHIFT_PART = 0.3, 0.4
"""Extent of the relative range, and of shifts as a fraction of the image width. With half of the range boxes in the
background were found in place of the structure."""
APART_PART = 2 * STEP_RAD
"""Distance, as a part of the range and in rad, of guesses about which views are looked at."""
OF_A_VIEW = 2
"""Poses kept of a view."""


class Overview:
    """Scores poses from all sides of guesses in a coarse image, the nearest views first, in slices over frames."""

    def __init__(self, fitter: EdgeFitter, camera: Camera, fine: PoseSearch) -> None:
        self.fine = fine
        self.coarse = PoseSearch(fitter.edges, camera, fitter.view.near, fitter.config, COARSE)
        reach = Reach(self.coarse.step_part, RANGE_PART, SHIFT_PART)
        self.blocks = [self.coarse.block(*turn, reach) for turn in views(AZIMUTH_RAD, ELEVATION_RAD, STEP_RAD)]
        low, high = (bound(fitter.edges.ends.reshape(-1, 3), axis=0) for bound in (np.min, np.max))
        self.middle, self.radius_m = (low + high) / 2.0, float(np.linalg.norm(high - low)) / 2.0
        half_view = math.atan(0.5 * float(np.min(self.coarse.camera.size_px / self.coarse.f[:2])))
        self.least_range_m = self.radius_m / math.sin(half_view)
        self.begin()

    def begin(self) -> None:
        """Begin with the nearest views."""
        self.next_block = 0

    def is_complete(self, guesses: int) -> bool:
        """Whether all views about so many guesses were scored."""
        return self.next_block >= guesses * len(self.blocks)

    def back_m(self, guess: RigidMotion) -> float:
        """How much farther away a guess has to be for the whole structure to fit into an image taken from there.

        Of a part of it other sides show other parts, which no shift of the image brings into view.
        """
        return max(0.0, self.least_range_m - float(np.linalg.norm(guess.R @ self.middle + guess.t)))

    def from_afar(self, guess: RigidMotion) -> RigidMotion:
        """A guess, moved back along its line of sight to the middle of the structure as far as it has to be."""
        back_m, middle = self.back_m(guess), guess.R @ self.middle + guess.t
        return RigidMotion(guess.R, guess.t + middle * (back_m / np.linalg.norm(middle)))

    def found(self, image: Image, around: Around, range_m: float, work: Work, until: int) -> list[Candidate]:
        """The best poses of as many views as the work allows, as candidates of the search in the small image."""
        guesses, each = around.guesses, self.most_of_a_candidate // 2  # it takes less
        room, view = until - work.done - COARSE_DISTANCES, self.coarse.most_of(self.blocks[0])
        if self.is_complete(len(guesses)) or room < view + view // 2 + each:
            return []
        least = view + min(CANDIDATES * each, room // 4)
        work.done += COARSE_DISTANCES + len(guesses) * self.coarse.sampling
        target = self.coarse.target(image, math.inf)
        seen = [Candidate(0.0, guess, self.coarse.seen(guess)) for guess in guesses]
        found: list[Candidate] = []
        while not self.is_complete(len(guesses)) and until - work.done >= least:
            k, guess = divmod(self.next_block, len(guesses))
            pose = self.coarse.turned(seen[guess], self.blocks[k])
            of_view = self.coarse.best_there(target, pose, self.coarse.seen(pose), self.blocks[k], ANY_WORK)
            found += taken(of_view, work)[:OF_A_VIEW]
            self.next_block += 1
        some = max(1, (until - work.done) // each)
        return self.in_detail(best_first(found)[: min(some, CANDIDATES)], target, around, range_m, work)

    def in_detail(
        self, candidates: list[Candidate], target: Target, around: Around, range_m: float, work: Work
    ) -> list[Candidate]:
        """Candidates refined in the coarse image, and scored in the small one, shifted by no more than a step."""
        refined = best_first([taken(self.coarse.refined(target, each), work)[0] for each in candidates])
        found: list[Candidate] = []
        for pose in distinct([each.pose for each in refined], range_m, self.fine.step_part):
            work.done += self.fine.sampling
            found += taken(self.fine.again(around.target, Candidate(0.0, pose, self.fine.seen(pose))), work)
        return found

    @property
    def most_of_a_candidate(self) -> int:
        """Most evaluations of refining a pose and scoring it in the small image."""
        return self.coarse.most_refining(2 * self.coarse.points) + self.fine.sampling + self.fine.most_again
