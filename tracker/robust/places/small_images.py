"""Small blurred images, by which a place is recognized (Klein & Murray 2008, section 4.2)."""

import cv2
import numpy as np

from uavbench.tracker.protocol import Image
from uavbench.trajectories.pose import Array

WIDTH, BLUR_PX = 40, 2.5
"""Width of a small image, and standard deviation of its blur, px (Klein & Murray 2008)."""


def grey(image: Image) -> Image:
    """An image (h, w), (h, w, 1) or (h, w, 3) as (h, w)."""
    if image.ndim == 2 or image.shape[2] == 1:
        return np.ascontiguousarray(image.reshape(image.shape[:2]))
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY))


def small_image(image: Image) -> Array:
    """A small image (n,) of an image (h, w), blurred, of zero mean and unit length; zeros if it shows nothing."""
    height = max(1, round(WIDTH * image.shape[0] / image.shape[1]))
    small = cv2.resize(image, (WIDTH, height), interpolation=cv2.INTER_AREA).astype(np.float64)
    values = cv2.GaussianBlur(small, (0, 0), BLUR_PX).ravel()
    values -= values.mean()
    return np.asarray(values / max(float(np.linalg.norm(values)), 1e-12))
