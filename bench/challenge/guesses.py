"""How well a flight can be guessed from the suite's file alone, by flying the same path under other seeds.

A deterministic path, such as an orbit of given radius, is told by the file: no secret seed hides it.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from uavbench.reports.scoring.points import hilti_score
from uavbench.scenes.scene import obstacles_of
from uavbench.scenes.spec import SequenceSpec
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.pose import Array
from uavbench.trajectories.simulation.flight import fly
from uavbench.trajectories.trajectory import Trajectory

GUESSED_SEEDS = range(3)
MOST_POINTS_GUESSED = 10.0
"""Largest score of a guess, of 100 points; a tracker that locates every frame within 10 cm has 15."""


def points_guessed(spec: SequenceSpec, truth: Trajectory) -> float:
    """Advantage in score points of the best guess over repeating the initial pose; at least 0.

    truth is `world_from_body` at each frame.
    A guess is a flight under one of GUESSED_SEEDS, as it is or moved so that it begins at the true first pose.
    """
    held = hilti_score(np.linalg.norm(truth.positions_m - truth.positions_m[0], axis=1))
    return max(
        (hilti_score(errors) - held for seed in GUESSED_SEEDS for errors in _errors(spec, truth, seed)), default=0.0
    )


def _errors(spec: SequenceSpec, truth: Trajectory, seed: int) -> Iterator[Array]:
    """Errors (n,) in m at each frame of the truth of the guesses with a seed; none where it has no flight."""
    other = replace(spec, seed=seed)
    try:
        flight = fly(other.flight, other.mount, obstacles_of(other), other.seed)
    except UserError:
        return
    guess = Trajectory(flight.stamps_ns, flight.positions_m, flight.quaternions_wxyz)
    rows = np.clip(np.searchsorted(guess.stamps_ns, truth.stamps_ns), 0, len(guess) - 1)
    positions = guess.positions_m[rows]
    there = truth.stamps_ns <= guess.stamps_ns[-1]
    true_from_guess = truth.pose(0) @ guess.pose(int(rows[0])).inverse()
    for moved in (positions, true_from_guess.transform(positions)):
        yield np.where(there, np.linalg.norm(moved - truth.positions_m, axis=1), np.inf)


def refuse_guessed(spec: SequenceSpec, truth: Trajectory) -> None:
    """UserError when a flight can be guessed from the suite's file with more than MOST_POINTS_GUESSED points."""
    points = points_guessed(spec, truth)
    if points > MOST_POINTS_GUESSED:
        raise UserError(
            f"sequence {spec.name}: flying the suite's file under other seeds earns {points:.0f} points of 100 more "
            "than repeating the initial pose: its path depends on the seed too little; take one that does "
            "(`hand-pilot`), or add --private-suite if no participant will see the file"
        )
