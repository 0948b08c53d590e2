"""Wet ground: where it is damp and where water stands, and how much darker wet ground is."""

import numpy as np

from uavbench.scenes.materials import procedural_texture as noise
from uavbench.scenes.renderables import Film

TILE_M, TILE_PX, HOLLOW_M = 32.0, 1024, 5.0
"""Size of the repeated pattern, and of its largest hollows."""
STANDING = 0.35
"""Share of the wet ground on which water stands, unless the ground soaks it up."""
DAMP_EDGE, WATER_EDGE = 0.35, 0.03
"""Half the widths of the edges of damp and of standing water, in standard deviations of the relief."""


def film(share: float, rng: np.random.Generator) -> Film:
    """The film of water on a share of the ground, in its hollows first."""
    relief = -noise.fractal((TILE_PX, TILE_PX), HOLLOW_M / TILE_M * TILE_PX, rng, octaves=7, gain=0.55)
    damp = _filled(relief, share, DAMP_EDGE)
    water = _filled(relief, STANDING * share, WATER_EDGE)
    codes = [np.rint(255 * each).astype(np.uint8) for each in (damp, water, np.zeros_like(damp))]
    return Film(np.dstack(codes), TILE_M)


def _filled(relief: noise.Image, share: float, edge: float) -> noise.Image:
    """Share of water (h, w), 1 on the highest `share` of a relief's values, with smooth edges."""
    low = float(np.quantile(relief, 1 - share)) if share < 1 else -np.inf
    t = np.clip((relief - low + edge) / (2 * edge), 0, 1)
    return np.asarray(t * t * (3 - 2 * t), dtype=np.float32)
