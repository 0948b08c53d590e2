"""Depth between the centres of pixels: on a plane its inverse is linear in the image, across an edge it is neither's.

Between four pixels of one smooth surface the inverse is interpolated; elsewhere the depth of the nearest pixel stands.
"""

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from uavbench.scenes.rendering.camera_simulator import Map
from uavbench.trajectories.pose import Array

BENT = 0.05
"""Change of slope from one pixel to the next, as a share of the slope, from which on there is an edge or a step."""
ROUNDING = 2.5
"""Change of slope in units of a depth file that its rounding explains: two of half a unit each, and one of a unit."""


def sampled_depth(depth_m: Array, places: Map, unit_m: float) -> Array:
    """Depth (h, w) in m at places (h, w, 2) in px of a depth image, 0 where there is none; unit_m: of its rounding."""
    none: Any = None
    nearest = cv2.remap(depth_m, places, none, cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT)
    out = np.asarray(nearest, dtype=np.float64)
    inverse = np.divide(1.0, depth_m, out=np.zeros(depth_m.shape), where=depth_m > 0)
    smooth = np.zeros(depth_m.shape, dtype=bool)
    smooth[1:-1, 1:-1] = _even(inverse[1:-1], unit_m) & _even(inverse[:, 1:-1].T, unit_m).T
    corner = np.floor(places).astype(np.int64)
    height, width = depth_m.shape
    rows, columns = np.nonzero(((corner >= 0) & (corner < [width - 1, height - 1])).all(axis=-1))
    left, top = corner[rows, columns].T
    right, down = (places[rows, columns] - corner[rows, columns]).T.astype(np.float64)
    value, flat = np.zeros(len(rows)), np.ones(len(rows), dtype=bool)
    for x, y, weight in (
        (left, top, (1 - right) * (1 - down)),
        (left + 1, top, right * (1 - down)),
        (left, top + 1, (1 - right) * down),
        (left + 1, top + 1, right * down),
    ):  # not cv2.remap, which rounds places to 1/32 px
        value += weight * inverse[y, x]
        flat &= smooth[y, x]
    out[rows[flat], columns[flat]] = 1 / value[flat]
    return out


def _even(inverse: Array, unit_m: float) -> NDArray[np.bool_]:
    """Whether inverse depth (h, w) goes on as before at the pixels (h, w - 2) within each row."""
    steps = np.diff(inverse, axis=1)
    slope = np.minimum(np.abs(steps[:, 1:]), np.abs(steps[:, :-1]))
    middle = inverse[:, 1:-1]
    known = (inverse[:, :-2] > 0) & (middle > 0) & (inverse[:, 2:] > 0)
    return np.asarray(known & (np.abs(np.diff(steps, axis=1)) <= ROUNDING * unit_m * middle**2 + BENT * slope))
