"""Compiled projection through a lens.

A camera is an array (11,): fx fy cx cy, model (0 none, 1 radtan, 2 equidistant), k1..k5; from `camera_array`.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.trajectories.kernels.compiled import compiled, inlined

Array = NDArray[np.float64]


class ImagePoint(NamedTuple):
    """A point of the image plane: normalized coordinates, or a pixel."""

    x: float
    y: float


@compiled("f0 f0 f1", inner=True, allocates=False)
def distort(x: float, y: float, cam: Array) -> ImagePoint:
    """Distorted normalized coordinates (Brown-Conrady; Kannala & Brandt 2006)."""
    if cam[4] == 0.0:
        return ImagePoint(x, y)
    r2 = x * x + y * y
    if cam[4] == 1.0:
        k1, k2, p1, p2, k3 = cam[5], cam[6], cam[7], cam[8], cam[9]
        radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
        return ImagePoint(
            x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
            y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
        )
    r = math.sqrt(r2)
    if r < 1e-9:
        return ImagePoint(x, y)
    theta = math.atan(r)
    t2 = theta * theta
    scale = theta * (1.0 + t2 * (cam[5] + t2 * (cam[6] + t2 * (cam[7] + t2 * cam[8])))) / r
    return ImagePoint(x * scale, y * scale)


@inlined(allocates=False)
def project(x: float, y: float, z: float, cam: Array) -> ImagePoint:
    """Pixel of a point in the camera frame, z > 0."""
    u, v = x / z, y / z
    if cam[4] != 0.0:
        u, v = distort(u, v, cam)
    return ImagePoint(cam[0] * u + cam[2], cam[1] * v + cam[3])
