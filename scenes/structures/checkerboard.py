"""An upright checkerboard for camera calibration."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Gt, Interval

from uavbench.scenes.materials import procedural_texture as noise
from uavbench.scenes.materials.painted import UNPAINTED, Material
from uavbench.scenes.primitives.meshes import box
from uavbench.scenes.primitives.solids import Solid, covered, picture
from uavbench.scenes.renderables import BuiltStructure, Texture
from uavbench.scenes.structure import Structure

PX_PER_SQUARE = 64
THICKNESS_M = 0.01
BLACK, WHITE = 22, 236


@dataclass(frozen=True)
class Checkerboard:
    """A checkerboard of columns x rows inner corners, facing -y, its lower edge lift_m above the ground.

    The pattern has a white border of one square.
    """

    columns: Annotated[int, Interval(ge=2, le=50)] = 7
    rows: Annotated[int, Interval(ge=2, le=50)] = 8
    square_m: Annotated[float, Gt(0), Interval(le=2)] = 0.1
    lift_m: Annotated[float, Interval(ge=0, le=10)] = 0.0

    def build(self, rng: np.random.Generator) -> BuiltStructure:
        """The board, with the pattern as the texture of its front."""
        return self._of(self._pattern(rng))

    def unpainted(self) -> BuiltStructure:
        """The structure in one plain material: its geometry without the time of painting."""
        return self._of(UNPAINTED.texture)

    def _of(self, texture: Texture) -> BuiltStructure:
        width, height = (self.columns + 3) * self.square_m, (self.rows + 3) * self.square_m
        low, high = (-width / 2, 0.0, self.lift_m), (width / 2, THICKNESS_M, self.lift_m + height)
        vertices, triangles = box(low, high)
        paper = Material(np.full((8, 8, 3), 200, dtype=np.uint8), (1.0, 1.0), 0.9)
        pattern = Material(texture, (1.0, 1.0), 0.9)
        origin = np.array([-width / 2, -0.0005, self.lift_m])
        front = picture(origin, np.array([width, 0, 0]), np.array([0, 0, height]), pattern, inset=0.0)
        body = covered(Solid(vertices, triangles, paper, "board"))
        return BuiltStructure(Structure.from_mesh(vertices, triangles), (body, front))

    @property
    def corners_m(self) -> np.ndarray:
        """Inner corners (rows * columns, 3) in the world, metres, row by row from the upper left as seen from -y."""
        width, height = (self.columns + 3) * self.square_m, (self.rows + 3) * self.square_m
        x = -width / 2 + (2 + np.arange(self.columns)) * self.square_m
        z = self.lift_m + height - (2 + np.arange(self.rows)) * self.square_m
        grid = np.stack(np.meshgrid(x, z), axis=-1).reshape(-1, 2)
        return np.column_stack([grid[:, 0], np.full(len(grid), -0.0005), grid[:, 1]])

    def _pattern(self, rng: np.random.Generator) -> Texture:
        squares = np.full((self.rows + 3, self.columns + 3), WHITE, dtype=np.float32)
        i, j = np.mgrid[1 : self.rows + 2, 1 : self.columns + 2]
        squares[1:-1, 1:-1] = np.where((i + j) % 2 == 0, BLACK, WHITE)
        image = np.kron(squares, np.ones((PX_PER_SQUARE, PX_PER_SQUARE), dtype=np.float32))
        grain = 1 + 0.012 * noise.tiling((image.shape[0], image.shape[1]), 5, rng)
        return noise.finish(np.repeat((image * grain)[..., None], 3, axis=2))
