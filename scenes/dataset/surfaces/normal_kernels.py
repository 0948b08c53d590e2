"""Kernel of the normals of the surfaces that pixels show, into the bytes of their files."""

from typing import Any

import numpy as np

from uavbench.scenes.dataset.surfaces.surface_files import NORMAL_UNITS
from uavbench.scenes.dataset.surfaces.trace_kernels import end_of_run
from uavbench.trajectories.kernels.compiled import compiled

BYTES = 6
"""Bytes of a pixel in these files: three numbers of 16 bits."""


@compiled("j2 f3 f2 u2!", allocates=False)
def normal_rows(rows: Any, corners: Any, cam_from_world: Any, out: Any) -> None:
    """Rows (h, 6 w) of a file of normals: x y z in 16 bits, the first byte the higher, of the facets (h, w) of pixels.

    corners (n, 3, 3) of facets in the world, m; cam_from_world (3, 4). Normals are turned towards the camera.
    """
    h, w = rows.shape
    for i in range(h):
        begin = 0
        while begin < w:
            facet = rows[i, begin]
            end = end_of_run(rows[i], begin, w, facet)
            done = end_of_run(rows[i - 1], begin, end, facet) if i > 0 else begin
            if done > begin:
                _copy(out[i - 1, BYTES * begin : BYTES * done], out[i, BYTES * begin : BYTES * done])
            else:
                done += 1
                _put(corners, facet, cam_from_world, out[i, BYTES * begin : BYTES * done])
            _repeat(out[i, BYTES * (done - 1) : BYTES * end])
            begin = end


@compiled
def _copy(above: Any, out: Any) -> None:
    """Copy bytes."""
    for k in range(out.size):
        out[k] = above[k]


@compiled
def _repeat(out: Any) -> None:
    """Fill pixels (6 n,) with the first of them; two bytes of one number are written at once."""
    x, y, z = _number(out[0:2]), _number(out[2:4]), _number(out[4:6])
    for j in range(np.uint64(1), np.uint64(out.size // BYTES)):
        k = j * np.uint64(BYTES)
        out[k], out[k + np.uint64(1)] = np.uint8(x >> np.uint16(8)), np.uint8(x & np.uint16(255))
        out[k + np.uint64(2)], out[k + np.uint64(3)] = np.uint8(y >> np.uint16(8)), np.uint8(y & np.uint16(255))
        out[k + np.uint64(4)], out[k + np.uint64(5)] = np.uint8(z >> np.uint16(8)), np.uint8(z & np.uint16(255))


@compiled
def _number(pair: Any) -> Any:
    """The number of two bytes, the higher first."""
    return np.uint16((pair[0] << 8) | pair[1])


@compiled
def _put(corners: Any, row: int, cam_from_world: Any, out: Any) -> None:
    """The bytes (6,) of the normal of a facet; 0 for none."""
    if row < 0:
        for k in range(BYTES):
            out[k] = 0
        return
    x0, y0, z0 = corners[row, 0, 0], corners[row, 0, 1], corners[row, 0, 2]
    ax, ay, az = corners[row, 1, 0] - x0, corners[row, 1, 1] - y0, corners[row, 1, 2] - z0
    bx, by, bz = corners[row, 2, 0] - x0, corners[row, 2, 1] - y0, corners[row, 2, 2] - z0
    nx, ny, nz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    size = max(np.sqrt(nx * nx + ny * ny + nz * nz), 1e-300)
    nx, ny, nz = nx / size, ny / size, nz / size
    from_camera = 0.0
    for axis in range(3):
        a = cam_from_world[axis]
        turned = a[0] * nx + a[1] * ny + a[2] * nz
        from_camera += turned * (a[0] * x0 + a[1] * y0 + a[2] * z0 + a[3])
    for axis in range(3):
        a = cam_from_world[axis]
        turned = a[0] * nx + a[1] * ny + a[2] * nz
        code = int(np.rint(((-turned if from_camera > 0 else turned) + 1) / 2 * NORMAL_UNITS))
        out[2 * axis], out[2 * axis + 1] = np.uint8(code >> 8), np.uint8(code & 255)
