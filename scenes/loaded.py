"""A piece of a model as a file gives it: triangles, and what they look like."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from scenes.parts import Texture
from scenes.structure import Indices
from trajectories.pose import Array


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
        """The piece with what trimesh knows of its look: texture, colour of the material, or colours of vertices."""
        material = getattr(visual, "material", None)
        if material is None:
            if getattr(visual, "kind", None) not in ("vertex", "face"):
                return self
            colors = np.asarray(visual.vertex_colors, dtype=np.float64)
            return replace(self, tint=_linear(colors)) if len(colors) == len(self.vertices) else self
        image = getattr(material, "baseColorTexture", None) or getattr(material, "image", None)
        factor = getattr(material, "baseColorFactor", None)
        if factor is None:
            factor = getattr(material, "diffuse", None)
        uv = getattr(visual, "uv", None)
        if image is not None and uv is not None:
            texture = np.asarray(image.convert("RGB"), dtype=np.uint8)
            tint = None if factor is None else np.repeat(_linear(np.array([factor])), len(self.vertices), axis=0)
            return replace(self, uv=np.asarray(uv, dtype=np.float64), texture=texture, tint=tint)
        return self if factor is None else replace(self, tint=_linear(np.array([factor])))


def _linear(colors: Array) -> Array:
    """Tints (n, 4) of 8-bit sRGB colours (n, 3 or 4) or of factors in 0..1."""
    rgb = colors[:, :3].astype(np.float64)
    rgb = (rgb / 255.0) ** 2.2 if np.issubdtype(colors.dtype, np.integer) or rgb.max() > 1.0 else rgb
    return np.column_stack([rgb, np.ones(len(rgb))])
