"""Compiled posterior of numbers that may be told: of each group of them it is known, or they are normal.

A spike and a slab each (Mitchell & Beauchamp 1988): the posterior is a mixture over all cases.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.tracker.geometry_kernels import cholesky, solved
from uavbench.trajectories.kernels.argument_types import named_tuple
from uavbench.trajectories.kernels.compiled import compiled
from uavbench.trajectories.pose import Array


class Slabs(NamedTuple):
    """Groups of numbers, first[k] to first[k + 1] of group k, which are not 0 with the probabilities (k,) before.

    decided (k,): whether the numbers of a group are 0 unless it is likelier that they are not, in place of both.
    """

    first: NDArray[np.int64]
    probability: Array
    decided: NDArray[np.bool_]


class Mixture(NamedTuple):
    """Mean (r,) and covariance (r, r) of the numbers, and the probability (k,) that those of each group are not 0."""

    mean: Array
    covariance: Array
    probability: Array


SLABS = named_tuple(Slabs, "i1! f1! b1!")


@compiled("f2 f1 slabs f0", slabs=SLABS)
def mixture(information: Array, vector: Array, slabs: Slabs, sigma: float) -> Mixture:
    """The posterior by information (r, r) and vector (r,); numbers that are not 0 have the prior deviation sigma."""
    n, groups = len(vector), len(slabs.probability)
    cases = 1 << groups
    weights, means, covariances = np.zeros(cases), np.zeros((cases, n)), np.zeros((cases, n, n))
    for case in range(cases):
        active, log = np.zeros(n), 0.0
        for k in range(groups):
            chosen = float((case >> k) & 1)
            log += math.log(slabs.probability[k] if chosen else 1.0 - slabs.probability[k])
            for i in range(slabs.first[k], slabs.first[k + 1]):
                active[i] = chosen
        whole, L = np.eye(n), np.eye(n)
        for i in range(n):
            for j in range(n):
                whole[i, j] += active[i] * active[j] * sigma * sigma * information[i, j]
        cholesky(whole, L)
        inverse = solved(L, np.eye(n))
        for k in range(n):
            log -= math.log(L[k, k])
            for i in range(n):
                covariances[case, i, k] = active[i] * active[k] * sigma * sigma * inverse[i, k]
        for i in range(n):
            for j in range(n):
                means[case, i] += covariances[case, i, j] * vector[j]
            log += 0.5 * means[case, i] * vector[i]
        weights[case] = log
    weights = np.exp(weights - weights.max())
    weights /= weights.sum()
    out = Mixture(np.zeros(n), np.zeros((n, n)), np.zeros(groups))
    for case in range(cases):
        for k in range(groups):
            out.probability[k] += weights[case] * float((case >> k) & 1)
    for case in range(cases):
        for k in range(groups):
            if slabs.decided[k] and ((case >> k) & 1) != (out.probability[k] > 0.5):
                weights[case] = 0.0
    weights /= weights.sum()
    for case in range(cases):
        for i in range(n):
            out.mean[i] += weights[case] * means[case, i]
    for case in range(cases):
        for i in range(n):
            for j in range(n):
                beside = (means[case, i] - out.mean[i]) * (means[case, j] - out.mean[j])
                out.covariance[i, j] += weights[case] * (covariances[case, i, j] + beside)
    return out
