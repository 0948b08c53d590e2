"""Images of a sequence that several parts of a report look at one after the other."""

from functools import lru_cache

from uavbench.scenes.dataset.sequence import Sequence
from uavbench.tracker.protocol import Image


@lru_cache(maxsize=2)  # the latest: an image takes 1 MB and more
def image_at(sequence: Sequence, frame: int) -> Image:
    """BGR image (h, w, 3) of a frame, read-only; UserError as `Sequence.image`."""
    image = sequence.image(frame)
    image.setflags(write=False)
    return image
