"""Light and exposure: images of little contrast are stretched, and colours follow a light that changed."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from uavbench.tracker.protocol import Image
from uavbench.tracker.robust.config.preprocessing import PreprocessingConfig
from uavbench.trajectories.pose import Array

APART_PX = 16
"""Every such column of every such row of a frame speaks for its light."""
MIDDLE = 128.0
"""Grey level to which the middle of a stretched image is brought: that of the code's range."""
USABLE = 8
"""At least one pixel in so many must follow the light for their median to tell it."""


@dataclass(frozen=True)
class Stretch:
    """Stretches the contrast of images by a gain about their middle grey level."""

    gain: float = 1.0
    middle: float = MIDDLE

    @classmethod
    def needed(cls, image: Image, config: PreprocessingConfig) -> "Stretch":
        """The stretch that an image needs; none where it has enough contrast."""
        low, middle, high = np.percentile(image[::APART_PX, ::APART_PX], (5, 50, 95))
        gain = min(config.max_gain, config.usual_range_grey / max(float(high - low), 1.0))
        return cls(gain, float(middle)) if gain > config.min_gain else cls()

    def of(self, image: Image) -> Image:
        """The image as it should be looked at."""
        return image if self == Stretch() else np.asarray(cv2.LUT(image, self.table()), dtype=np.uint8)

    def table(self) -> NDArray[np.uint8]:
        """What each grey level (256,) becomes."""
        return np.clip(np.round(MIDDLE + self.gain * (np.arange(256.0) - self.middle)), 0, 255).astype(np.uint8)

    def differs(self, other: "Stretch", min_gain: float) -> bool:
        """Whether another stretch is another one by more than the smallest gain that is applied."""
        return not 1 / min_gain < self.gain / other.gain < min_gain

    def towards(self, other: "Stretch", ratio: Array) -> tuple[Array, Array]:
        """Factor and offset (c,) that take colours to another stretch, the light brighter by a ratio (c,)."""
        factor = other.gain * ratio / self.gain
        return factor, MIDDLE + other.gain * (self.middle * ratio - other.middle) - MIDDLE * factor


def light_change(now: Image, then: Image, config: PreprocessingConfig) -> Array:
    """Ratio (c,) by which most pixels are brighter than in an image before; 1 where nothing tells.

    now and then are some rows (h, w) or (h, w, c) of either, h and w the same.
    """
    a, b = (rows[:, ::APART_PX].reshape(len(rows), -1, rows.shape[2] if rows.ndim == 3 else 1) for rows in (now, then))
    out = np.ones(a.shape[2])
    for c in range(len(out)):
        low, high = np.minimum(a[..., c], b[..., c]), np.maximum(a[..., c], b[..., c])
        usable = (low > config.dark_grey) & (high < config.bright_grey)
        if np.count_nonzero(usable) > usable.size // USABLE:
            out[c] = np.median(a[usable, c].astype(np.float64) / b[usable, c])
    return np.ones(len(out)) if np.abs(np.log(out)).max() < config.min_light_change_log else out


def relit(appearance: Array, factor: Array, offset: Array) -> Array:
    """Learned colours, in the first six columns, in another light by a factor and an offset (c,)."""
    out = appearance.copy()
    for side in (slice(0, len(factor)), slice(3, 3 + len(factor))):
        out[:, side] = out[:, side] * factor + offset
    return out
