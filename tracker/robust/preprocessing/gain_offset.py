"""Gain-offset compensation: contrast stretch of low-contrast images, and adaptation of learned colours to exposure."""

from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from uavbench.tracker.protocol import Image
from uavbench.tracker.robust.config.preprocessing import PreprocessingConfig
from uavbench.tracker.robust.edges.columns import NEGATIVE_COLOUR, POSITIVE_COLOUR
from uavbench.tracker.robust.mostly_zero import mostly_zero
from uavbench.trajectories.pose import Array

APART_PX = 16
"""Stride of the columns and rows on which the brightness of a frame is measured."""
MIDDLE = 128.0
"""Grey level of the median of a stretched image: the middle of the range."""
USABLE = 8
"""The median of ratios is used if at least one pixel in this many is neither dark nor saturated."""

Indices = NDArray[np.int64]


class GainOffset(NamedTuple):
    """Colours c (channels,) become gain * c + offset."""

    gain: Array
    offset: Array


@dataclass(frozen=True)
class ContrastStretch:
    """Contrast stretch of images by a gain about their median grey level."""

    gain: float = 1.0
    middle: float = MIDDLE

    @classmethod
    def needed(cls, image: Image, config: PreprocessingConfig) -> "ContrastStretch":
        """The stretch that an image needs; the identity if it has enough contrast."""
        low, middle, high = np.percentile(image[::APART_PX, ::APART_PX], (5, 50, 95))
        gain = config.usual_range_grey / max(float(high - low), 1.0)
        return cls(gain, float(middle)) if gain > config.min_gain else cls()

    def of(self, image: Image) -> Image:
        """The stretched image."""
        return (
            image
            if self.gain == 1.0 and self.middle == MIDDLE
            else np.asarray(cv2.LUT(image, self.table()), dtype=np.uint8)
        )

    def table(self) -> NDArray[np.uint8]:
        """Lookup table (256,) of the stretch."""
        return np.clip(np.round(MIDDLE + self.gain * (np.arange(256.0) - self.middle)), 0, 255).astype(np.uint8)

    def differs(self, other: "ContrastStretch", min_gain: float) -> bool:
        """Whether the gains differ by a factor of at least min_gain."""
        return not 1 / min_gain < self.gain / other.gain < min_gain

    def towards(self, other: "ContrastStretch", ratio: Array) -> GainOffset:
        """Gain and offset that map colours to another stretch of an image that is brighter by a ratio (channels,)."""
        gain = other.gain * ratio / self.gain
        return GainOffset(gain, MIDDLE + other.gain * (self.middle * ratio - other.middle) - MIDDLE * gain)


def brightness_ratio(now: Image, then: Image) -> Array:
    """Median ratio (channels,) of brightness to that of an earlier image; 1 where too few pixels are usable.

    now, then: the same rows (h, w) or (h, w, c) of both images.
    """
    a, b = (rows[:, ::APART_PX].reshape(len(rows), -1, rows.shape[2] if rows.ndim == 3 else 1) for rows in (now, then))
    out = np.ones(a.shape[2])
    for c in range(len(out)):
        low, high = np.minimum(a[..., c], b[..., c]), np.maximum(a[..., c], b[..., c])
        usable = (low > 0) & (high < 255)
        if np.count_nonzero(usable) > usable.size // USABLE:
            out[c] = np.median(a[usable, c].astype(np.float64) / b[usable, c])
    return out


def compensated(appearance: Array, seen: Indices, change: GainOffset) -> Array:
    """Rows of appearance with the colours of both sides after a change of gain and offset; those not seen are 0.

    seen (n,): rows that may have been seen. Of a large structure they are few, and the others take no memory.
    """
    out, rows, channels = mostly_zero(*appearance.shape), appearance[seen], len(change.gain)
    for start in (NEGATIVE_COLOUR, POSITIVE_COLOUR):
        side = slice(start, start + channels)
        rows[:, side] = rows[:, side] * change.gain + change.offset
    out[seen] = rows
    return out
