"""How much of the edges of a mesh are noise of its surface, as in a scan that was not simplified."""

from dataclasses import dataclass

import numpy as np

from uavbench.scenes.scans.scanned_surface import FLAT, FLAT_SHARE, fitted_patches, twins_of
from uavbench.scenes.structure import Indices
from uavbench.trajectories.pose import Array

PATCH_TRIANGLES = (160, 640, 2560)
"""Triangles of a patch whose noise averages out in its normal: more of them, the finer a mesh is for its noise."""
ASKED = 1_000
"""Patches, evenly spread over the triangles of the file."""
EXPLAINED = 3.0
"""Angle of an edge that noise explains, in standard deviations of those that it makes."""
RAYLEIGH_MEDIAN = float(np.sqrt(2 * np.log(2)))
"""Median of the length of a normal distribution in two dimensions, as of a normal's tilt, in standard deviations."""


@dataclass(frozen=True)
class Roughness:
    """Part of a mesh's crease edges that its own noise explains, and by what angle neighbours turn by it, degrees.

    noise_m: standard deviation of the surface about planes, metres.
    """

    share: float
    turn_deg: float
    noise_m: float


NONE = Roughness(0.0, 0.0, 0.0)


def roughness(vertices: Array, triangles: Indices, crease_angle_deg: float) -> Roughness:
    """The roughness of welded triangles (m, 3): how their normals scatter within patches that are flat as a whole.

    Where a quarter of the patches is not flat, as of models of few triangles or of bars, there is none to be told.
    """
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    vector_areas = np.cross(b - a, c - a) / 2
    own = vector_areas / np.linalg.norm(vector_areas, axis=1, keepdims=True)
    twins = twins_of(triangles)
    rows = np.linspace(0, len(triangles) - 1, ASKED).astype(np.int64)
    for size in PATCH_TRIANGLES:
        patches = fitted_patches(rows, twins // 3, (a + b + c) / 3, vector_areas, size)
        flat = patches.residuals < FLAT * np.sqrt(patches.areas / np.pi)
        if flat.mean() >= FLAT_SHARE:
            break
    else:
        return NONE
    tilt = np.arccos(np.clip(np.einsum("ij,ij->i", patches.normals[flat], own[rows[flat]]), -1, 1))
    turn = float(np.sqrt(2) * np.median(tilt) / RAYLEIGH_MEDIAN)
    sides = np.flatnonzero(twins.ravel() > np.arange(twins.size))
    angle = np.arccos(np.clip(np.einsum("ij,ij->i", own[sides // 3], own[twins.ravel()[sides] // 3]), -1, 1))
    creases = angle[angle >= np.radians(crease_angle_deg)]
    share = float(np.mean(creases < EXPLAINED * turn)) if len(creases) else 0.0
    return Roughness(share, float(np.degrees(turn)), float(np.median(patches.residuals[flat])))
