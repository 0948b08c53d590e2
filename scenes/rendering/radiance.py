"""Conversion between 8-bit codes and linear radiance."""

import cv2
import numpy as np
from numpy.typing import NDArray

from uavbench.scenes.rendering.pixel_kernels import code

Radiance = NDArray[np.float32]
"""Linear image (h, w, 3) BGR; 1 is the saturation of the sensor."""

RENDERED = np.square(np.arange(256, dtype=np.float32) / 255)
"""Radiance of the renderer's 8-bit codes, which are square-root coded; `square_codes` computes that of an image."""


def _srgb(light: NDArray[np.float64]) -> NDArray[np.float64]:
    """The sRGB transfer function of linear light in 0..1 (IEC 61966-2-1)."""
    return np.where(light <= 0.0031308, 12.92 * light, 1.055 * np.maximum(light, 1e-9) ** (1 / 2.4) - 0.055)


def _linear(value: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)


CODES = np.rint(255 * _srgb(np.linspace(0, 1, 16384))).astype(np.uint8)
LIGHT = _linear(np.arange(256) / 255).astype(np.float32)
"""Radiance of the 8-bit sRGB codes of an output image."""


def encode(radiance: Radiance) -> NDArray[np.uint8]:
    """8-bit sRGB image (h, w, 3) of a linear one; values outside 0..1 are clipped."""
    out = np.empty(radiance.shape, dtype=np.uint8)
    code(np.ascontiguousarray(radiance, dtype=np.float32).reshape(-1), CODES, out.reshape(-1))
    return out


def decode(image: NDArray[np.uint8]) -> Radiance:
    """Linear radiance of an 8-bit sRGB image (h, w, 3); `encode` inverts it exactly."""
    return np.asarray(cv2.LUT(image, LIGHT), dtype=np.float32)
