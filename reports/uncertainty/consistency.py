"""Summary of NEES values: mean, share within the central 95 % interval, and sharpness of the claimed covariances."""

from dataclasses import dataclass

import numpy as np
from scipy.special import gammaincinv

from uavbench.reports.uncertainty.whitened_errors import effective_poses, squares
from uavbench.trajectories.pose import Array

DEGREES_OF_FREEDOM = 6
CENTRAL = (0.025, 0.975)


@dataclass(frozen=True, kw_only=True)
class Consistency:
    """NEES of the n frames with a regular covariance; singular: number of frames with a singular one.

    mean: None when n is 0; effective: number of poses with independent errors that tell as much as these n
    (`effective_poses`), None when n is 0 and in scores of earlier versions, whose interval took it for n; low, high:
    95 % interval of the mean of a consistent tracker whose errors last as long: the mean times `effective` is then
    about chi-square with 6 `effective` degrees of freedom (Satterthwaite 1946, Biometrics Bulletin 2); of a single
    pose when n is 0; inside: share of the n + singular frames within the central 95 % of chi-square with 6 degrees of
    freedom; sharpness_*: median standard deviation of position and of rotation, of the pose whose errors are scored.
    """

    n: int
    mean: float | None
    low: float
    high: float
    inside: float
    sharpness_m: float
    sharpness_deg: float
    singular: int = 0
    effective: float | None = None


def chi_square_quantile(p: float, degrees: float) -> float:
    """Quantile at p in [0, 1] of the chi-square distribution with a number of degrees of freedom."""
    return float(2.0 * gammaincinv(degrees / 2.0, p))


def consistency_of(errors: Array, variances: Array) -> Consistency | None:
    """Summary of whitened errors (n, 6), and of claimed variances (m, 6) in m^2 and rad^2; None without any error."""
    values = squares(errors)
    values = values[~np.isnan(values)]
    singular = int(np.isinf(values).sum())
    values = values[np.isfinite(values)]
    n = len(values)
    if n + singular == 0:
        return None
    effective = effective_poses(errors) if n else None
    poses = effective or 1.0
    low, high = (chi_square_quantile(p, DEGREES_OF_FREEDOM * poses) / poses for p in CENTRAL)
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
        effective=effective,
    )


def _median_sigma(variances: Array) -> float:
    """Median over rows (m, 3) of the root of their sum; negative sums, impossible for a covariance, count as 0."""
    with np.errstate(over="ignore"):  # sums of numbers near the largest
        return float(np.median(np.sqrt(np.maximum(variances.sum(axis=1), 0.0))))
