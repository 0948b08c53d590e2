"""What is known of the numbers that all edges share, as arrays for the compiled kernels."""

from typing import NamedTuple

from uavbench.trajectories.kernels.argument_types import named_tuple
from uavbench.trajectories.pose import Array


class KnownNumbers(NamedTuple):
    """Mean (r,) and covariance (r, r) of the numbers, relative to those by which edges were located."""

    mean: Array
    covariance: Array


KNOWN_NUMBERS = named_tuple(KnownNumbers, "f1! f2!")
