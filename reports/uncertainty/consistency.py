"""Summary of NEES values: mean, share within the central 95 % interval, and sharpness of the claimed covariances."""

from dataclasses import dataclass

import numpy as np
from scipy.special import gammaincinv

from uavbench.trajectories.pose import Array

DEGREES_OF_FREEDOM = 6
CENTRAL = (0.025, 0.975)
SINGULAR = 1e-14
"""Smallest eigenvalue of a correlation matrix (6, 6) that is clearly above round-off (6 x 2^-52)."""


@dataclass(frozen=True, kw_only=True)
class Consistency:
    """NEES of the n frames with a regular covariance; singular: number of frames with a singular one.

    mean: None when n is 0; low, high: 95 % interval of the mean of a consistent tracker with independent errors;
    inside: share of the n + singular frames within the central 95 % of chi-square with 6 degrees of freedom;
    sharpness_*: median standard deviation of position and of rotation.
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
    """Quantile at p in [0, 1] of the chi-square distribution with a number of degrees of freedom."""
    return float(2.0 * gammaincinv(degrees / 2.0, p))


def consistency_of(values: Array, variances: Array) -> Consistency | None:
    """Summary of NEES (n,) as `nees` returns it, and of claimed variances (m, 6) in m^2 and rad^2; None without any."""
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
    """Median over rows (m, 3) of the root of their sum; negative sums, impossible for a covariance, count as 0."""
    with np.errstate(over="ignore"):  # sums of numbers near the largest
        return float(np.median(np.sqrt(np.maximum(variances.sum(axis=1), 0.0))))
