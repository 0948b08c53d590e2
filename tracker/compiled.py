"""The decorator of compiled kernels."""

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba

F = TypeVar("F", bound=Callable[..., Any])


def compiled(function: F) -> F:
    """Compile a kernel on its first call and keep it on disk (numba, no Python objects).

    Division by zero gives inf or nan, as in numpy; sums keep their order, so a kernel's result is always the same.
    """
    return cast(F, numba.njit(cache=True, error_model="numpy")(function))
