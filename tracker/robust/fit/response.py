"""The light that the codes of an image stand for, learned from where edges are found.

Edges are located in light. By another response than the camera's all of them are displaced towards their bright or
their dark sides, by known functions of the light on both: where it is unknown, the response is a state that the
distances of all edges share.
"""

import math

import numpy as np

from uavbench.scenes.camera import Camera
from uavbench.tracker.robust.config.solver import BiasConfig
from uavbench.tracker.robust.solver.response_kernels import ResponseSeen
from uavbench.tracker.robust.solver.response_state import KnownResponse
from uavbench.trajectories.pose import Array

CODES = np.arange(256) / 255
NUMBERS = 2
"""Numbers of an unknown response: the logarithm of an exponent of the codes, and the height of an S-curve of them."""
SIGMA = 0.5
"""Prior standard deviation of both numbers of a camera whose response is not sRGB, 1: linear codes are at -0.8 in
the exponent, those as 3 x^2 - 2 x^3 of sRGB at -0.2 and -0.45, logarithmic ones at 0.4 and -0.3 (by least squares)."""
IS_ANOTHER = 0.5
"""Prior probability of such a camera among those of an unknown response: even odds. With 0.03 linear codes are learned
on some structures only (1.98 mm in place of 1.61 on 14 flights), and sRGB is no better than 1 %."""
DIFFERENCE = 0.01
"""Difference of a number by which light is derived, and half of that from which on edges are located by another light,
1: it moves an edge by less than 0.005 px."""
MOST_CURVE = 0.95
"""Largest height of an S-curve, 1: from 1 on it is not monotone."""


class Response:
    """State: what the frames say of the numbers of the response, information (r, r) and vector (r,), and since when
    none was asked, unasked_s.

    An unknown response is sRGB, or its numbers are normal: a spike and a slab (Mitchell & Beauchamp 1988). One that was
    told has no numbers.
    """

    def __init__(self, camera: Camera, config: BiasConfig) -> None:
        self.told, self.config = light_of_codes(camera), config
        self.numbers = n = NUMBERS if camera.response == "unknown" else 0
        self.information, self.vector = np.zeros((n, n)), np.zeros(n)
        self.at, self.light = np.full(n, np.inf), np.tile(self.told, (1 + n, 1))
        self.mean, self.covariance, self.another = np.zeros(n), np.zeros((n, n)), 0.0
        self.unasked_s = 0.0
        if n:
            self.estimate()
            self.locate()

    def learn(self, seen: ResponseSeen, dt_s: float) -> None:
        """Add what a frame says, dt_s after the previous one, relative to the light by which its edges were located."""
        if not (np.isfinite(seen.information).all() and np.isfinite(seen.vector).all()):
            return
        new = min(1.0, dt_s / self.config.correlation_s)
        kept = 1.0 - self.config.forgotten_part * new
        self.information = kept * self.information + new * seen.information
        self.vector = kept * self.vector + new * (seen.vector + seen.information @ self.at)
        self.estimate()

    def estimate(self) -> None:
        """Mean and covariance of the numbers, over both cases, and the probability `another` of the second one."""
        whole = self.information + np.eye(self.numbers) / SIGMA**2
        covariance = np.linalg.inv(whole)
        mean = covariance @ self.vector
        log_odds = math.log(IS_ANOTHER / (1.0 - IS_ANOTHER)) + 0.5 * float(self.vector @ mean)
        log_odds -= 0.5 * math.log(float(np.linalg.det(whole)) * SIGMA ** (2 * self.numbers))
        self.another = another = 1.0 / (1.0 + math.exp(-min(max(log_odds, -700.0), 700.0)))
        self.mean = another * mean
        self.covariance = another * (covariance + (1.0 - another) * np.outer(mean, mean))

    def locate(self) -> Array:
        """Choose the light by which edges are located, that of the mean; the change (r,) of the numbers."""
        moved = self.mean - self.at
        if not (np.abs(moved) > 2 * DIFFERENCE).any():
            return np.zeros(self.numbers)
        self.at = self.mean.copy()
        self.light[0] = self.light_at(self.at)
        for k, step in enumerate(DIFFERENCE * np.eye(self.numbers)):
            self.light[1 + k] = (self.light_at(self.at + step) - self.light_at(self.at - step)) / (2 * DIFFERENCE)
        return np.asarray(moved)

    def light_at(self, numbers: Array) -> Array:
        """Light (256,) of the codes by a response (r,)."""
        x, curve = CODES ** math.exp(numbers[0]), min(max(float(numbers[1]), -MOST_CURVE), MOST_CURVE)
        return np.interp(x - curve * x * (1 - x) * (1 - 2 * x), CODES, self.told)

    @property
    def known(self) -> KnownResponse:
        """What is known, relative to the light by which edges are located."""
        return KnownResponse(self.mean - self.at, self.covariance)


def light_of_codes(camera: Camera) -> Array:
    """Linear intensity (256,) of the codes of a camera, 0 to 1: what its pixels integrate."""
    if isinstance(camera.response, str):
        return CODES.copy() if camera.response == "linear" else srgb_light(CODES)
    return np.asarray(CODES ** float(camera.response))


def srgb_light(codes: Array) -> Array:
    """Linear intensity (n,) of sRGB codes (n,) in 0 to 1 (IEC 61966-2-1)."""
    return np.where(codes <= 0.04045, codes / 12.92, ((codes + 0.055) / 1.055) ** 2.4)
