"""Tuned values of preprocessing."""

from dataclasses import dataclass
from typing import Annotated

from annotated_types import Gt, Interval

from uavbench.tracker.robust.config.bounds import Positive

GreyLevel = Annotated[int, Interval(ge=0, le=255)]


@dataclass(frozen=True)
class PreprocessingConfig:
    """Denoising, contrast stretch and gain-offset compensation."""

    max_noise_grey: Positive = 3.5
    """Noise left as it is, one standard deviation. Chosen on rendered seeds 100 to 107."""
    max_smoothing_px: Positive = 4.0
    """Widest standard deviation of the Gaussian: structure of this size is not lost. Chosen on rendered seeds."""
    dark_grey: GreyLevel = 8
    """A pixel darker than this is not used for the brightness ratio. Chosen on rendered seeds."""
    bright_grey: GreyLevel = 247
    """Nor does one brighter than this. Chosen on rendered seeds."""
    usual_range_grey: Positive = 45.0
    """Range from the 5th to the 95th percentile for which thresholds were chosen. Measured on 30 rendered flights and
    two real ones: 42 to 223."""
    min_gain: Annotated[float, Gt(1)] = 1.5
    """Least contrast gain that is applied. Chosen on rendered seeds."""
    max_gain: Annotated[float, Gt(1)] = 8.0
    """Largest contrast gain: noise is stretched too. Chosen on rendered seeds."""
    min_brightness_change_log: Positive = 0.03
    """Least change of the logarithm of the light that is followed. Chosen on rendered seeds."""
