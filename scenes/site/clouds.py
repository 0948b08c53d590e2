"""Shadows of broken clouds: a seeded field of the sunlight that passes, across the sun's direction."""

import numpy as np

from uavbench.scenes.materials import procedural_texture as noise
from uavbench.scenes.renderables import CloudShadow

TILE_PX, CLOUDS_PER_TILE = 512, 6
EDGE = 0.35
"""Half the width of a cloud's edge, in standard deviations of the field: edges are thin and let some light pass."""


def cloud_shadow(share: float, size_m: float, wind_m_s: float, rng: np.random.Generator) -> CloudShadow:
    """Shadows that cover a share of the plane across the sun's direction, of clouds of size_m metres.

    They drift level with the wind, in a direction that is drawn.
    """
    angle = rng.uniform(0, 2 * np.pi)
    field = noise.fractal((TILE_PX, TILE_PX), TILE_PX / CLOUDS_PER_TILE, rng, octaves=4, gain=0.5)
    low, high = float(field.min()) - EDGE, float(field.max()) + EDGE
    for _ in range(30):  # the threshold at which the mean is right
        middle = (low + high) / 2
        low, high = (middle, high) if 1 - _passing(field, middle).mean() > share else (low, middle)
    code = np.rint(255 * _passing(field, (low + high) / 2)).astype(np.uint8)
    drift = (wind_m_s * float(np.cos(angle)), wind_m_s * float(np.sin(angle)), 0.0)
    return CloudShadow(np.dstack([code] * 3), CLOUDS_PER_TILE * size_m, drift)


def _passing(field: noise.Image, threshold: float) -> noise.Image:
    """Share (h, w) of the sunlight that passes where the field is below a threshold, with smooth edges."""
    t = np.clip((threshold + EDGE - field) / (2 * EDGE), 0, 1)
    return np.asarray(t * t * (3 - 2 * t), dtype=np.float32)
