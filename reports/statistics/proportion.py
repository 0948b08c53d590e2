"""A success rate with its interval."""

from dataclasses import dataclass

from uavbench.reports.statistics.bootstrap import CONFIDENCE


@dataclass(frozen=True, kw_only=True)
class Proportion:
    """Successes of n trials and the two-sided interval of their share (Wilson 1927)."""

    successes: int
    n: int
    low: float
    high: float

    @classmethod
    def of(cls, successes: int, n: int, confidence: float = CONFIDENCE) -> "Proportion":
        """Proportion with its Wilson interval; the interval is [0, 1] without a trial."""
        if n == 0:
            return cls(successes=0, n=0, low=0.0, high=1.0)
        from scipy.stats import binomtest  # lazy: takes a second, and most reports have no shares

        found = binomtest(successes, n).proportion_ci(confidence, method="wilson")
        return cls(successes=successes, n=n, low=float(found.low), high=float(found.high))

    @property
    def share(self) -> float:
        """Share of successes; 0 without a trial."""
        return self.successes / self.n if self.n else 0.0
