"""The water surface of a river: level, with ripples, and planar reflections by the renderer."""

import numpy as np

from uavbench.scenes.materials import procedural_texture as noise
from uavbench.scenes.primitives.meshes import grid
from uavbench.scenes.renderables import Part, Texture
from uavbench.scenes.rendering.shaders import RIPPLE_SLOPE
from uavbench.scenes.site.terrain import BANK_SLOPE, STEP_M, WATER_M, Terrain

BODY = (0.020, 0.030, 0.018)
"""Linear RGB albedo of the water body of a green, moderately turbid river (Mobley 1994, chapter 3)."""
SLOPE_RMS = 0.039
"""Rms slope of the ripples along each axis: a mean square slope of 0.003 in total, for calm air (Cox & Munk 1954)."""
TILE_M, TILE_PX = 8.0, 512
LARGEST_M, OCTAVES = 2.0, 7
"""Size of the largest ripples, metres, and how often it is halved, with slopes of equal RMS: down to 3 cm, by eye.
Reflections in larger ripples alone are blots with sharp edges."""
FAR_M = 400.0


def surface(terrain: Terrain, rng: np.random.Generator) -> Part:
    """The water surface between the banks of the terrain's river, with ripples."""
    course = terrain.course
    assert course is not None
    half = course.half_m - BANK_SLOPE * WATER_M + 0.1
    far = np.geomspace(STEP_M, FAR_M, 24)
    low, high = terrain.bounds[0, 1] - 4, terrain.bounds[1, 1] + 4
    ys = np.unique(np.concatenate([low - far, np.arange(low, high, STEP_M), high + far]))
    xs = np.linspace(-half, half, 7)
    axes = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])
    vertices, triangles, _ = grid(np.array([course.centre_m, 0.0, -WATER_M]), *axes, xs, ys)
    vertices[:, 0] += course.aside(vertices[:, 1])
    n = len(vertices)
    return Part(
        vertices=vertices,
        triangles=triangles,
        normals=np.tile([0.0, 0.0, 1.0], (n, 1)),
        uv=vertices[:, :2] / TILE_M,
        tint=np.column_stack([np.tile(BODY, (n, 1)), np.ones(n)]),
        roughness=0.2,
        casts_shadow=False,
        ripples=ripples(rng),
    )


def ripples(rng: np.random.Generator) -> Texture:
    """Slope texture of a gently rippled surface, 8 m square: isotropic noise with features of 2 m to 0.03 m."""
    height = noise.fractal((TILE_PX, TILE_PX), LARGEST_M / TILE_M * TILE_PX, rng, OCTAVES, gain=0.5)
    slopes = [np.roll(height, -1, axis) - np.roll(height, 1, axis) for axis in (1, 0)]
    scaled = [SLOPE_RMS / float(slope.std()) * slope for slope in slopes]
    codes = [np.rint(np.clip(slope / RIPPLE_SLOPE, -127, 127) + 128) for slope in scaled]
    return np.dstack([*codes, np.full_like(codes[0], 255)]).astype(np.uint8)
