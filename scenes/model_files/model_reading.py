"""The pieces of a model file in its own unit and axes: CAO and IFC by their readers, all other types by trimesh.

trimesh misreads or leaves out some of what a file may hold, without a word: each file is checked, and rewritten in
forms that trimesh knows, before it is handed over.
"""

import io
import logging
from codecs import BOM_UTF8
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from uavbench.scenes.image_files import TEXTURES
from uavbench.scenes.model_files.cao.reading import read_cao
from uavbench.scenes.model_files.face_limits import check_count
from uavbench.scenes.model_files.ifc import read_ifc
from uavbench.scenes.model_files.mesh_checks import check_file, check_steps, check_textures, step_of, without_padding
from uavbench.scenes.model_files.mesh_piece import Loaded, is_made_up, whole
from uavbench.scenes.model_files.obj.digits import written_step
from uavbench.scenes.model_files.obj.faces import with_triangles
from uavbench.scenes.model_files.obj.materials import TextureMap
from uavbench.scenes.model_files.obj.plain_lines import with_plain_lines
from uavbench.scenes.model_files.obj.texture_places import check_texture_places
from uavbench.scenes.model_files.ply_colours import check_ply_colours
from uavbench.scenes.model_files.polygons.off import as_obj
from uavbench.scenes.model_files.polygons.ply import triangles_of
from uavbench.scenes.model_files.polygons.ply_elements import with_plain_elements
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.limits import MODEL
from uavbench.trajectories.files.reading import read_bytes
from uavbench.trajectories.pose import Array

if TYPE_CHECKING:
    from uavbench.scenes.model_files.model_folder import ModelFolder

CLAMPED_UV = 0.01
"""How far a texture that must not repeat may be exceeded, in texture sizes: a pixel of one of 100 px."""
TRIMESH_KINDS = (".obj", ".stl", ".ply", ".gltf", ".glb", ".off")
OF_TEXT = ".obj"
"""Type of file whose coordinates may be as whole as they look; those of the others are, or may be, 32-bit numbers."""


class Content(NamedTuple):
    """Type of a file as trimesh reads it, .obj for OFF, and its checked bytes."""

    kind: str
    data: bytes


class Placed(NamedTuple):
    """A mesh of a scene by its name, and the matrix (4, 4) that places it there."""

    name: str
    mesh: Any
    matrix: Array


class Scene(NamedTuple):
    """What trimesh read: meshes that have triangles, the folder that they refer to, and the content it was given."""

    meshes: list[Placed]
    beside: "ModelFolder"
    content: Content


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
    scene = _scene(path, _checked(path, kind, coloured), coloured)
    pieces = _pieces(path, scene)
    vertices = whole(pieces).vertices
    check_steps(path, _rounding(scene, vertices), vertices)
    return pieces


def _checked(path: Path, kind: str, coloured: bool) -> Content:
    """The content of a file, within its limits and in lines that trimesh knows."""
    data = read_bytes(path, MODEL)
    data = data.removeprefix(BOM_UTF8) if kind in (".obj", ".off") else data  # the first line would be unknown
    data = with_plain_lines(path, data) if kind == ".obj" else data
    check_file(path, data, coloured=coloured)
    if kind == ".off":
        return Content(".obj", as_obj(path, data))
    return Content(kind, without_padding(data) if kind == ".stl" else data)


def _scene(path: Path, checked: Content, coloured: bool) -> Scene:
    """The file as trimesh reads it, with the files beside it that it refers to."""
    import trimesh

    from uavbench.scenes.model_files.model_folder import ModelFolder

    kind, data = checked
    data = with_triangles(path, data) if kind == ".obj" else data
    data = with_plain_elements(path, data) if kind == ".ply" else data
    beside = ModelFolder(path.parent)
    try:
        data = beside.with_materials(data, coloured) if kind == ".obj" else data
        if beside.textures:
            check_texture_places(checked.data, beside.textures)
        with _without_tracebacks(trimesh.util.log):
            scene: Any = trimesh.load_scene(io.BytesIO(data), file_type=kind[1:], resolver=beside, process=False)
        placed = [scene.graph[node] for node in scene.graph.nodes_geometry]
    except UserError as error:
        raise UserError(f"{path}: {error}") from None
    except Exception as error:
        raise UserError(f"{path}: not a readable {kind[1:]} file: {error}; export it again, as triangles") from None
    if beside.refused:
        raise UserError(f"{path}: {beside.refused[0]}")
    meshes = [Placed(name, scene.geometry[name], matrix) for matrix, name in placed]
    meshes = [each for each in meshes if isinstance(each.mesh, trimesh.Trimesh) and len(each.mesh.faces)]
    return Scene(meshes, beside, Content(kind, data))


def _pieces(path: Path, scene: Scene) -> list[Loaded]:
    """The meshes of a scene in their place, with their appearance."""
    pieces: list[Loaded] = []
    drawn: dict[int, int] = {}
    triangles = 0
    for name, mesh, matrix in scene.meshes:
        triangles += len(mesh.faces)
        check_count(path, triangles)
        corners = np.asarray(mesh.faces)
        if np.shape(mesh.vertices)[1:] != (3,) or corners.min() < 0 or corners.max() >= len(mesh.vertices):
            raise UserError(f"{path}: a face of {name} refers to a missing vertex; export the model again")
        check_ply_colours(path, mesh)
        piece = Loaded(np.array(mesh.vertices, dtype=np.float64), triangles_of(path, mesh), name=str(name))
        piece = piece.moved(np.array(matrix[:3, :3]), np.array(matrix[:3, 3]))
        if np.linalg.det(matrix[:3, :3]) < 0:
            piece = piece.flipped()
        check_textures(path, _pixels(path, mesh.visual, drawn))
        texture = scene.beside.textures.get(_material(mesh.visual))
        pieces.append(_laid(path, _dressed(path, piece, mesh.visual), texture))
    return pieces


def _rounding(scene: Scene, vertices: Array) -> float:
    """Step to which a file's numbers round its vertices (n, 3), in its unit; 0 where they do not."""
    kind, data = scene.content
    if kind == OF_TEXT:
        return written_step(data, vertices)
    steps = (
        step_of(np.array(each.mesh.vertices, dtype=np.float64)) * float(np.linalg.norm(each.matrix[:3, :3], 2))
        for each in scene.meshes
    )
    return max(steps, default=0.0)


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
