"""What the gate decides on: a paired hierarchical bootstrap, a sign-flip test, and Holm's correction."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from trajectories.pose import Array
from trajectories.streams import stream

REPLICATES = 20_000
CHUNK = 2_000
MAX_KEPT = 1_000
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


def hierarchical_bootstrap(differences: list[Array], *, alpha: float = 0.05, seed: int = 0) -> Paired:
    """Bootstrap of the mean over sequences of the mean over seeds; differences[s] (k_s,) are of sequence s.

    Each replicate draws sequences, then seeds within each, with replacement (Davison & Hinkley 1997, 3.8). low and
    high are the one-sided 1 - alpha bounds. The spread over s sequences is widened by sqrt(s / (s - 1)) about the mean,
    for the plain bootstrap's variance of a mean of s is short by (s - 1) / s.
    """
    sizes = tuple(len(d) for d in differences)
    mean = float(np.mean([d.mean() for d in differences]))
    values = np.concatenate(differences)
    weights = _kept_weights if len(values) <= MAX_KEPT else _weights
    means = np.concatenate([weights(sizes, seed, chunk) @ values for chunk in range(REPLICATES // CHUNK)])
    if len(differences) > 1:
        means = mean + (means - mean) * np.sqrt(len(differences) / (len(differences) - 1))
    means.sort()
    low, high = np.quantile(means, [alpha, 1 - alpha]).tolist()
    return Paired(mean=mean, low=low, high=high, replicates=means)


def _weights(sizes: tuple[int, ...], seed: int, chunk: int) -> Array:
    """Weight (CHUNK, n) of each of the n = sum(sizes) values in each replicate; rows sum to 1."""
    rng = stream(seed, "gate", "bootstrap", chunk)
    size, first = np.array(sizes), np.cumsum([0, *sizes[:-1]])
    drawn = rng.integers(len(sizes), size=(CHUNK, len(sizes)))
    picks = np.floor(rng.random((*drawn.shape, max(sizes))) * size[drawn][..., None]).astype(np.int64)
    column = first[drawn][..., None] + picks
    share = np.where(np.arange(max(sizes)) < size[drawn][..., None], 1.0 / (size[drawn] * len(sizes))[..., None], 0.0)
    cell = np.arange(CHUNK)[:, None, None] * sum(sizes) + column
    weights: Array = np.bincount(cell.ravel(), share.ravel(), CHUNK * sum(sizes)).astype(np.float64)
    return weights.reshape(CHUNK, sum(sizes))


_kept_weights = lru_cache(maxsize=REPLICATES // CHUNK)(_weights)
"""The same for the next metric: it has the same sequences and seeds."""


def sign_flip_p(differences: Array, *, seed: int = 0) -> float:
    """One-sided p of `the differences are as likely up as down` against a mean above zero (Fisher 1935).

    Exact in what it assumes: exchanging the two sides of a pair changes nothing.
    """
    moved = differences[differences != 0]
    if not len(moved):
        return 1.0
    signs = stream(seed, "gate", "signs").choice([-1.0, 1.0], size=(REPLICATES, len(moved)))
    as_large = int((signs @ np.abs(moved) >= moved.sum() - 1e-12 * np.abs(moved).sum()).sum())
    return (1 + as_large) / (1 + REPLICATES)


def holm(p_values: list[float]) -> list[float]:
    """Adjusted p-values in the given order (Holm 1979): each is to be held against the level for the whole family."""
    order = np.argsort(p_values, kind="stable")
    adjusted = np.empty(len(p_values))
    running = 0.0
    for rank, index in enumerate(order):
        running = max(running, min(1.0, (len(p_values) - rank) * p_values[index]))
        adjusted[index] = running
    return adjusted.tolist()
