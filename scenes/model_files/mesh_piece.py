"""A piece of a model as read from a file: triangles and their appearance."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from uavbench.scenes.primitives.meshes import TriangleMesh
from uavbench.scenes.renderables import Texture
from uavbench.scenes.structure import Indices
from uavbench.trajectories.pose import Array

UNSAID = (102, 102, 102, 255)
"""Default diffuse colour of trimesh for a material without one."""


@dataclass(frozen=True, eq=False)
class Loaded:
    """Vertices (n, 3), triangles (m, 3), and, where the file has them, uv (n, 2) with a texture, tint (n or 1, 4)."""

    vertices: Array
    triangles: Indices
    uv: Array | None = None
    texture: Texture | None = None
    tint: Array | None = None
    name: str = ""

    def moved(self, matrix: Array, shift: Array) -> "Loaded":
        """The piece with its vertices mapped to matrix (3, 3) @ vertex + shift (3,)."""
        return replace(self, vertices=self.vertices @ matrix.T + shift)

    def flipped(self) -> "Loaded":
        """The piece with the orientation of its triangles reversed."""
        return replace(self, triangles=self.triangles[:, ::-1])

    def turned(self, rows: NDArray[np.bool_]) -> "Loaded":
        """The piece with the orientation of the triangles of a mask (m,) reversed."""
        return replace(self, triangles=np.where(rows[:, None], self.triangles[:, ::-1], self.triangles))

    def without_flat(self) -> "Loaded":
        """The piece without triangles of no area, which are not visible and have no normal."""
        a, b, c = (self.vertices[self.triangles[:, k]] for k in range(3))
        flat = np.linalg.norm(np.cross(b - a, c - a), axis=1) == 0
        return replace(self, triangles=self.triangles[~flat]) if flat.any() else self

    def dressed(self, visual: Any, *, linear: bool = False) -> "Loaded":
        """The piece with the appearance from a trimesh visual: texture, material colour or vertex colours.

        linear: whether vertex colours are proportions of light, as in glTF, where they multiply the material's colour
        and texture. The colour factor of a texture applies to glTF only: Kd next to map_Kd in an MTL file depends on
        the exporter.
        """
        material = getattr(visual, "material", None)
        if material is None:
            if getattr(visual, "kind", None) not in ("vertex", "face"):
                return self
            colors = np.asarray(visual.vertex_colors)
            power = 1.0 if linear else 2.2
            return replace(self, tint=_linear(colors, power)) if len(colors) == len(self.vertices) else self
        physical = hasattr(material, "baseColorFactor")
        image = material.baseColorTexture if physical else getattr(material, "image", None)
        factor = material.baseColorFactor if physical else getattr(material, "diffuse", None)
        if not physical and factor is not None and np.array_equal(factor, UNSAID):
            factor = None
        if image is not None and is_made_up(material, image):
            return self
        color = None if factor is None else _linear(np.array([factor]), power=1.0 if physical else 2.2)
        painted = visual.vertex_attributes.get("color") if physical else None
        if painted is not None and (shares := _shares(painted)).min(initial=1.0) < 1:  # white ones change nothing
            color = shares * (1.0 if color is None else color)
        uv = getattr(visual, "uv", None)
        if image is None or uv is None:
            return self if color is None else replace(self, tint=color)
        holes = physical and getattr(material, "alphaMode", None) == "MASK"
        return replace(
            self,
            uv=np.asarray(uv, dtype=np.float64),
            texture=np.asarray(_of_8_bits(image).convert("RGBA" if holes else "RGB"), dtype=np.uint8),
            tint=color * np.ones((len(self.vertices), 1)) if physical and color is not None else None,
        )


def whole(pieces: list[Loaded]) -> TriangleMesh:
    """The triangles of all pieces; vertices are not merged."""
    if not pieces:
        return TriangleMesh(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64))
    shift = np.cumsum([0] + [len(p.vertices) for p in pieces[:-1]])
    triangles = np.concatenate([p.triangles + n for p, n in zip(pieces, shift, strict=True)])
    return TriangleMesh(np.concatenate([p.vertices for p in pieces]), triangles)


def _of_8_bits(image: Image.Image) -> Image.Image:
    """A grey image of 16 bits with 8; Pillow's conversion to RGB makes white of all that is above 255 of 65,535.

    ValueError for floating-point samples, of which it is not known which is white.
    """
    if image.mode == "F":
        raise ValueError("the samples of its texture are floating-point numbers; save it with 8 bits")
    return Image.fromarray((np.asarray(image) >> 8).astype(np.uint8)) if image.mode.startswith("I") else image


def is_made_up(material: Any, image: Any) -> bool:
    """Whether an image comes from no file: trimesh's for texture coordinates of an OBJ file without a material."""
    return image.format is None and not hasattr(material, "baseColorFactor")


def _shares(colors: NDArray[Any]) -> Array:
    """Tints (n, 4) from the colours (n, 3 or 4) of a glTF file: floats, or integers as parts of the largest one."""
    rgb = np.asarray(colors)[:, :3]
    whole = float(np.iinfo(rgb.dtype).max) if np.issubdtype(rgb.dtype, np.integer) else 1.0
    return np.column_stack([rgb / whole, np.ones(len(rgb))])


def _linear(colors: Array, power: float = 2.2) -> Array:
    """Tints (n, 4) from colours (n, 3 or 4), 8-bit or 0..1; power 1 for linear ones, such as the factors of glTF."""
    rgb = colors[:, :3].astype(np.float64)
    rgb = rgb / 255.0 if np.issubdtype(colors.dtype, np.integer) or rgb.max() > 1.0 else rgb
    return np.column_stack([rgb**power, np.ones(len(rgb))])
