"""Grain: contrast of surfaces of the same strength in each octave, as images of natural scenes have it."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from uavbench.scenes.materials import procedural_texture as noise
from uavbench.scenes.renderables import Part, Streams, Texture

COARSEST = 1 / 12
"""Size of the largest features, as a fraction of a texture's shorter side: larger ones would show that tiles repeat."""
FINEST_PX = 1.5
"""Least size of the smallest features, texels: what a texture can hold."""
PLAIN_PX = 64
"""A texture with a shorter side than this is a plain colour or a marking."""
GLASS = 0.3
"""Surfaces smoother than this are glass."""


def grained(parts: Iterable[Part], strength: float, streams: Streams) -> list[Part]:
    """The parts with grain in their textures, except for glass, alpha masks and plain colours.

    strength is the standard deviation of the natural log of albedo in each octave: equal in all, since amplitudes in
    natural scenes fall with the inverse of the frequency (Field 1987). Parts that share a texture share the new one.
    """
    new: dict[int, Texture] = {}
    out = []
    for part in parts:
        if strength > 0 and part.texture is not None and _takes_grain(part, part.texture):
            if id(part.texture) not in new:
                new[id(part.texture)] = _with_grain(part.texture, strength, streams)
            part = replace(part, texture=new[id(part.texture)])
        out.append(part)
    return out


def _takes_grain(part: Part, texture: Texture) -> bool:
    return not part.cutout and part.roughness >= GLASS and min(texture.shape[:2]) >= PLAIN_PX


def _with_grain(texture: Texture, strength: float, streams: Streams) -> Texture:
    """The texture times grain of unit mean: one field for each size of textures, whatever else is in the scene."""
    h, w = texture.shape[:2]
    largest = COARSEST * min(h, w)
    octaves = 1 + int(np.log2(largest / FINEST_PX))
    field = noise.fractal((h, w), largest, streams(h, w), octaves, gain=1.0)
    albedo = np.exp(np.float32(strength * np.sqrt(octaves)) * field)
    factor = np.sqrt(albedo / albedo.mean())  # of codes, which are square roots of albedo
    return noise.finish(texture.astype(np.float32) * factor[..., None])
