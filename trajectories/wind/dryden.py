"""Dryden turbulence of MIL-F-8785C at low altitude, discretized exactly.

The filters of the specification are driven by white noise. Their states are stepped by their transition matrix with
noise of the covariance that the white noise accumulates within a step, and start in their stationary distribution; so
the standard deviation is the specified one for any step.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import accumulate
from typing import Annotated

import numpy as np
from annotated_types import Interval

from uavbench.trajectories import reproducible_math as exact
from uavbench.trajectories.errors import refuse_idle
from uavbench.trajectories.pose import Angle, Array, read_only
from uavbench.trajectories.wind.air import FASTEST_M_S, Air, downwind

FOOT_M = 0.3048
LOW_M = 305.0
"""Greatest height in m, 1,000 ft, up to which the specification's lengths and intensities hold."""
LOWEST_FT = 10.0
"""Below this height the specification gives no lengths; those of this height are used."""
ROUGHNESS_FT = 0.15
"""Roughness length of the specification's wind profile, terminal flight phases (category C)."""


@dataclass(frozen=True)
class Dryden:
    """Mean wind with Dryden turbulence (MIL-F-8785C, 3.7.2 to 3.7.3: low altitude).

    w20_m_s is the wind 20 ft above ground; the mean at height_m follows from the logarithmic profile. The turbulence is
    advected past the vehicle at the sum of the mean wind and flight_speed_m_s. Near the structure it grows by near_gain
    exp(-distance / near_m). from_deg counts counter-clockwise from the world's x axis.
    """

    w20_m_s: Annotated[float, Interval(gt=0, le=FASTEST_M_S)] = 3.0
    from_deg: Angle = 0.0
    height_m: Annotated[float, Interval(gt=0, le=LOW_M)] = 3.0
    flight_speed_m_s: Annotated[float, Interval(gt=0, le=FASTEST_M_S)] = 0.5
    near_gain: Annotated[float, Interval(ge=0, le=10)] = 0.0
    near_m: Annotated[float, Interval(gt=0, le=1000)] = 1.0

    def __post_init__(self) -> None:
        refuse_idle(self, {"near_m": ("near_gain",)})

    @property
    def mean_m_s(self) -> float:
        """Mean wind at height_m."""
        height = max(self.height_m / FOOT_M, LOWEST_FT)
        return self.w20_m_s * math.log(height / ROUGHNESS_FT) / math.log(20.0 / ROUGHNESS_FT)

    @property
    def sigmas_m_s(self) -> Array:
        """Standard deviations (3,) along the mean wind, across it and upwards."""
        height = max(self.height_m / FOOT_M, LOWEST_FT)
        up = 0.1 * self.w20_m_s
        level = up / (0.177 + 0.000823 * height) ** 0.4
        return np.array([level, level, up])

    @property
    def lengths_m(self) -> Array:
        """Scale lengths (3,) along the mean wind, across it and upwards."""
        height = max(self.height_m / FOOT_M, LOWEST_FT)
        level = height / (0.177 + 0.000823 * height) ** 1.2
        return np.array([level, level, height]) * FOOT_M

    def start(self, steps: int, step_s: float, rng: np.random.Generator) -> Air:
        """Air of `steps` steps of step_s seconds."""
        speed = math.hypot(self.mean_m_s, self.flight_speed_m_s)
        lags = self.lengths_m / speed
        one_each = rng.spawn(3)  # a longer flight starts with the same wind
        u = first_order(steps, step_s, lags[0], one_each[0])
        v = second_order(steps, step_s, lags[1], one_each[1])
        w = second_order(steps, step_s, lags[2], one_each[2])
        along = downwind(self.from_deg)
        axes = np.array([along, [-along[1], along[0], 0.0], [0.0, 0.0, 1.0]])
        turbulence = exact.product(np.column_stack([u, v, w]) * self.sigmas_m_s, axes)
        mean = np.tile(self.mean_m_s * along, (steps, 1))
        return Air(read_only(mean), read_only(turbulence), self.near_gain, self.near_m)


def first_order(steps: int, step_s: float, lag_s: float, rng: np.random.Generator) -> Array:
    """Gaussian process (n,) of variance 1 with the spectrum of sqrt(2 T) / (1 + T s): the longitudinal filter."""
    decay = math.exp(-step_s / lag_s)
    white = rng.standard_normal(steps)
    noise = white * math.sqrt(-math.expm1(-2 * step_s / lag_s))
    noise[0] = white[0]
    return _filtered(noise, decay)


def second_order(steps: int, step_s: float, lag_s: float, rng: np.random.Generator) -> Array:
    """Gaussian process (n,) of variance 1 with the spectrum of sqrt(T) (1 + sqrt(3) T s) / (1 + T s)^2.

    This is the lateral and vertical filter, as the cascade z1 = w / (1 + T s), z2 = z1 / (1 + T s) with the output
    sqrt(T) (sqrt(3) z1 + (1 - sqrt(3)) z2).
    """
    from scipy.special import gammainc  # lazy: it takes 0.2 s, and every command imports this module

    x = 2 * step_s / lag_s
    # Covariance of (z1, z2) accumulated in a step, times T; gammainc(k, x) is 1 when stationary, x = inf.
    q11, q12, q22 = gammainc(1, x) / 2, gammainc(2, x) / 4, gammainc(3, x) / 4
    white = rng.standard_normal((steps, 2)).T
    n1 = np.sqrt(q11) * white[0]
    n2 = q12 / np.sqrt(q11) * white[0] + np.sqrt(q22 - q12**2 / q11) * white[1]
    n1[0], n2[0] = np.sqrt(0.5) * white[0, 0], np.sqrt(0.125) * (white[0, 0] + white[1, 0])
    decay = math.exp(-step_s / lag_s)
    z1 = _filtered(n1, decay)
    n2[1:] += step_s / lag_s * decay * z1[:-1]
    z2 = _filtered(n2, decay)
    return np.asarray(np.sqrt(3.0) * z1 + (1.0 - np.sqrt(3.0)) * z2)


def _filtered(noise: Array, decay: float) -> Array:
    """y[k] = noise[k] + decay * y[k - 1]."""
    filtered: Iterator[float] = accumulate(noise.tolist(), lambda y, x: x + decay * y)
    return np.fromiter(filtered, np.float64, len(noise))
