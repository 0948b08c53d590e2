"""The light that the codes of an image stand for, learned from where edges are found.

Edges are located in light. By another response than the camera's all of them are displaced towards their bright or
their dark sides, by known functions of the light on both: where it is unknown, its numbers are among those that all
edges share.
"""

import math

import numpy as np

from uavbench.scenes.camera import Camera
from uavbench.trajectories.pose import Array

CODES = np.arange(256) / 255
NUMBERS = 2
"""Numbers of an unknown response: the logarithm of an exponent of the codes, and the height of an S-curve of them.
Linear codes are at -0.8 in the exponent, those as 3 x^2 - 2 x^3 of sRGB at -0.2 and -0.45, logarithmic ones at 0.4 and
-0.3 (by least squares)."""
IS_ANOTHER = 0.5
"""Prior probability of such a camera among those of an unknown response: even odds. With 0.03 linear codes are learned
on some structures only (1.98 mm in place of 1.61 on 14 flights), and sRGB is no better than 1 %."""
DIFFERENCE = 0.01
"""Difference of a number by which light is derived, 1: it moves an edge by less than 0.005 px."""
MOST_CURVE = 0.95
"""Largest height of an S-curve, 1: from 1 on it is not monotone."""


class Response:
    """State: numbers (r,) of an unknown response by which edges are located, and light (1 + r, 256) of the codes by it,
    then its derivatives. A response that was told has no numbers.
    """

    def __init__(self, camera: Camera) -> None:
        self.told, self.numbers = light_of_codes(camera), NUMBERS if camera.response == "unknown" else 0
        self.light = np.tile(self.told, (1 + self.numbers, 1))
        self.locate(np.zeros(self.numbers))

    def locate(self, numbers: Array) -> None:
        """Locate edges by the light of these numbers (r,)."""
        if not self.numbers:
            return
        self.light[0] = self.light_at(numbers)
        for k, step in enumerate(DIFFERENCE * np.eye(self.numbers)):
            self.light[1 + k] = (self.light_at(numbers + step) - self.light_at(numbers - step)) / (2 * DIFFERENCE)

    def light_at(self, numbers: Array) -> Array:
        """Light (256,) of the codes by a response (r,)."""
        x, curve = CODES ** math.exp(numbers[0]), min(max(float(numbers[1]), -MOST_CURVE), MOST_CURVE)
        return np.interp(x - curve * x * (1 - x) * (1 - 2 * x), CODES, self.told)


def light_of_codes(camera: Camera) -> Array:
    """Linear intensity (256,) of the codes of a camera, 0 to 1: what its pixels integrate."""
    if isinstance(camera.response, str):
        return CODES.copy() if camera.response == "linear" else srgb_light(CODES)
    return np.asarray(CODES ** float(camera.response))


def srgb_light(codes: Array) -> Array:
    """Linear intensity (n,) of sRGB codes (n,) in 0 to 1 (IEC 61966-2-1)."""
    return np.where(codes <= 0.04045, codes / 12.92, ((codes + 0.055) / 1.055) ** 2.4)
