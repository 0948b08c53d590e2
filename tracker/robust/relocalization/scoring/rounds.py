"""Rounds of scoring: blocks of poses around guesses, in slices over as many frames as all of them take.

Each slice goes on where the one before stopped: near the guesses, one after the other, and far from them.
"""

from itertools import product
from typing import NamedTuple

from uavbench.tracker.geometry_kernels import RigidMotion
from uavbench.tracker.robust.config.relocalization import FAR_VIEW_RAD, RelocalizationConfig
from uavbench.tracker.robust.relocalization.scoring.pose_search import Candidate, PoseSearch, Reach, Scored, grid
from uavbench.tracker.robust.relocalization.scoring.pose_search_kernels import Target
from uavbench.tracker.robust.work import Work

FAR_RANGE_PART, FAR_SHIFT_PART = 0.25, 0.3
"""Extent far from a guess of the relative range, and of shifts as a fraction of the image width. Limits the time of a
complete search as `FAR_VIEW_RAD` does.
"""
FAR_STEP_FACTOR = 2.0
"""Factor on the steps of roll and range far from a guess; the pattern search closes the gaps."""
BESIDE_TIMES = 2
"""Steps in which the viewing direction of the best pose is improved: the extent of a slow or lost frame's guess."""


class Turn(NamedTuple):
    """Rotation of a viewing direction relative to that of a guess."""

    azimuth_rad: float
    elevation_rad: float


class Around(NamedTuple):
    """What poses are scored against, and the guesses around which, the most likely one first."""

    target: Target
    guesses: list[RigidMotion]


class Rounds:
    """Scores poses near guesses and far from them in turn, and counts the work."""

    def __init__(self, searcher: PoseSearch, config: RelocalizationConfig) -> None:
        self.searcher, step = searcher, config.search
        near = Reach(config.near_part, config.near_part, config.near_part)
        far_roll_rad = FAR_STEP_FACTOR * step.step_part  # one step to either side
        far = Reach(far_roll_rad, FAR_RANGE_PART, FAR_SHIFT_PART, FAR_STEP_FACTOR)
        self.near_block = searcher.block(0.0, 0.0, near)
        turns = views(FAR_VIEW_RAD, FAR_VIEW_RAD / 2, step.view_step_rad)
        self.far_blocks = [searcher.block(*turn, far) for turn in turns]
        nearest = Reach(step.step_part, step.step_part, step.truncation_px / searcher.size[0])
        turn = searcher.turn_rad
        sides = (Turn(turn, 0.0), Turn(-turn, 0.0), Turn(0.0, turn), Turn(0.0, -turn))
        self.sides = [searcher.block(*side, nearest) for side in sides]
        self.begin()

    def begin(self) -> None:
        """Begin with the first block."""
        self.next_guess = self.next_near = self.next_block = self.next_far = 0

    @property
    def least(self) -> int:
        """Evaluations below which no pose of a block is scored: its visible edges have to be found before."""
        return 2 * self.searcher.sampling

    def is_complete(self, guesses: int) -> bool:
        """Whether all poses far from so many guesses were scored."""
        return self.next_block >= guesses * len(self.far_blocks)

    def near(self, around: Around, work: Work, until: int) -> list[Candidate]:
        """The best poses near the guesses, best first: each guess in turn, as far as the work allows."""
        found: list[Candidate] = []
        for _ in around.guesses:
            if until - work.done < self.least:
                break
            guess = around.guesses[self.next_guess % len(around.guesses)]
            rest = self.near_block.after(self.next_near)
            scored = self.searcher.best_of(around.target, guess, rest, until - work.done)
            found += taken(scored, work)
            self.next_near += scored.poses
            if self.next_near < len(self.near_block.changes):
                break
            self.next_guess, self.next_near = self.next_guess + 1, 0
        return best_first(found)

    def beside(self, near: list[Candidate], target: Target, work: Work, until: int) -> list[Candidate]:
        """Poses, best first, and those whose viewing direction is turned to the sides of the best one's."""
        for _ in range(BESIDE_TIMES):
            room = until - work.done >= len(self.sides) * self.searcher.most_of(self.sides[0])
            found = [
                each
                for side in (self.sides if near and room else ())
                for each in taken(self.searcher.best_beside(target, near[0], side, until - work.done), work)[:1]
            ]
            near = best_first(near + found)
        return near

    def far(self, around: Around, work: Work, until: int) -> list[Candidate]:
        """The best poses far from the guesses, as far as the work allows: the nearest viewing directions first."""
        found: list[Candidate] = []
        while not self.is_complete(len(around.guesses)) and until - work.done >= self.least:
            view, guess = divmod(self.next_block, len(around.guesses))
            rest = self.far_blocks[view].after(self.next_far)
            scored = self.searcher.best_of(around.target, around.guesses[guess], rest, until - work.done)
            found += taken(scored, work)
            self.next_far += scored.poses
            if scored.poses < len(rest.changes):
                break
            self.next_block, self.next_far = self.next_block + 1, 0
        return found


def taken(scored: Scored, work: Work) -> list[Candidate]:
    """The candidates that were scored, whose work is counted."""
    work.done += scored.evaluations
    return scored.candidates


def best_first(candidates: list[Candidate]) -> list[Candidate]:
    """Candidates by descending score."""
    return sorted(candidates, key=lambda each: -each.score)


def views(azimuth_rad: float, elevation_rad: float, step: float) -> list[Turn]:
    """Rotations to the viewing directions as far as these from a guess, at most a step (rad) apart, nearest first."""
    turns = map(Turn._make, product(grid(azimuth_rad, step), grid(elevation_rad, step)))
    return sorted(turns, key=lambda turn: turn.azimuth_rad**2 + turn.elevation_rad**2)
