"""The decorator of compiled kernels.

Compiled without fast-math and without threads, so that the same input gives the same bytes in every process.
"""

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba

from trajectories.kernel_cache import cache_of

F = TypeVar("F", bound=Callable[..., Any])


def compiled(function: F) -> F:
    """`function` compiled by numba on its first call (no Python objects), and kept on disk for the next process.

    Division by zero gives inf or nan, as in numpy; sums keep their order, so a kernel's result is always the same.
    """
    kernel: Any = numba.njit(error_model="numpy")(function)
    if kernel is not function:  # it is the function itself where numba is switched off
        kernel._cache = cache_of(function)
    return cast(F, kernel)
