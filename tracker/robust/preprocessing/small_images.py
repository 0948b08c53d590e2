"""Small blurred images, by which places are recognized, and cuts between images (Klein & Murray 2008, section 4.2)."""

import cv2
import numpy as np

from uavbench.tracker.protocol import Image
from uavbench.trajectories.pose import Array

WIDTH, BLUR_PX = 40, 2.5
"""Width of a small image, and standard deviation of its blur, px (Klein & Murray 2008)."""


LEAST_NORM_GREY = 1e-6
"""Norm of a small image that shows something, grey levels: more than round-off."""
MOST_WIDTH = 640
"""Width, px, to which wider images are reduced: limits the time and memory of places."""


def grey(image: Image) -> Image:
    """A copy (h, w) of an image (h, w), (h, w, 1) or (h, w, 3), no wider than 640 px."""
    layers = image[:, :, 0] if image.ndim == 3 and image.shape[2] == 1 else image
    single = cv2.cvtColor(layers, cv2.COLOR_BGR2GRAY) if layers.ndim == 3 else layers
    height, width = single.shape
    if width <= MOST_WIDTH:
        return np.array(single, order="C")
    size = (MOST_WIDTH, max(1, round(MOST_WIDTH * height / width)))
    return np.asarray(cv2.resize(single, size, interpolation=cv2.INTER_AREA))


def small_image(image: Image) -> Array:
    """A small image (n,) of an image (h, w), blurred, of zero mean and unit length; zeros if it shows nothing."""
    height = max(1, round(WIDTH * image.shape[0] / image.shape[1]))
    small = cv2.resize(image, (WIDTH, height), interpolation=cv2.INTER_AREA).astype(np.float64)
    values = np.asarray(cv2.GaussianBlur(small, (0, 0), BLUR_PX), dtype=np.float64).ravel()
    values -= values.mean()
    return np.asarray(values / max(float(np.linalg.norm(values)), LEAST_NORM_GREY))
