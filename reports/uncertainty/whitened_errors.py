"""Errors in units of their claimed covariances: their squares are the NEES, their correlation tells how long they last.

Conventions: of an error e with covariance P = L L^T the whitened error is z = L^-1 e, and NEES is |z|^2. The rows of
whitened errors (n, 6) are in the order of time; one is NaN without an error or covariance, infinite where the
covariance is singular.
"""

import numpy as np

from uavbench.trajectories.pose import Array

SINGULAR = 1e-14
"""Smallest eigenvalue of a correlation matrix (6, 6) that is clearly above round-off (6 x 2^-52)."""


def whitened(errors: Array, covariances: Array) -> Array:
    """Whitened errors (n, 6) of errors (n, 6) with covariances (n, 6, 6), all of them finite.

    L is S times the Cholesky factor of P's correlation matrix, with the standard deviations S: round-off and what is
    singular do not depend on the units of the components.
    """
    out = np.full(errors.shape, np.inf)
    spread = np.sqrt(np.maximum(np.einsum("nii->ni", covariances), 0.0))
    scale = np.where(spread > 0, spread, 1.0)
    correlation = covariances / scale[:, :, None] / scale[:, None, :]
    regular = np.linalg.eigvalsh(correlation)[:, 0] > SINGULAR  # not with a variance of 0 or less
    with np.errstate(over="ignore"):  # of a standard deviation near the smallest number
        scaled = errors[regular] / spread[regular]
    out[regular] = np.linalg.solve(np.linalg.cholesky(correlation[regular]), scaled[:, :, None])[:, :, 0]
    out[~np.isfinite(squares(out))] = np.inf
    return out


def squares(errors: Array) -> Array:
    """NEES (n,) of whitened errors (n, 6); NaN and infinite as they are."""
    with np.errstate(over="ignore"):
        return np.asarray(np.einsum("ni,ni->n", errors, errors))


def effective_poses(errors: Array) -> float:
    """Number of poses with independent errors whose mean NEES is as uncertain as that of whitened errors (n, 6).

    From 1 to the number m of finite rows, of which there is at least one. Gaussian errors whose mean is known to be 0
    and whose correlation at a lag of l rows is rho(l) have squares correlated by rho(l)^2 (Isserlis 1918, Biometrika
    12): the number is m^2 over the sum of rho^2 over all pairs of rows. rho is that of the errors themselves, whose
    mean is not taken off: an offset for all of a run is one error. It is summed up to the first lag where it is not
    positive, since beyond it is noise (after Geyer 1992, Practical Markov chain Monte Carlo, Statistical Science 7,
    section 3.3). Errors of 0 are all the same one.
    """
    known = np.asarray(np.isfinite(errors).all(axis=1))
    largest = np.abs(errors[known]).max()
    if largest == 0:
        return 1.0
    pairs = np.rint(_lagged(known[:, None].astype(float)))
    lags = np.flatnonzero(pairs)
    pairs = pairs[lags]
    product = _lagged(np.where(known[:, None], errors / largest, 0.0))[lags] / pairs
    rho = product / product[0]
    terms = np.where(lags > 0, 2.0, 1.0) * pairs * rho**2
    total = float(terms[np.logical_and.accumulate(rho > 0)].sum())
    m = float(pairs[0])
    return float(np.clip(m * m / total, 1.0, m))  # beyond by round-off only: total is from m to m^2


def _lagged(values: Array) -> Array:
    """Sum over k of values[k] . values[k + l] for each lag l (n,) of values (n, d)."""
    n = len(values)
    spectrum = np.abs(np.fft.rfft(values, 2 * n, axis=0)) ** 2
    return np.asarray(np.fft.irfft(spectrum.sum(axis=1), 2 * n)[:n])
