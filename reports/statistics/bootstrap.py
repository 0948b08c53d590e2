"""Uncertainty of scores over sequences and seeds, and whether one tracker beats another.

Conventions: values are given per sequence as arrays over seeds; a sequence weighs the same however many seeds it has.
Trackers are compared in pairs on the same sequences and seeds. Lower is better unless said otherwise.
"""

from collections.abc import Mapping
from collections.abc import Sequence as ListOf
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from uavbench.reports.statistics.student import ROUNDING, StudentMean, widening
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.pose import Array
from uavbench.trajectories.random_streams import stream

REPLICATES = 4000
CONFIDENCE = 0.95
LEAST_UNITS = 3
"""Fewest independent units of an interval: with two, a 95 % bootstrap interval covers the true value in 61 %."""
FLIPS = 20_000


@dataclass(frozen=True, kw_only=True)
class Interval:
    """A mean of n values with its two-sided interval; NaN bounds where it is undefined, with the reason in `why`."""

    mean: float
    low: float
    high: float
    n: int
    why: str = ""


@dataclass(frozen=True, kw_only=True, eq=False)
class Bootstrap:
    """The mean over sequences of the mean over seeds, and its bootstrap replicates (b,), sorted."""

    mean: float
    replicates: Array

    @classmethod
    def of(cls, values: ListOf[Array], *, seed: int = 0, rounds: int = 1) -> "Bootstrap":
        """Bootstrap of values (n_s,) of each sequence, with rounds * REPLICATES replicates.

        Each replicate draws sequences, then seeds within each, with replacement (Davison & Hinkley 1997, section 3.8).
        The spread over s sequences is widened by sqrt(s / (s - 1)), by which a plain bootstrap underestimates it. With
        one sequence only its seeds are drawn, and the result holds for that sequence. UserError when there is no
        sequence, or one without values.
        """
        if not values or any(not len(v) for v in values):
            raise UserError("statistics need at least one value per sequence")
        mean = float(np.mean([v.mean() for v in values]))
        sizes, flat = tuple(len(v) for v in values), np.concatenate(values)
        means = np.sort(np.concatenate([_weights(sizes, seed + k) @ flat for k in range(rounds)]))
        s = len(values) if len(values) > 1 else len(flat)
        return cls(mean=mean, replicates=mean + (means - mean) * np.sqrt(s / (s - 1)) if s > 1 else means)

    def bound(self, share: float) -> float:
        """Quantile of the replicates, share from 0 to 1."""
        return float(np.quantile(self.replicates, share))

    def p_above(self, limit: float) -> float:
        """One-sided p of `the mean is at most limit`: share of the replicates at or below it, never 0."""
        at_or_below = int(np.searchsorted(self.replicates, limit + ROUNDING, side="right"))
        return (1 + at_or_below) / (1 + len(self.replicates))


def units(values: ListOf[Array]) -> Array:
    """Independent observations (n,): the means of the sequences, or the runs where there is only one sequence."""
    return np.array([v.mean() for v in values]) if len(values) > 1 else np.asarray(values[0])


def least_units(comparisons: int = 1) -> int:
    """Fewest pairs with which a two-sided sign-flip test reaches the 5 % level after Holm over `comparisons` tests."""
    n = 1
    while comparisons * smallest_p(n) > 1 - CONFIDENCE:
        n += 1
    return n


def smallest_p(n: int) -> float:
    """Smallest two-sided p of a sign-flip test: all n pairs differ in the same direction (Fisher 1935)."""
    return min(1.0, 2.0 ** (1 - n))


def hierarchical_interval(values: ListOf[Array], *, confidence: float = CONFIDENCE, seed: int = 0) -> Interval:
    """Two-sided bootstrap interval of the mean over sequences of the mean over seeds (n_s,).

    It is widened as Student's is over the normal one, since a bootstrap of few units is too narrow. NaN bounds for
    fewer than LEAST_UNITS units, and when all are equal: their spread is unknown. UserError when there is no sequence,
    or one without values.
    """
    found, n = Bootstrap.of(values, seed=seed), sum(len(v) for v in values)
    independent = units(values)
    what = "sequence" if len(values) > 1 else "run"
    why = ""
    if len(independent) < LEAST_UNITS:
        why = f"{len(independent)} {what}{'s' if len(independent) > 1 else ''}, {LEAST_UNITS} are needed"
    elif np.ptp(independent) <= ROUNDING * np.abs(independent).max():
        why = f"the values of all {len(independent)} {what}s are equal"
    if why:
        return Interval(mean=found.mean, low=float("nan"), high=float("nan"), n=n, why=why)
    tail = (1 - confidence) / 2
    wider = widening(len(independent), tail)
    low, high = (found.mean + wider * (found.bound(share) - found.mean) for share in (tail, 1 - tail))
    return Interval(mean=found.mean, low=low, high=high, n=n)


def sign_flip_p(differences: Array, *, seed: int = 0) -> float:
    """One-sided p of a sign-flip test: differences (n,) symmetric about zero, or their mean above zero (Fisher 1935).

    Exact under exchangeability within pairs. Not scipy.stats.permutation_test: it enumerates small samples and draws
    the signs of large ones in another order, so that every published p would change.
    """
    moved = differences[differences != 0]
    if not len(moved):
        return 1.0
    signs = stream(seed, "statistics", "signs").choice([-1.0, 1.0], size=(FLIPS, len(moved)))
    as_large = int((signs @ np.abs(moved) >= moved.sum() - ROUNDING * np.abs(moved).sum()).sum())
    return (1 + as_large) / (1 + FLIPS)


@lru_cache(maxsize=32)
def _weights(sizes: tuple[int, ...], seed: int) -> Array:
    """Weight (REPLICATES, n) of each value in each replicate, a weighted sum; equal sizes and seeds share the draws."""
    rng = stream(seed, "statistics", "bootstrap")
    drawn = rng.integers(len(sizes), size=(REPLICATES, len(sizes)))
    size, first = np.array(sizes), np.concatenate([[0], np.cumsum(sizes)[:-1]])
    weights = np.zeros((REPLICATES, sum(sizes)))
    for k in range(max(sizes)):
        chosen = (rng.random(drawn.shape) * size[drawn]).astype(np.int64) + first[drawn]
        share = np.where(k < size[drawn], 1.0 / (size[drawn] * len(sizes)), 0.0)
        np.add.at(weights, (np.arange(REPLICATES)[:, None], chosen), share)
    weights.setflags(write=False)
    return weights


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """Paired comparison of two trackers.

    difference: mean of first minus second, with its interval; p: two-sided, adjusted by Holm in a table; wins: share of
    pairs in which the first is lower, ties counted half; units: number of independent pairs that differ.
    """

    first: str
    second: str
    difference: Interval
    p: float
    wins: float
    units: int = 0

    @property
    def significant(self) -> bool:
        """Whether the difference is significant at the 5 % level; a NaN is not."""
        return self.p <= 1 - CONFIDENCE


def compare_pairs(values: Mapping[str, ListOf[Array]], *, seed: int = 0) -> list[Comparison]:
    """Every pair of trackers, compared on the same sequences and seeds; p adjusted by Holm over all pairs.

    UserError when two trackers have values for different sequences or seeds.
    """
    names = list(values)
    pairs = [(first, second) for a, first in enumerate(names) for second in names[a + 1 :]]
    return _adjusted([compare(first, second, values, seed) for first, second in pairs])


def compare_each(pairs: ListOf[Mapping[str, ListOf[Array]]], *, seed: int = 0) -> list[Comparison]:
    """Pairs of trackers, each with values of its own, as over the frames that both have; p adjusted by Holm over all.

    UserError when the two of a pair have values for different sequences or seeds.
    """
    return _adjusted([compare(first, second, values, seed) for values in pairs for first, second in [list(values)]])


def compare_with(first: str, values: Mapping[str, ListOf[Array]], *, seed: int = 0) -> list[Comparison]:
    """One tracker against every other, on the same sequences and seeds; p adjusted by Holm over these comparisons.

    UserError when two trackers have values for different sequences or seeds.
    """
    return _adjusted([compare(first, second, values, seed) for second in values if second != first])


def compare(first: str, second: str, values: Mapping[str, ListOf[Array]], seed: int = 0) -> Comparison:
    """Two trackers on the same sequences and seeds, p not adjusted; UserError when these differ.

    p is the bootstrap's, but at least that of Student's t on the independent pairs, as a bootstrap of few is too
    narrow, and `smallest_p` of the number of those that differ. Pairs with the same two values count once: they may be
    one flight under two names.
    """
    sizes = [[len(v) for v in values[name]] for name in (first, second)]
    if sizes[0] != sizes[1]:
        raise UserError(f"{first} and {second} were not run on the same sequences and seeds: {sizes}")
    differences = [x - y for x, y in zip(values[first], values[second], strict=True)]
    flat = np.concatenate(differences)
    means = Bootstrap.of(differences, seed=seed).replicates
    beyond = min(int((means <= 0).sum()), int((means >= 0).sum()))
    pairs = np.unique(np.column_stack([units(values[first]), units(values[second])]), axis=0)
    apart = pairs[:, 0] - pairs[:, 1]
    n = int(np.count_nonzero(apart))
    by_student = StudentMean.of(apart).p_two_sided
    return Comparison(
        first=first,
        second=second,
        difference=hierarchical_interval(differences, seed=seed),
        p=max(min(1.0, 2 * (1 + beyond) / (1 + REPLICATES)), by_student, smallest_p(n)),
        wins=float(((flat < 0) + 0.5 * (flat == 0)).mean()),
        units=n,
    )


def _adjusted(found: list[Comparison]) -> list[Comparison]:
    return [replace(c, p=p) for c, p in zip(found, holm([c.p for c in found]), strict=True)]


def holm(p_values: ListOf[float]) -> list[float]:
    """P-values adjusted for multiple comparisons, in the given order (Holm 1979)."""
    adjusted = [0.0] * len(p_values)
    running = 0.0
    for rank, index in enumerate(sorted(range(len(p_values)), key=lambda k: p_values[k])):
        running = max(running, min(1.0, (len(p_values) - rank) * p_values[index]))
        adjusted[index] = running
    return adjusted


@dataclass(frozen=True, kw_only=True)
class Ranks:
    """Mean rank of each tracker over n blocks (1 is best), Nemenyi's critical difference, and the p of Friedman's test.

    With too few blocks for a test the difference is infinite, and p is NaN; p is NaN for two trackers, too.
    """

    mean_ranks: dict[str, float]
    critical_difference: float
    p: float
    n: int

    @property
    def cliques(self) -> list[tuple[str, ...]]:
        """Groups of neighbouring trackers that differ by the critical difference at most."""
        order = sorted(self.mean_ranks, key=lambda name: self.mean_ranks[name])
        groups: list[tuple[str, ...]] = []
        for i, name in enumerate(order):
            near = [o for o in order[i:] if self.mean_ranks[o] - self.mean_ranks[name] <= self.critical_difference]
            if len(near) > 1 and not any(set(near) <= set(group) for group in groups):
                groups.append(tuple(near))
        return groups


def ranks(values: Mapping[str, Array], confidence: float = CONFIDENCE) -> Ranks:
    """Ranks of k >= 2 trackers by values (n,) over n >= 2 blocks, infinite for failed runs (Demšar 2006, 3.2.2).

    UserError with fewer trackers or blocks.
    """
    table = np.array(list(values.values())).T
    n, k = table.shape
    if n < 2 or k < 2:
        raise UserError(f"ranks need at least two trackers and two runs each, got {k} and {n}")
    from scipy.stats import friedmanchisquare, rankdata, studentized_range  # lazy: it takes a second

    row_ranks = np.array([rankdata(row) for row in table])
    enough = len(np.unique(table, axis=0)) >= least_units()
    q = float(studentized_range.ppf(confidence, k, np.inf)) / np.sqrt(2)
    p = float(friedmanchisquare(*row_ranks.T).pvalue) if k > 2 and enough else float("nan")
    return Ranks(
        mean_ranks=dict(zip(values, row_ranks.mean(axis=0).tolist(), strict=True)),
        critical_difference=float(q * np.sqrt(k * (k + 1) / (6 * n))) if enough else float("inf"),
        p=p,
        n=n,
    )
