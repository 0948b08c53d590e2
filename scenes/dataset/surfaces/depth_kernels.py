"""Kernel of the depth of pixels, into the filtered bytes of their files."""

from typing import Any

import numpy as np

from uavbench.scenes.png.filters import UP, less
from uavbench.trajectories.kernels.compiled import compiled


@compiled("s2 f0 h2! u2!", allocates=False)
def depth_rows(depth: Any, unit: float, codes: Any, out: Any) -> None:
    """Filtered rows (h, 1 + 2 w) of a PNG file of depths (h, w) in metres: residuals against the row above of multiples
    of a unit in 16 bits, rounded, the first byte the higher; 0 where a depth is too large. codes (2, w): scratch.
    """
    for i in range(depth.shape[0]):
        here, above, row = codes[i % 2], codes[1 - i % 2], out[i]
        _code(depth[i], unit, here)
        row[0] = UP
        less(here.view(np.uint8), above.view(np.uint8), i > 0, row[1:])


@compiled
def _code(depth: Any, unit: float, out: Any) -> None:
    """The numbers (w,) of a row, their first byte the higher."""
    for j in range(out.size):
        units = np.rint(depth[j] / np.float32(unit))
        code = np.int32(units if units <= np.float32(65535) else np.float32(0))
        out[j] = np.uint16((code >> 8) | ((code & 255) << 8))
