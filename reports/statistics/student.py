"""The mean of a few independent values by Student's t: a bootstrap of so few is too narrow."""

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri, stdtr, stdtrit

from uavbench.trajectories.pose import Array

ROUNDING = 1e-12
"""Difference of two means that counts as round-off."""


@dataclass(frozen=True, kw_only=True)
class StudentMean:
    """A mean, its standard error, and its degrees of freedom; of a single value the error is NaN (Student 1908)."""

    mean: float
    error: float
    freedom: int

    @classmethod
    def of(cls, values: Array) -> "StudentMean":
        """Mean of independent values (n,), n >= 1."""
        n = len(values)
        error = float(values.std(ddof=1)) / np.sqrt(n) if n > 1 else float("nan")
        return cls(mean=float(values.mean()), error=error, freedom=n - 1)

    def bound(self, share: float) -> float:
        """Quantile at a share from 0 to 1 of where the true mean may be; NaN of a single value."""
        return self.mean + self.error * float(stdtrit(self.freedom, share)) if self.freedom else float("nan")

    def p_above(self, limit: float) -> float:
        """One-sided p of `the true mean is at most limit`; NaN of a single value."""
        above = self.mean - limit - ROUNDING
        if self.error == 0.0:
            return 0.0 if above > 0 else 1.0
        return float(stdtr(self.freedom, -above / self.error)) if self.freedom else float("nan")

    @property
    def p_two_sided(self) -> float:
        """Two-sided p of `the true mean is 0`; 1 of a single value."""
        if not self.freedom or self.mean == 0.0:
            return 1.0
        return 2.0 * float(stdtr(self.freedom, -abs(self.mean) / self.error)) if self.error else 0.0


def widening(n: int, tail: float) -> float:
    """Factor by which the interval of a mean of n values is wider than the normal one of many; tail: beyond one end."""
    return float(stdtrit(n - 1, tail) / ndtri(tail))
