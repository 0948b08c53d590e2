"""Kernel of the normals of the surfaces that pixels show, into the filtered bytes of their files."""

from typing import Any

import numpy as np

from uavbench.scenes.dataset.surfaces.surface_files import NORMAL_UNITS
from uavbench.scenes.png.filters import UP
from uavbench.trajectories.kernels.compiled import compiled, inlined
from uavbench.trajectories.kernels.equal_bytes import AT_ONCE, lowest_bit, unlike

BYTES = 6
"""Bytes of a pixel in these files: three numbers of 16 bits."""
KNOWN = np.uint64(1 << 63)
"""Bit of words that are known, above their bytes."""
HIGHEST = np.uint64(0x8080808080808080)
"""Highest bits of the bytes of a word."""


@compiled("j2 f3 f2 w1! u2!", allocates=False)
def normal_rows(rows: Any, corners: Any, cam_from_world: Any, codes: Any, out: Any) -> None:
    """Filtered rows (h, 1 + 6 w) of a PNG file of normals: residuals against the row above of x y z in 16 bits, the
    first byte the higher, of the facets (h, w) of pixels.

    corners (n, 3, 3) of facets in the world, m; cam_from_world (3, 4). Normals are turned towards the camera. codes
    (n + 1,): scratch of zeros.
    """
    h, w = rows.shape
    for i in range(h):
        out[i, 0] = UP
        _clear(out[i, 1:])
    codes[0] = KNOWN
    data, stride = rows.reshape(-1).view(np.uint8), np.uint64(4 * w)
    for j in range(w):
        _put(corners, rows[0, j], np.int32(-1), cam_from_world, codes, out[0], np.uint64(1 + BYTES * j))
    for i in range(1, h):
        for first in range(0, w, AT_ONCE):
            here = np.uint64(4 * (i * w + first))
            others = unlike(data, here, here - stride, min(w - first, AT_ONCE))
            while others != 0:
                u: Any = first + (np.int64(lowest_bit(others)) >> 2)
                others &= others - np.uint64(1)
                _put(corners, rows[i, u], rows[i - 1, u], cam_from_world, codes, out[i], np.uint64(1 + BYTES * u))


@compiled
def _clear(out: Any) -> None:
    """Set bytes to 0."""
    for k in range(out.size):
        out[k] = 0


@inlined
def _put(corners: Any, facet: Any, above: Any, cam_from_world: Any, codes: Any, out: Any, at: Any) -> None:
    """The residuals (6,) of the normal of a facet against that of another; -1 for none, whose bytes are 0."""
    here = _code(corners, np.int64(facet), cam_from_world, codes)
    there = _code(corners, np.int64(above), cam_from_world, codes)
    residuals = ((here | HIGHEST) - (there & ~HIGHEST)) ^ ((here ^ ~there) & HIGHEST)  # of each byte (Warren 2012)
    for k in range(np.uint64(BYTES)):
        out[at + k] = np.uint8(residuals >> (k << np.uint64(3)))


@inlined
def _code(corners: Any, row: Any, cam_from_world: Any, codes: Any) -> Any:
    """The bytes of the normal of a facet, or of none, the first one lowest, in a word with the bit KNOWN."""
    place = np.uint64(row + 1)
    if codes[place] == 0:
        codes[place] = _make(corners, row, cam_from_world)
    return codes[place]


@compiled
def _make(corners: Any, row: Any, cam_from_world: Any) -> Any:
    """The word of `_code` of a facet."""
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
    word = KNOWN
    for axis in range(3):
        a = cam_from_world[axis]
        turned = a[0] * nx + a[1] * ny + a[2] * nz
        code = np.uint64(np.rint(((-turned if from_camera > 0 else turned) + 1) / 2 * NORMAL_UNITS))
        word |= ((code >> np.uint64(8)) | ((code & np.uint64(255)) << np.uint64(8))) << np.uint64(16 * axis)
    return word
