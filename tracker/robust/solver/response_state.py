"""What is known of the camera's response, as arrays for the compiled kernels."""

from typing import NamedTuple

from uavbench.trajectories.kernels.argument_types import named_tuple
from uavbench.trajectories.pose import Array


class KnownResponse(NamedTuple):
    """Mean (r,) and covariance (r, r) of the numbers of the response, relative to those by which edges were located."""

    mean: Array
    covariance: Array


KNOWN_RESPONSE = named_tuple(KnownResponse, "f1! f2!")
