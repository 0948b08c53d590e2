"""Denoising: frames with much noise are smoothed before any measurement, by as much as their noise requires."""

import math

import cv2
import numpy as np

from uavbench.tracker.protocol import Image
from uavbench.tracker.robust.config.preprocessing import PreprocessingConfig
from uavbench.trajectories.kernels.compiled import compiled

ROWS_APART = 32
"""Stride of the rows in which noise is measured."""
MEDIAN_TO_SIGMA = 1.0 / 0.6745
"""Standard deviation of normal noise for a median absolute value of one."""


def smoothed(image: Image, config: PreprocessingConfig) -> Image:
    """Image (h, w) or (h, w, c) smoothed to the allowed noise; unchanged if it has no more."""
    noise_grey = noise_level(image.reshape(*image.shape[:2], -1))
    sigma_px = noise_grey / (2 * math.sqrt(math.pi) * config.max_noise_grey)
    if sigma_px <= 1 / (2 * math.sqrt(math.pi)):
        return image
    return np.asarray(cv2.GaussianBlur(image, (0, 0), sigma_px), dtype=np.uint8)


@compiled("u3")
def noise_level(image: Image) -> float:
    """One standard deviation of an image's noise in grey levels (Immerkaer 1996, with a median in place of the mean).

    Uses the second channel of an image (h, w, c), or its only one.
    """
    h, w, channels = image.shape
    c = 1 if channels > 1 else 0
    counts, bend, size = np.zeros(8 * 255 + 1, np.int32), np.empty(w, np.int32), np.empty(w, np.uint32)
    total = 0
    for y in range(1, h - 1, ROWS_APART):  # in steps, the first two of which a processor takes for many pixels at once
        for x in range(w):
            bend[x] = np.int32(image[y - 1, x, c]) - 2 * np.int32(image[y, x, c]) + np.int32(image[y + 1, x, c])
        for x in range(w - 2):
            size[x] = abs(bend[x] - 2 * bend[x + 1] + bend[x + 2])
        for x in range(w - 2):
            counts[size[x]] += 1
        total += max(0, w - 2)
    below, value = 0, 0
    while 2 * (below + counts[value]) < total:
        below += counts[value]
        value += 1
    return MEDIAN_TO_SIGMA * value / 6.0
