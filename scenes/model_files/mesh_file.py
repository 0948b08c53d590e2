"""A structure from a model file: OBJ, STL, PLY, glTF, ViSP's CAO, IFC; validated before anything is rendered."""

import io
import logging
import warnings
from codecs import BOM_UTF8
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from annotated_types import Ge, Interval

from uavbench.scenes.image_files import TEXTURES
from uavbench.scenes.materials import painted as materials
from uavbench.scenes.materials import procedural_texture as noise
from uavbench.scenes.materials.painted import Material
from uavbench.scenes.model_files.cao.reading import read_cao
from uavbench.scenes.model_files.face_limits import check_count
from uavbench.scenes.model_files.ifc import read_ifc
from uavbench.scenes.model_files.mesh_checks import (
    check,
    check_file,
    check_steps,
    check_textures,
    step_of,
    without_padding,
)
from uavbench.scenes.model_files.mesh_piece import Loaded, is_made_up
from uavbench.scenes.model_files.obj.digits import written_step
from uavbench.scenes.model_files.obj.faces import with_triangles
from uavbench.scenes.model_files.obj.materials import TextureMap
from uavbench.scenes.model_files.obj.plain_lines import with_plain_lines
from uavbench.scenes.model_files.obj.texture_places import check_texture_places
from uavbench.scenes.model_files.ply_colours import check_ply_colours
from uavbench.scenes.model_files.polygons.off import as_obj
from uavbench.scenes.model_files.polygons.ply import triangles_of
from uavbench.scenes.model_files.polygons.ply_elements import with_plain_elements
from uavbench.scenes.model_files.referenced_files import parts_of
from uavbench.scenes.primitives.meshes import TriangleMesh
from uavbench.scenes.primitives.solids import Solid, covered
from uavbench.scenes.renderables import STRUCTURE, BuiltStructure, Part
from uavbench.scenes.structure import CREASE_ANGLE_DEG, Structure
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.limits import MODEL
from uavbench.trajectories.files.reading import read_bytes
from uavbench.trajectories.geometry.winding import wound_against
from uavbench.trajectories.pose import Array

UNITS_M = {"m": 1.0, "mm": 0.001, "cm": 0.01, "in": 0.0254, "ft": 0.3048}
FINE_TRIANGLES = 20_000
"""Pieces of fewer triangles are subdivided, so that baked light has enough vertices."""
Z_FROM_Y_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
FARTHEST_M = 5e5
"""Farthest coordinate of a model that keeps its origin; at 1,400 km rays no longer tell it from the floor."""
CLAMPED_UV = 0.01
"""How far a texture that must not repeat may be exceeded, in texture sizes: a pixel of one of 100 px."""
OF_32_BITS = (".stl", ".ply", ".gltf", ".glb")
"""Types of files whose coordinates are, or may be, 32-bit numbers; those of text may be as whole as they look."""
FEWEST_OF_A_SCAN = 2_000
"""Triangles of a mesh that may be a scan: fewer hold some ten patches of which the noise could be told."""
MOSTLY_NOISE = 0.5
"""Part of a mesh's edges explained by its noise from which a user is told: 0.7 to 0.9 in scans, 0 in our models."""
TRIMESH_KINDS = (".obj", ".stl", ".ply", ".gltf", ".glb", ".off")


@dataclass(frozen=True)
class MeshFile:
    """A structure from a model file, placed on the ground and centred above the origin unless `keep_origin`.

    up is the file's upward axis (auto: y for glTF, as its specification says, z for other formats). Edges between faces
    whose normals differ by less than crease_angle_deg, and edges shorter than min_edge_m, are not given to trackers. An
    open mesh is rejected unless allow_open, an inside-out one unless flip; triangles wound against their neighbours are
    turned. surface is the material of pieces without
    texture or colour.
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
        return self._shaped(coloured=False)[0]

    def mesh(self) -> TriangleMesh:
        """The triangles of the file in their place, without a search for faces and edges; UserError as `build`."""
        return TriangleMesh(*_whole(self._placed_pieces(coloured=False)))

    def _of(self, painted: Callable[[], Material]) -> BuiltStructure:
        structure, pieces = self._shaped()
        bare = painted()
        drawn = [piece for piece in (piece.without_flat() for piece in pieces) if len(piece.triangles)]
        return BuiltStructure(structure, tuple(_part(piece, bare, self.allow_open) for piece in drawn))

    def _shaped(self, *, coloured: bool = True) -> tuple[Structure, list[Loaded]]:
        """The structure of the file's pieces, and these in its place; UserError naming the file and the defect."""
        path = Path(self.path)
        pieces = self._placed_pieces(coloured=coloured)
        vertices, triangles = _whole(pieces)
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
        return structure, pieces

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
        vertices, triangles = _whole(pieces)
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


def read(path: Path, *, coloured: bool = True) -> list[Loaded]:
    """Pieces of a model file in its own unit and axes; UserError when it cannot be read.

    coloured: with the materials of an OBJ file, which must be there then.
    """
    kind = path.suffix.lower()
    if kind == ".cao":
        return [read_cao(path)]
    if kind == ".ifc":
        return read_ifc(path)
    if kind not in TRIMESH_KINDS:
        raise UserError(f"{path}: cannot read models of type {kind or 'without suffix'}; "
                        f"supported: {', '.join((*TRIMESH_KINDS, '.cao', '.ifc'))}")  # fmt: skip
    data = read_bytes(path, MODEL)
    data = data.removeprefix(BOM_UTF8) if kind in (".obj", ".off") else data  # the first line would be unknown
    data = with_plain_lines(path, data) if kind == ".obj" else data
    check_file(path, data, coloured=coloured)
    data = without_padding(data) if kind == ".stl" else data
    if kind == ".off":
        kind, data = ".obj", as_obj(path, data)
    plain = data
    data = with_triangles(path, data) if kind == ".obj" else data
    data = with_plain_elements(path, data) if kind == ".ply" else data
    import trimesh

    from uavbench.scenes.model_files.model_folder import ModelFolder

    beside = ModelFolder(path.parent)
    try:
        data = beside.with_materials(data, coloured) if kind == ".obj" else data
        if beside.textures:
            check_texture_places(plain, beside.textures)
        with _without_tracebacks(trimesh.util.log):
            scene: Any = trimesh.load_scene(io.BytesIO(data), file_type=kind[1:], resolver=beside, process=False)
        placed = [scene.graph[node] for node in scene.graph.nodes_geometry]
    except UserError as error:
        raise UserError(f"{path}: {error}") from None
    except Exception as error:
        raise UserError(f"{path}: not a readable {kind[1:]} file: {error}; export it again, as triangles") from None
    if beside.refused:
        raise UserError(f"{path}: {beside.refused[0]}")
    pieces: list[Loaded] = []
    drawn: dict[int, int] = {}
    triangles, step = 0, 0.0
    for matrix, name in placed:
        mesh = scene.geometry[name]
        if isinstance(mesh, trimesh.Trimesh) and len(mesh.faces):
            triangles += len(mesh.faces)
            check_count(path, triangles)
            corners = np.asarray(mesh.faces)
            if np.shape(mesh.vertices)[1:] != (3,) or corners.min() < 0 or corners.max() >= len(mesh.vertices):
                raise UserError(f"{path}: a face of {name} refers to a missing vertex; export the model again")
            check_ply_colours(path, mesh)
            piece = Loaded(np.array(mesh.vertices, dtype=np.float64), triangles_of(path, mesh), name=str(name))
            if kind in OF_32_BITS:
                step = max(step, step_of(piece.vertices) * float(np.linalg.norm(matrix[:3, :3], 2)))
            piece = piece.moved(np.array(matrix[:3, :3]), np.array(matrix[:3, 3]))
            if np.linalg.det(matrix[:3, :3]) < 0:
                piece = piece.flipped()
            check_textures(path, _pixels(path, mesh.visual, drawn))
            pieces.append(_laid(path, _dressed(path, piece, mesh.visual), beside.textures.get(_material(mesh.visual))))
    vertices = _whole(pieces)[0]
    check_steps(path, written_step(data, vertices) if kind == ".obj" else step, vertices)
    return pieces


@contextmanager
def _without_tracebacks(logger: logging.Logger) -> Iterator[None]:
    """Leave out what trimesh logs with a traceback: of files that it cannot read, `ModelFolder.refused` tells."""

    def short(record: logging.LogRecord) -> bool:
        return not record.exc_info

    logger.addFilter(short)
    try:
        yield
    finally:
        logger.removeFilter(short)


def _material(visual: Any) -> str:
    """Name of the material of a trimesh visual, "" without one."""
    return str(getattr(getattr(visual, "material", None), "name", None) or "")


def _laid(path: Path, piece: Loaded, texture: TextureMap | None) -> Loaded:
    """The piece with its texture scaled and shifted as an MTL file says; UserError for one that must not repeat."""
    if texture is None or piece.uv is None:
        return piece
    uv = piece.uv * texture.scale + texture.offset
    if texture.clamped and len(uv) and (uv.min() < -CLAMPED_UV or uv.max() > 1 + CLAMPED_UV):
        raise UserError(
            f"{path}: its texture {texture.name} has -clamp on, and faces that reach beyond it; textures repeat here, "
            "so crop these faces, or enlarge the image"
        )
    return replace(piece, uv=uv)


def _dressed(path: Path, piece: Loaded, visual: Any) -> Loaded:
    """The piece with its appearance; UserError when its texture is damaged, or its place or colour not finite."""
    try:
        dressed = piece.dressed(visual, linear=path.suffix.lower() in (".gltf", ".glb"))
    except Exception as error:  # Pillow's decoders may raise anything for damaged content
        raise UserError(f"{path}: a texture or colour is damaged: {error}; export the model again") from None
    for numbers in (dressed.uv, dressed.tint):
        if numbers is not None and not np.isfinite(numbers).all():
            raise UserError(
                f"{path}: some texture coordinates or colours are not finite numbers; export the model again"
            )
    return dressed


def _pixels(path: Path, visual: Any, drawn: dict[int, int]) -> int:
    """Total pixels of the textures so far, this piece's included; trimesh decodes textures lazily."""
    material = getattr(visual, "material", None)
    for image in (getattr(material, "baseColorTexture", None), getattr(material, "image", None)):
        if image is not None and not is_made_up(material, image):
            if image.format not in TEXTURES:
                raise UserError(f"{path}: unsupported texture type {image.format}, only {', '.join(TEXTURES)}")
            drawn[id(image)] = image.width * image.height
    return sum(drawn.values())


def _whole(pieces: list[Loaded]) -> tuple[Array, np.ndarray]:
    if not pieces:
        return np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64)
    shift = np.cumsum([0] + [len(p.vertices) for p in pieces[:-1]])
    triangles = np.concatenate([p.triangles + n for p, n in zip(pieces, shift, strict=True)])
    return np.concatenate([p.vertices for p in pieces]), triangles


def _in_agreement(pieces: list[Loaded]) -> list[Loaded]:
    """The pieces, triangles turned that are wound against their neighbours."""
    turned = wound_against(*_whole(pieces))
    if not turned.any():
        return pieces
    ends = np.cumsum([len(piece.triangles) for piece in pieces])
    return [piece.turned(rows) for piece, rows in zip(pieces, np.split(turned, ends[:-1]), strict=True)]


def _part(piece: Loaded, bare: Material, two_sided: bool) -> Part:
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
