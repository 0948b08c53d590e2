"""A structure from a model file: placed, validated before anything is rendered, and drawn."""

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Interval

from uavbench.scenes.materials import painted as materials
from uavbench.scenes.materials.painted import Material
from uavbench.scenes.model_files.drawn_pieces import drawn_piece
from uavbench.scenes.model_files.mesh_checks import check
from uavbench.scenes.model_files.mesh_piece import Loaded, whole
from uavbench.scenes.model_files.model_reading import read
from uavbench.scenes.model_files.referenced_files import parts_of
from uavbench.scenes.primitives.meshes import TriangleMesh
from uavbench.scenes.renderables import BuiltStructure
from uavbench.scenes.structure import CREASE_ANGLE_DEG, Structure
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.geometry.winding import wound_against

UNITS_M = {"m": 1.0, "mm": 0.001, "cm": 0.01, "in": 0.0254, "ft": 0.3048}
Z_FROM_Y_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
FARTHEST_M = 5e5
"""Farthest coordinate of a model that keeps its origin; at 1,400 km rays no longer tell it from the floor."""
FEWEST_OF_A_SCAN = 2_000
"""Triangles of a mesh that may be a scan: fewer hold some ten patches of which the noise could be told."""
MOSTLY_NOISE = 0.5
"""Part of a mesh's edges explained by its noise from which a user is told: 0.7 to 0.9 in scans, 0 in our models."""


@dataclass(frozen=True)
class MeshFile:
    """A structure from a model file, placed on the ground and centred above the origin unless `keep_origin`.

    up is the file's upward axis (auto: y for glTF, as its specification says, z for other formats). Edges between faces
    whose normals differ by less than crease_angle_deg, and edges shorter than min_edge_m, are not given to trackers. An
    open mesh is rejected unless allow_open, an inside-out one unless flip; triangles wound against their neighbours are
    turned. surface is the material of pieces without texture or colour.
    """

    path: str
    unit: Literal["m", "mm", "cm", "in", "ft"] = "m"
    up: Literal["auto", "y", "z"] = "auto"
    crease_angle_deg: Annotated[float, Interval(gt=0, lt=180)] = CREASE_ANGLE_DEG
    min_edge_m: Annotated[float, Ge(0)] = 0.0
    keep_origin: bool = False
    allow_open: bool = False
    flip: bool = False
    surface: Literal["concrete", "brick", "painted-steel", "panels", "plaster"] = "concrete"

    @property
    def entering_files(self) -> tuple[Path, ...]:
        """The files that the model refers to, whose content enters the sequence's hash."""
        return parts_of(Path(self.path))

    def build(self, rng: np.random.Generator) -> BuiltStructure:
        """The structure; UserError naming the file, the defect, and the config key that resolves it."""
        return self._of(lambda: materials.PAINTS[self.surface](rng))

    def unpainted(self) -> BuiltStructure:
        """The structure in one plain material: its geometry without the time of painting."""
        return self._of(lambda: materials.UNPAINTED)

    def shape(self) -> Structure:
        """The structure without its parts to be drawn: an OBJ file's materials are not read, and may be missing.

        UserError as `build`.
        """
        return self._structure_of(self._placed_pieces(coloured=False))

    def mesh(self) -> TriangleMesh:
        """The triangles of the file in their place, without a search for faces and edges; UserError as `build`."""
        return whole(self._placed_pieces(coloured=False))

    def _of(self, painted: Callable[[], Material]) -> BuiltStructure:
        pieces = self._placed_pieces(coloured=True)
        structure, bare = self._structure_of(pieces), painted()
        drawn = [piece for piece in (piece.without_flat() for piece in pieces) if len(piece.triangles)]
        return BuiltStructure(structure, tuple(drawn_piece(piece, bare, self.allow_open) for piece in drawn))

    def _structure_of(self, pieces: list[Loaded]) -> Structure:
        """The structure of the file's pieces in their place; UserError naming the file and the defect."""
        path = Path(self.path)
        vertices, triangles = whole(pieces)
        try:
            structure = Structure.from_mesh(vertices, triangles, self.crease_angle_deg, self.min_edge_m)
        except ValueError as error:
            raise UserError(f"{path}: cannot find the faces of this mesh: {error}") from None
        if not len(structure.edges):
            raise UserError(
                f"{path}: no edge is left for trackers; lower crease_angle_deg ({self.crease_angle_deg}) or "
                f"min_edge_m ({self.min_edge_m})"
            )
        self._warn_of_noise(structure)
        return structure

    def _warn_of_noise(self, structure: Structure) -> None:
        if len(structure.triangles) < FEWEST_OF_A_SCAN:
            return
        from uavbench.scenes.scans.roughness import roughness  # lazy: its kernels are compiled for scans alone

        angle_deg = min(self.crease_angle_deg, CREASE_ANGLE_DEG)  # a larger one makes no fewer scans
        found = roughness(structure.vertices, structure.triangles, angle_deg)
        if found.share > MOSTLY_NOISE:
            warnings.warn(
                f"{self.path}: {100 * found.share:.0f} % of its edges of {angle_deg:g} degrees or more are noise, as "
                f"of a scan: its surface is rough by {1000 * found.noise_m:.2g} mm, by which its triangles turn by "
                f"{found.turn_deg:.0f} degrees, and trackers take that for edges of the structure; find its planes, "
                f"whose borders are edges: uavbench planes {self.path} --out model.obj",
                stacklevel=2,
            )

    def _placed_pieces(self, *, coloured: bool) -> list[Loaded]:
        """The pieces of the file in their place; UserError naming the file and the defect."""
        path = Path(self.path)
        if path.suffix.lower() == ".ifc" and self.unit != "m":
            raise UserError(f'{path}: IFC names its own unit, and is read in metres; delete unit = "{self.unit}"')
        pieces = _in_agreement([self._placed(piece) for piece in read(path, coloured=coloured)])
        vertices, triangles = whole(pieces)
        check(path, vertices, triangles, allow_open=self.allow_open)
        if not self.keep_origin:
            low, high = vertices.min(axis=0), vertices.max(axis=0)
            shift = np.array([*((low + high) / 2)[:2], low[2]])
            pieces = [piece.moved(np.eye(3), -shift) for piece in pieces]
        elif (far_m := float(np.abs(vertices).max())) > FARTHEST_M:
            raise UserError(
                f"{path}: keep_origin = true leaves the model {far_m / 1000:,.0f} km from the origin, farther than the "
                "ground reaches; delete keep_origin from a suite's structure, or move the model in your modelling "
                "program, and by as much the poses in its frame"
            )
        return pieces

    def _placed(self, piece: Loaded) -> Loaded:
        y_up = self.up == "y" or (self.up == "auto" and Path(self.path).suffix.lower() in (".gltf", ".glb"))
        turned = piece.moved(UNITS_M[self.unit] * (Z_FROM_Y_UP if y_up else np.eye(3)), np.zeros(3))
        return turned.flipped() if self.flip else turned


def _in_agreement(pieces: list[Loaded]) -> list[Loaded]:
    """The pieces, triangles turned that are wound against their neighbours."""
    turned = wound_against(*whole(pieces))
    if not turned.any():
        return pieces
    ends = np.cumsum([len(piece.triangles) for piece in pieces])
    return [piece.turned(rows) for piece, rows in zip(pieces, np.split(turned, ends[:-1]), strict=True)]
