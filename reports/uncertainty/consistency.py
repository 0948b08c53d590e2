"""Summary of NEES values: mean, share within the central 95 %, and sharpness of the claimed covariances."""

from dataclasses import dataclass

import numpy as np
from scipy.special import gammaincinv

from uavbench.trajectories.pose import Array

DEGREES_OF_FREEDOM = 6
CENTRAL = (0.025, 0.975)
SINGULAR = 1e-14
"""Least eigenvalue of a correlation matrix above round-off (6 x 2^-52)."""


@dataclass(frozen=True, kw_only=True)
class Consistency:
    """NEES of the n frames whose covariance has an inverse; in the `singular` others that claim one it is undefined.

    mean (None where n is 0), and the interval in which the mean of a consistent tracker lies with 95 % probability if
    its errors are independent from frame to frame; inside: share of all n + singular frames in the central 95 % of the
    distribution; sharpness: median standard deviation of position (m) and of rotation (deg).
    """

    n: int
    mean: float | None
    low: float
    high: float
    inside: float
    sharpness_m: float
    sharpness_deg: float
    singular: int = 0


def chi_square_quantile(p: float, degrees: float) -> float:
    """The value that a chi-square distribution of `degrees` of freedom stays below with probability p in [0, 1]."""
    return float(2.0 * gammaincinv(degrees / 2.0, p))


def consistency_of(values: Array, variances: Array) -> Consistency | None:
    """NEES figures of values (n,) as `nees` has them, and of claimed variances (m, 6); None when none is claimed."""
    values = values[~np.isnan(values)]
    singular = int(np.isinf(values).sum())
    values = values[np.isfinite(values)]
    n = len(values)
    if n + singular == 0:
        return None
    low, high = (chi_square_quantile(p, DEGREES_OF_FREEDOM * max(n, 1)) / max(n, 1) for p in CENTRAL)
    inner_low, inner_high = (chi_square_quantile(p, DEGREES_OF_FREEDOM) for p in CENTRAL)
    return Consistency(
        n=n,
        mean=float(values.mean()) if n else None,
        low=low,
        high=high,
        inside=float(((values >= inner_low) & (values <= inner_high)).sum()) / (n + singular),
        sharpness_m=_median_sigma(variances[:, :3]),
        sharpness_deg=float(np.degrees(_median_sigma(variances[:, 3:]))),
        singular=singular,
    )


def _median_sigma(variances: Array) -> float:
    """Median over the rows (m, 3); a sum that is negative, which no covariance has, counts as 0."""
    with np.errstate(over="ignore"):  # of numbers near the largest
        return float(np.median(np.sqrt(np.maximum(variances.sum(axis=1), 0.0))))
