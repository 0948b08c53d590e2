"""Absolute pose error: how far each estimated pose is from its true one.

Conventions: E = P_ref^-1 Q_est. translation |t_E| in m (= |p - q|); angle |log R_E| in deg or rad;
rotation |R_E - I| and full |E - I| in the Frobenius norm.
"""

from typing import Literal

import numpy as np

from reports.association import PosePairs
from reports.quaternions import angle, between, chord
from trajectories.pose import Array

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


def distances(pairs: PosePairs) -> Array:
    """Distances (n,) in metres between estimated and true positions."""
    d = pairs.estimate_m - pairs.reference_m
    norm: Array = np.sqrt(np.einsum("ij,ij->i", d, d))
    return norm
