"""Patches of the ground: lighter and darker, dry and lush, so large that tiles of its texture do not seem to repeat."""

from dataclasses import dataclass, replace

import numpy as np

from uavbench.scenes.materials import procedural_texture as noise
from uavbench.scenes.renderables import Part, Texture
from uavbench.trajectories.pose import Array

TILE_M, TILE_PX = 53.0, 512
"""Size of the repeated pattern: metres that are a multiple of no ground's tile, and texels."""
LARGEST_M, OCTAVES = 13.0, 5
"""Size of the largest patches, metres, and how often it is halved: below a metre, the ground's own texture goes on."""
DRY = np.array([0.4, 0.0, -0.2], dtype=np.float32)
"""Log albedo of red, green and blue where grass is dry by a standard deviation, in shares of the contrast; by eye."""


@dataclass(frozen=True, eq=False)
class Patches:
    """Factors of unit mean on the ground's albedo: a texture (h, w, 3) of shares of the greatest ones, (3,)."""

    texture: Texture
    greatest: Array

    def on(self, ground: Part) -> Part:
        """The level or shaped ground with patches; it has uv and no dirt."""
        tint = np.ones((len(ground.vertices), 4)) if ground.tint is None else ground.tint
        lighter = tint * [*self.greatest, 1.0]
        return replace(ground, soil=self.texture, soil_uv=ground.vertices[:, :2] / TILE_M, tint=lighter)


def patches(contrast: float, grows: bool, rng: np.random.Generator) -> Patches:
    """Patches whose log albedo has the standard deviation `contrast`; those of ground that grows are dry or lush."""
    shape, largest = (TILE_PX, TILE_PX), LARGEST_M / TILE_M * TILE_PX
    light, dry = (noise.fractal(shape, largest, rng, OCTAVES, gain=0.8) for _ in range(2))
    log = light[..., None] + (dry[..., None] * DRY if grows else np.zeros(3, dtype=np.float32))
    albedo = np.exp(np.float32(contrast) * log)
    albedo /= albedo.mean(axis=(0, 1))
    greatest = albedo.max(axis=(0, 1))
    return Patches(noise.finish(255 * albedo / greatest), greatest.astype(np.float64))
