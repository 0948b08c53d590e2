"""Images of a sequence, cached for the parts of a report that use the same frame in turn."""

from functools import lru_cache

from uavbench.scenes.dataset.sequence import Sequence
from uavbench.tracker.protocol import Image


@lru_cache(maxsize=2)  # only the latest: an image takes 1 MB and more
def image_at(sequence: Sequence, frame: int) -> Image:
    """BGR image (h, w, 3) of a frame, read-only; UserError when it cannot be read."""
    image = sequence.image(frame)
    image.setflags(write=False)
    return image
