"""Ray-triangle intersection, shared by all kernels."""

import numpy as np

from uavbench.trajectories.kernels.compiled import inlined
from uavbench.trajectories.pose import Array


@inlined(allocates=False)
def ray_triangle(o: Array, d: Array | tuple[float, float, float], a: Array, b: Array, c: Array) -> float:
    """Distance along a ray to a triangle, inf when it misses (Moller & Trumbore 1997)."""
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    px, py, pz = d[1] * vz - d[2] * vy, d[2] * vx - d[0] * vz, d[0] * vy - d[1] * vx
    determinant = ux * px + uy * py + uz * pz
    if determinant == 0.0:
        return float(np.inf)
    tx, ty, tz = o[0] - a[0], o[1] - a[1], o[2] - a[2]
    beta = (tx * px + ty * py + tz * pz) / determinant
    qx, qy, qz = ty * uz - tz * uy, tz * ux - tx * uz, tx * uy - ty * ux
    gamma = (d[0] * qx + d[1] * qy + d[2] * qz) / determinant
    if beta < 0.0 or gamma < 0.0 or beta + gamma > 1.0:
        return float(np.inf)
    distance = (vx * qx + vy * qy + vz * qz) / determinant
    return float(distance) if distance > 0.0 else float(np.inf)
