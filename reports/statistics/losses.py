"""Whether a share became smaller by more than chance: exact permutation tests that few runs suffice for."""

from collections.abc import Sequence as ListOf
from itertools import combinations
from math import comb

import numpy as np

from uavbench.reports.statistics.bootstrap import FLIPS, sign_flip_p
from uavbench.reports.statistics.student import ROUNDING
from uavbench.trajectories.pose import Array
from uavbench.trajectories.random_streams import stream

WAYS = 2
"""Tests of one sequence, of which the one that finds more counts: the smaller p is doubled (Bonferroni)."""


def loss_p(base: ListOf[Array], head: ListOf[Array], *, seed: int = 0) -> float:
    """One-sided p of `the share did not become smaller`, of shares (n_s,) over seeds of each sequence, in pairs.

    Of several sequences by the signs of the pairs (`sign_flip_p`). Of one sequence, whose few pairs leave that test no
    small p, also by which of all its runs are the results' (`exchange_p`), and twice the smaller p of the two.
    """
    pairs = sign_flip_p(np.concatenate([b - h for b, h in zip(base, head, strict=True)]), seed=seed)
    if len(base) > 1:
        return pairs
    return min(1.0, WAYS * min(pairs, exchange_p(base[0], head[0], seed=seed)))


def exchange_p(base: Array, head: Array, *, seed: int = 0) -> float:
    """One-sided p of a permutation test: of n + n runs, the sum of the n that are the results' is this small by chance.

    Exact where all runs are exchangeable (Pitman 1937), and too large rather than too small where two runs on the same
    frames are more alike than others. All choices are counted, or FLIPS of them drawn where there are more.
    """
    both, n = np.concatenate([base, head]), len(head)
    limit = head.sum() + ROUNDING * np.abs(both).sum()
    if comb(2 * n, n) <= FLIPS:
        sums = both[np.array(list(combinations(range(2 * n), n)))].sum(axis=1)
        return float((sums <= limit).mean())
    rng = stream(seed, "statistics", "exchanges")
    drawn = rng.permuted(np.tile(both, (FLIPS, 1)), axis=1)[:, :n]
    return (1 + int((drawn.sum(axis=1) <= limit).sum())) / (1 + FLIPS)


def smallest_loss_p(sequences: int, seeds: int) -> float:
    """Smallest p of `loss_p`: every run lost more than any run of the baseline."""
    pairs = 0.5 ** (sequences * seeds)
    return pairs if sequences > 1 else min(1.0, WAYS * min(pairs, 1 / comb(2 * seeds, seeds)))
