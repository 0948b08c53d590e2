"""Tuned values of preprocessing."""

from dataclasses import dataclass
from typing import Annotated

from annotated_types import Gt, Unit

from uavbench.tracker.robust.config.bounds import Positive


@dataclass(frozen=True)
class PreprocessingConfig:
    """Denoising, contrast stretch and gain-offset compensation."""

    max_noise_grey: Positive = 3.5
    """Standard deviation of noise up to which an image is not smoothed. Chosen on rendered seeds 100 to 107."""
    usual_range_grey: Positive = 45.0
    """Range from the 5th to the 95th percentile for which thresholds were chosen. Measured on 30 rendered flights and
    two real ones: 42 to 223."""
    min_gain: Annotated[float, Gt(1), Unit("1")] = 1.5
    """Least contrast gain that is applied. Chosen on rendered seeds."""
