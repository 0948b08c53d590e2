"""Grey levels of images: those that are nearly black, though no camera made them so."""

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
