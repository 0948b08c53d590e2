"""A piece of a model as a file gives it: triangles, and what they look like."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from uavbench.scenes.renderables import Texture
from uavbench.scenes.structure import Indices
from uavbench.trajectories.pose import Array

UNSAID = (102, 102, 102, 255)
"""The diffuse colour that trimesh gives a material of which the file says nothing."""


@dataclass(frozen=True, eq=False)
class Loaded:
    """Vertices (n, 3), triangles (m, 3), and if the file says so uv (n, 2) with a texture, a tint (n or 1, 4)."""

    vertices: Array
    triangles: Indices
    uv: Array | None = None
    texture: Texture | None = None
    tint: Array | None = None
    name: str = ""

    def moved(self, matrix: Array, shift: Array) -> "Loaded":
        """The piece with its vertices times matrix (3, 3) plus shift."""
        return replace(self, vertices=self.vertices @ matrix.T + shift)

    def flipped(self) -> "Loaded":
        """The piece with its faces turned to the other side."""
        return replace(self, triangles=self.triangles[:, ::-1])

    def dressed(self, visual: Any) -> "Loaded":
        """The piece with what trimesh knows of its look: texture, colour of the material, or colours of vertices.

        The factor on a texture counts in glTF alone: the Kd beside an OBJ's map is whatever its exporter leaves there.
        """
        material = getattr(visual, "material", None)
        if material is None:
            if getattr(visual, "kind", None) not in ("vertex", "face"):
                return self
            colors = np.asarray(visual.vertex_colors, dtype=np.float64)
            return replace(self, tint=_linear(colors)) if len(colors) == len(self.vertices) else self
        physical = hasattr(material, "baseColorFactor")
        image = material.baseColorTexture if physical else getattr(material, "image", None)
        factor = material.baseColorFactor if physical else getattr(material, "diffuse", None)
        if not physical and factor is not None and np.array_equal(factor, UNSAID):
            factor = None
        color = None if factor is None else _linear(np.array([factor]), power=1.0 if physical else 2.2)
        uv = getattr(visual, "uv", None)
        if image is None or uv is None:
            return self if color is None else replace(self, tint=color)
        holes = physical and getattr(material, "alphaMode", None) == "MASK"
        return replace(
            self,
            uv=np.asarray(uv, dtype=np.float64),
            texture=np.asarray(image.convert("RGBA" if holes else "RGB"), dtype=np.uint8),
            tint=np.repeat(color, len(self.vertices), axis=0) if physical and color is not None else None,
        )


def _linear(colors: Array, power: float = 2.2) -> Array:
    """Tints (n, 4) of colours (n, 3 or 4), 8 bits or in 0..1: sRGB, or (power 1) linear as the factors of glTF are."""
    rgb = colors[:, :3].astype(np.float64)
    rgb = rgb / 255.0 if np.issubdtype(colors.dtype, np.integer) or rgb.max() > 1.0 else rgb
    return np.column_stack([rgb**power, np.ones(len(rgb))])
