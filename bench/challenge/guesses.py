"""How well a flight can be guessed from the suite's file alone, by flying the same path with other seeds.

A deterministic path, such as an orbit of given radius, is fully specified by the file: a secret seed cannot hide it.
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
"""Largest accepted advantage of a guess, of 100 points; a tracker with errors of up to 10 cm scores 15."""


def points_guessed(spec: SequenceSpec, truth: Trajectory) -> float:
    """Advantage in score points of the best guess over repeating the initial pose; at least 0.

    truth: `world_from_body` at each frame. A guess is a flight with one of GUESSED_SEEDS, either unchanged or aligned
    with the true pose at the first frame.
    """
    held = hilti_score(np.linalg.norm(truth.positions_m - truth.positions_m[0], axis=1))
    return max(
        (hilti_score(errors) - held for seed in GUESSED_SEEDS for errors in _errors(spec, truth, seed)), default=0.0
    )


def _errors(spec: SequenceSpec, truth: Trajectory, seed: int) -> Iterator[Array]:
    """Position errors (n,) in m of the two guesses with a seed at each frame; none if no flight exists for the seed."""
    other = replace(spec, seed=seed)
    try:
        flight = fly(other.flight, other.mount.at_rest, obstacles_of(other), other.seed)
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
    """Raise UserError when guessing a flight from the suite's file earns more than MOST_POINTS_GUESSED points."""
    points = points_guessed(spec, truth)
    if points > MOST_POINTS_GUESSED:
        raise UserError(
            f"sequence {spec.name}: a flight of the suite's file with another seed earns {points:.0f} of 100 points "
            "more than repeating the initial pose: the path depends too little on the seed; use one that depends on it "
            "more (`hand-pilot`), or add --private-suite if no participant will see the file"
        )
