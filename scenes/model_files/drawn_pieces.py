"""The pieces of a model file as parts to be drawn: with their own texture or colour, else with a material."""

from dataclasses import replace

import numpy as np

from uavbench.scenes.materials import procedural_texture as noise
from uavbench.scenes.materials.painted import Material
from uavbench.scenes.model_files.mesh_piece import Loaded
from uavbench.scenes.primitives.solids import Solid, covered
from uavbench.scenes.renderables import STRUCTURE, Part

FINE_TRIANGLES = 20_000
"""Pieces of fewer triangles are subdivided, so that baked light has enough vertices."""


def drawn_piece(piece: Loaded, bare: Material, two_sided: bool) -> Part:
    """The piece as a renderable part: with its own texture or colour, otherwise with the material `bare`."""
    if piece.texture is not None and piece.uv is not None:
        return Part(
            vertices=piece.vertices,
            triangles=piece.triangles,
            uv=piece.uv,
            texture=piece.texture,
            tint=piece.tint,
            instance=STRUCTURE,
            name=piece.name,
            two_sided=two_sided,
        )
    longest = 3.0 if len(piece.triangles) < FINE_TRIANGLES else 1e9
    if piece.tint is None:
        plain = covered(Solid(piece.vertices, piece.triangles, bare, piece.name), longest_m=longest)
        return replace(plain, two_sided=two_sided)
    if len(piece.tint) > 1:
        longest = 1e9  # a colour per vertex, which subdivision would lose
    plain = covered(Solid(piece.vertices, piece.triangles, _grain(), piece.name), longest_m=longest)
    tint = (
        piece.tint[piece.triangles.reshape(-1)]
        if len(piece.tint) > 1
        else np.repeat(piece.tint, len(plain.vertices), 0)
    )
    return replace(plain, tint=tint, two_sided=two_sided)


def _grain() -> Material:
    """Material of faint, fixed grain on near-white, so that surfaces of plain colour are not uniform."""
    shade = 1 + 0.05 * noise.fractal((512, 512), 120, np.random.default_rng(0), octaves=7, gain=0.7)
    return Material(noise.finish(noise.paint((238.0, 238.0, 238.0), shade)), (3.0, 3.0))
