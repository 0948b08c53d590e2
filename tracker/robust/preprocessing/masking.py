"""Masked pixels of a camera: what they show, such as the text of an overlay, does not count."""

from uavbench.scenes.camera import Camera
from uavbench.tracker.protocol import Image

FILLED_GREY = 128
"""Grey level in place of what masked pixels show: any that is the same in all frames."""


class Masking:
    """The masked pixels of a camera, if there are any."""

    def __init__(self, camera: Camera) -> None:
        self.masked = ~camera.unmasked if camera.masked else None

    def of(self, image: Image) -> Image:
        """An image with masked pixels filled; the image itself where none are."""
        if self.masked is None:
            return image
        filled = image.copy()
        filled[self.masked] = FILLED_GREY
        return filled
