"""What the gate decides on: a paired hierarchical bootstrap and a sign-flip test."""

from dataclasses import dataclass

import numpy as np

from reports.statistics import replicates
from trajectories.pose import Array
from trajectories.streams import stream

ROUNDS = 5
"""Draws of the bootstrap, so that its smallest p stands a correction over many metrics."""
FLIPS = 20_000
ROUNDING = 1e-12


@dataclass(frozen=True, kw_only=True)
class Paired:
    """Mean of paired differences with the bounds of two one-sided intervals; replicates (b,) are sorted means."""

    mean: float
    low: float
    high: float
    replicates: Array

    def p_above(self, limit: float) -> float:
        """Evidence against `the mean is at most limit`: share of replicates at or below it, never 0."""
        at_or_below = int(np.searchsorted(self.replicates, limit + ROUNDING, side="right"))
        return (1 + at_or_below) / (1 + len(self.replicates))


def hierarchical_bootstrap(differences: list[Array], *, alpha: float = 0.05) -> Paired:
    """Bootstrap of the mean over sequences of the mean over seeds; differences[s] (k_s,) are of sequence s.

    low and high are the one-sided 1 - alpha bounds.
    """
    means = np.sort(np.concatenate([replicates(differences, seed) for seed in range(ROUNDS)]))
    low, high = np.quantile(means, [alpha, 1 - alpha]).tolist()
    mean = float(np.mean([d.mean() for d in differences]))
    return Paired(mean=mean, low=low, high=high, replicates=means)


def sign_flip_p(differences: Array, *, seed: int = 0) -> float:
    """One-sided p of `the differences are as likely up as down` against a mean above zero (Fisher 1935).

    Exact in what it assumes: exchanging the two sides of a pair changes nothing.
    """
    moved = differences[differences != 0]
    if not len(moved):
        return 1.0
    signs = stream(seed, "gate", "signs").choice([-1.0, 1.0], size=(FLIPS, len(moved)))
    as_large = int((signs @ np.abs(moved) >= moved.sum() - ROUNDING * np.abs(moved).sum()).sum())
    return (1 + as_large) / (1 + FLIPS)
