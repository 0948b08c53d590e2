"""How much the camera sharpens its images, learned from the edges that stand alone, and images without it."""

import math

import cv2
import numpy as np

from uavbench.tracker.protocol import Image
from uavbench.tracker.robust.edges.steps.optics_kernels import BLOWN_OUT
from uavbench.tracker.robust.edges.steps.sharpening_kernels import BOX_PX, TIMES

LEAST_AMOUNT = 0.2
"""Least amount that is undone: images of a sharp lens, whose square pixels blur with less of a tail than is thought,
seem to have up to 0.1, from which on blur and amount are told apart."""
ASK_EVERY = 8
"""Frames from one that is asked to the next, once as many were: limits their time."""
GAIN = 2.0
"""Weight of a frame over that of a mean: of an edge of high contrast, whose dark side is compressed in the codes, half
of the amount is seen."""
MOST_AMOUNT = 4.0
"""Largest amount: cameras sharpen by less, and more would leave little of an image."""


class Sharpening:
    """State: the amount of an unsharp mask, by which images are c + amount (c - blurred c)."""

    def __init__(self) -> None:
        self.amount, self.asked = 0.0, 0

    @property
    def undoes(self) -> float:
        """The amount that is undone."""
        return self.amount if self.amount >= LEAST_AMOUNT else 0.0

    @property
    def is_suspected(self) -> bool:
        """Whether the blur is to be told apart from sharpening, which hides it."""
        return self.amount >= LEAST_AMOUNT / 2

    def asks(self, frames: int) -> bool:
        """Whether a frame after so many others is asked for what it shows."""
        return self.asked < ASK_EVERY or frames % ASK_EVERY == 0

    def learn(self, excess: float, rate: float) -> None:
        """Update with the amount that a frame shows beside what was undone; NaN where unknown.

        rate, in [0, 1]: least weight of a frame. One frame at most doubles or halves what an image is multiplied by.
        """
        if math.isnan(excess):
            return
        self.asked += 1
        shown = (1 + self.undoes) * (1 + min(max(excess, -0.5), 1.0)) - 1
        self.amount += max(rate, GAIN / (1 + self.asked)) * (shown - self.amount)
        self.amount = min(max(self.amount, 0.0), MOST_AMOUNT)

    def undone(self, image: Image) -> Image:
        """An image (h, w) or (h, w, c) as it was before it was sharpened, to first order; blown-out pixels are kept."""
        if self.undoes == 0.0:
            return image
        part, blurred = self.amount / (1 + self.amount), image
        for _ in range(TIMES):
            blurred = np.asarray(cv2.blur(blurred, (BOX_PX, BOX_PX)), dtype=np.uint8)
        mixed = cv2.addWeighted(image, 1 - part, blurred, part, 0)
        _, blown = cv2.threshold(image, BLOWN_OUT - 1, 255, cv2.THRESH_TOZERO)
        return np.asarray(cv2.max(mixed, blown), dtype=np.uint8)
