"""Files of surface annotations: optical flow to the next frame, occlusion, and normals.

flow/NNNNNN.png       as in KITTI 2015: 16 bits, R and G (u, v) = 64 flow + 32768 px, B = 1 where it is known
occlusion/NNNNNN.png  0 seen in the next frame too, 1 hidden there, 2 out of its image, 3 no flow known
normals/NNNNNN.png    16 bits, R G B = (n + 1) / 2 * 65535 of x y z in the camera's frame; 0 0 0: none
"""

from pathlib import Path

import cv2
import numpy as np

from uavbench.scenes.image_files import load_image
from uavbench.trajectories.pose import Array

FLOW_UNITS_PER_PX, FLOW_ZERO = 64.0, 32768.0
"""Units per px and zero of the 16-bit flow files (KITTI 2015 devkit, readme.txt): +-512 px in steps of 1/64 px."""
LARGEST_FLOW_PX = 511.0
"""Largest flow component in these files, px."""
NORMAL_UNITS = 65535.0
"""Units of a normal's component from -1 to 1: 16 bits, rounded to 1.5e-5, 0.001 degrees."""
SEEN, HIDDEN, OUTSIDE, UNKNOWN = 0, 1, 2, 3
"""Values of the occlusion files."""


def read_flow(path: Path, folder: Path) -> Array:
    """Flow (h, w, 2) in px of a file in a folder, NaN where it is not known; UserError when it cannot be read."""
    codes = load_image(path, cv2.IMREAD_UNCHANGED, inside=folder).astype(np.float64)
    flow = (codes[..., 2:0:-1] - FLOW_ZERO) / FLOW_UNITS_PER_PX
    flow[codes[..., 0] == 0] = np.nan
    return flow


def read_normals(path: Path, folder: Path) -> Array:
    """Unit normals (h, w, 3) of a file in a folder, NaN where there are none; UserError when it cannot be read."""
    codes = load_image(path, cv2.IMREAD_UNCHANGED, inside=folder).astype(np.float64)
    normals = codes[..., ::-1] / NORMAL_UNITS * 2 - 1
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    normals[(codes == 0).all(axis=2)] = np.nan
    return np.asarray(normals)
