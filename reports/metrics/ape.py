"""Absolute pose error: how far each estimated pose is from its true one.

Conventions: E = P_ref^-1 Q_est. translation |t_E| in m (= |p - q|); angle |log R_E| in deg or rad;
rotation |R_E - I| and full |E - I| in the Frobenius norm.
"""

from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np

from uavbench.reports.metrics.association import NS, PosePairs
from uavbench.reports.metrics.quaternions import angle, between, chord, norm
from uavbench.trajectories.pose import Array

if TYPE_CHECKING:
    from pandas import DataFrame

BLOCK = 8192
ApeRelation = Literal["translation_m", "angle_deg", "angle_rad", "rotation", "full"]


def absolute_errors(pairs: PosePairs, relation: ApeRelation) -> Array:
    """Errors (n,) of the estimated poses."""
    if relation == "translation_m":
        return distances(pairs)
    E = between(pairs.reference_q, pairs.estimate_q)
    if relation == "angle_rad":
        return angle(E)
    if relation == "angle_deg":
        return np.degrees(angle(E))
    if relation == "rotation":
        return chord(E)
    return np.hypot(chord(E), distances(pairs))


class ErrorSizes(NamedTuple):
    """Sizes of pose errors: translation (n,) in m, rotation (n,) in rad."""

    metres: Array
    radians: Array


def pose_error_sizes(pairs: PosePairs) -> ErrorSizes:
    """Sizes of E: translation (n,) in m and rotation (n,) in rad, in blocks that fit a cache."""
    radians = np.empty(len(pairs))
    for start in range(0, len(pairs), BLOCK):
        block = slice(start, start + BLOCK)
        radians[block] = angle(between(pairs.reference_q[block], pairs.estimate_q[block]))
    return ErrorSizes(distances(pairs), radians)


def distances(pairs: PosePairs) -> Array:
    """Distances (n,) in metres between estimated and true positions."""
    return norm(pairs.estimate_m - pairs.reference_m)


def error_table(pairs: PosePairs) -> "DataFrame":
    """One row per pair: stamp_ns, time_s, position_error_m, rotation_error_deg, reference_x_m ... estimate_z_m."""
    from pandas import DataFrame

    position_m, rotation_rad = pose_error_sizes(pairs)
    columns = {
        "stamp_ns": pairs.stamps_ns,
        "time_s": (pairs.stamps_ns - pairs.stamps_ns[0]) / NS,
        "position_error_m": position_m,
        "rotation_error_deg": np.degrees(rotation_rad),
    }
    for name, positions in (("reference", pairs.reference_m), ("estimate", pairs.estimate_m)):
        columns |= {f"{name}_{axis}_m": values for axis, values in zip("xyz", positions.T, strict=True)}
    return DataFrame(columns)
