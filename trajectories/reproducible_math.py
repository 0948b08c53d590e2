"""Functions with bit-identical results on every processor, used for everything in a flight's record.

NumPy dispatches elementary functions, and its BLAS products, inverses and norms, by the processor's instruction set
(AVX-512, FMA), with differences in the last bits. Here elementary functions are those of the C library, called per
element, and sums have a fixed order.
"""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from uavbench.trajectories.kernels.compiled import compiled

Array = NDArray[np.float64]
SIN, COS, TAN, TANH, EXP, EXPM1, LOG, ATAN2, HYPOT, POW = range(10)


def sin(x: ArrayLike) -> Array:
    """Sine, elementwise."""
    return _of_one(SIN, x)


def cos(x: ArrayLike) -> Array:
    """Cosine, elementwise."""
    return _of_one(COS, x)


def tan(x: ArrayLike) -> Array:
    """Tangent, elementwise."""
    return _of_one(TAN, x)


def tanh(x: ArrayLike) -> Array:
    """Hyperbolic tangent, elementwise."""
    return _of_one(TANH, x)


def exp(x: ArrayLike) -> Array:
    """Exponential, elementwise."""
    return _of_one(EXP, x)


def expm1(x: ArrayLike) -> Array:
    """exp(x) - 1, elementwise."""
    return _of_one(EXPM1, x)


def log(x: ArrayLike) -> Array:
    """Natural logarithm, elementwise."""
    return _of_one(LOG, x)


def arctan2(y: ArrayLike, x: ArrayLike) -> Array:
    """Angle of (x, y), elementwise."""
    return _of_two(ATAN2, y, x)


def hypot(x: ArrayLike, y: ArrayLike) -> Array:
    """sqrt(x^2 + y^2), elementwise."""
    return _of_two(HYPOT, x, y)


def power(x: ArrayLike, exponent: ArrayLike) -> Array:
    """Power x^exponent, elementwise."""
    return _of_two(POW, x, exponent)


def product(a: Array, b: Array) -> Array:
    """Matrix product a @ b of stacks of matrices (..., i, j) and (..., j, k), or of a and a vector (j,)."""
    rule = "...j,j->..." if b.ndim == 1 else "...ij,...jk->...ik"
    return np.asarray(np.einsum(rule, a, b))


def length(v: Array) -> Array:
    """Euclidean norms (...) of vectors (..., n)."""
    return np.asarray(np.sqrt(np.einsum("...i,...i->...", v, v)))[()]


def inverse(A: Array) -> Array:
    """Inverse of a matrix (n, n) by Gauss-Jordan elimination with partial pivoting; ValueError when it is singular."""
    n = len(A)
    table = np.hstack([np.asarray(A, dtype=np.float64), np.eye(n)])
    for k in range(n):
        best = k + int(np.argmax(np.abs(table[k:, k])))
        if table[best, k] == 0:
            raise ValueError("the matrix is singular")
        table[[k, best]] = table[[best, k]]
        table[k] /= table[k, k]
        for i in range(n):
            if i != k:
                table[i] -= table[i, k] * table[k]
    return table[:, n:]


def _of_one(operation: int, x: ArrayLike) -> Array:
    given = np.asarray(x, dtype=np.float64)
    out = np.empty(given.shape)
    _each(operation, given.ravel(), given.ravel(), out.reshape(-1))
    return out[()]


def _of_two(operation: int, x: ArrayLike, y: ArrayLike) -> Array:
    first, second = np.broadcast_arrays(np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64))
    out = np.empty(first.shape)
    _each(operation, first.ravel(), second.ravel(), out.reshape(-1))
    return out[()]


@compiled("i0 f1 f1 f1!")
def _each(operation: int, x: Array, y: Array, out: Array) -> None:
    for i in range(x.size):
        if operation == SIN:
            out[i] = math.sin(x[i])
        elif operation == COS:
            out[i] = math.cos(x[i])
        elif operation == TAN:
            out[i] = math.tan(x[i])
        elif operation == TANH:
            out[i] = math.tanh(x[i])
        elif operation == EXP:
            out[i] = math.exp(x[i])
        elif operation == EXPM1:
            out[i] = math.expm1(x[i])
        elif operation == LOG:
            out[i] = math.log(x[i])
        elif operation == ATAN2:
            out[i] = math.atan2(x[i], y[i])
        elif operation == HYPOT:
            out[i] = math.hypot(x[i], y[i])
        else:
            out[i] = x[i] ** y[i]
