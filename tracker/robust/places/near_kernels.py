"""Compiled search for a pose near another."""

import math

from uavbench.trajectories.kernels.compiled import compiled
from uavbench.trajectories.pose import Array


@compiled("f3 f2 f2 f1 f0 f0", allocates=False)
def last_near(all_R: Array, all_t: Array, R: Array, t: Array, range_m: float, part: float) -> int:
    """Row of the last of all poses (k, 3, 3), (k, 3) that is not apart from (R, t), -1 for none.

    Poses are apart as in `PoseStack.apart`.
    """
    least_cosine = math.cos(min(part, math.pi))
    for k in range(len(all_R) - 1, -1, -1):
        square, trace = 0.0, 0.0
        for i in range(3):
            between = 0.0
            for j in range(3):
                between += all_R[k, j, i] * all_t[k, j] - R[j, i] * t[j]
                trace += all_R[k, i, j] * R[i, j]
            square += between * between
        if not (math.sqrt(square) > part * range_m or (trace - 1.0) / 2.0 < least_cosine):
            return k
    return -1
