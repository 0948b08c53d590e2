"""The decorator of compiled inner loops.

Compiled without fast-math and without threads, so that the same input gives the same bytes in every process.
"""

from collections.abc import Callable
from typing import TypeVar, cast

import numba

F = TypeVar("F", bound=Callable[..., object])


def compiled(function: F) -> F:
    """`function` compiled by numba on its first call; the machine code is cached on disk for the next process."""
    return cast(F, numba.njit(cache=True)(function))
