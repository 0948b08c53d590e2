"""Images that no camera made so: nearly black ones, and those that are the one before again."""

import numpy as np

from uavbench.tracker.protocol import Image

BLACK = 8
"""Largest grey level of 255 of an image with nothing to see: of masks, and of values from 0 to 1 cut to 8 bits.

Night images of cameras have noise and lights beyond it.
"""


class BlackImages:
    """Counts the images that are nearly black."""

    def __init__(self) -> None:
        self.first, self.black, self.all = -1, 0, 0

    def see(self, image: Image) -> None:
        """Count an image."""
        if int(image.max(initial=0)) <= BLACK:
            self.first = self.all if self.first < 0 else self.first
            self.black += 1
        self.all += 1

    def doubts(self, source: str) -> list[str]:
        """Message on them, if there are any."""
        if not self.black:
            return []
        return [
            f"{source}: {self.black} of {self.all} images have no grey level above {BLACK} of 255, the first is frame "
            f"{self.first}: are these masks, or values from 0 to 1? Write grey levels from 0 to 255"
        ]


MOST_REPEATED, FEWEST_REPEATED = 0.25, 10
"""Share of images that are the one before again, beyond which they are told, and the fewest that are, also in a row.

A link repeats some; the noise of a camera makes no two images the same.
"""


class RepeatedImages:
    """Counts the images that are the one before again, to the last byte."""

    def __init__(self) -> None:
        self.all, self.repeated, self.run, self.longest, self.first = 0, 0, 0, 0, 0
        self.before = np.zeros(0, dtype=np.uint8)

    def see(self, image: Image) -> None:
        """Count an image."""
        same = np.array_equal(image, self.before)
        self.run = self.run + 1 if same else 0
        if self.run > self.longest:
            self.longest, self.first = self.run, self.all - self.run
        self.repeated += same
        self.before = np.array(image, dtype=np.uint8)
        self.all += 1

    def doubts(self, source: str) -> list[str]:
        """Message on them, if there are many, or many in a row."""
        many = self.repeated > max(MOST_REPEATED * self.all, FEWEST_REPEATED - 1)
        if not many and self.longest < FEWEST_REPEATED:
            return []
        return [
            f"{source}: {self.repeated} of {self.all} images are the one before again, to the last byte, as frames "
            f"{self.first} to {self.first + self.longest}: did the camera or its driver stop, or were images copied to "
            "reach a rate? Their poses are those of the first one; remove them, or correct the rate"
        ]
