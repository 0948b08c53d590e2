"""A user's own structure: OBJ, STL, PLY, glTF, ViSP's CAO, IFC; checked before anything is rendered."""

import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from annotated_types import Ge, Interval

from scenes import materials, noise
from scenes.cao import read_cao
from scenes.ifc import read_ifc
from scenes.loaded import Loaded
from scenes.materials import Material
from scenes.parts import BuiltStructure, Part
from scenes.solids import Solid, covered
from scenes.structure import CREASE_ANGLE_DEG, Structure
from trajectories.errors import UserError
from trajectories.pose import Array

UNITS_M = {"m": 1.0, "mm": 0.001, "cm": 0.01, "in": 0.0254, "ft": 0.3048}
MOST_TRIANGLES = 2_000_000
FINE_TRIANGLES = 20_000
"""Pieces of fewer triangles are cut finer, so that shade can fall on them."""
LARGEST_M, SMALLEST_M = 2000.0, 0.02
Z_FROM_Y_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
TRIMESH_KINDS = (".obj", ".stl", ".ply", ".gltf", ".glb", ".off", ".3mf")


@dataclass(frozen=True)
class MeshFile:
    """A structure from a file; it is put on the ground with its middle above the origin unless `keep_origin`.

    up is the file's upward axis (auto: y for glTF, as it is defined there, z for the others). Edges between faces that
    meet at less than crease_angle_deg, and edges shorter than min_edge_m, are not given to trackers. A mesh with
    holes is refused unless allow_open; one with inward faces unless flip. surface covers what has no texture.
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

    def build(self, rng: np.random.Generator) -> BuiltStructure:
        """The structure; UserError naming the file, what is wrong with it, and the key that helps."""
        path = Path(self.path)
        pieces = [self._placed(piece) for piece in read(path)]
        vertices, triangles = _whole(pieces)
        check(path, vertices, triangles, allow_open=self.allow_open)
        if not self.keep_origin:
            low, high = vertices.min(axis=0), vertices.max(axis=0)
            shift = np.array([*((low + high) / 2)[:2], low[2]])
            pieces = [piece.moved(np.eye(3), -shift) for piece in pieces]
            vertices = vertices - shift
        try:
            structure = Structure.from_mesh(vertices, triangles, self.crease_angle_deg, self.min_edge_m)
        except ValueError as error:
            raise UserError(f"{path}: cannot find the faces of this mesh: {error}") from None
        if not len(structure.edges):
            raise UserError(
                f"{path}: no edge is left for trackers; lower crease_angle_deg ({self.crease_angle_deg}) or "
                f"min_edge_m ({self.min_edge_m})"
            )
        bare = materials.PAINTS[self.surface](rng)
        return BuiltStructure(structure, tuple(_part(piece, bare, self.allow_open) for piece in pieces))

    def _placed(self, piece: Loaded) -> Loaded:
        y_up = self.up == "y" or (self.up == "auto" and Path(self.path).suffix.lower() in (".gltf", ".glb"))
        turned = piece.moved(UNITS_M[self.unit] * (Z_FROM_Y_UP if y_up else np.eye(3)), np.zeros(3))
        return turned.flipped() if self.flip else turned


def read(path: Path) -> list[Loaded]:
    """Pieces of a mesh file as they are in it; UserError when it cannot be read."""
    kind = path.suffix.lower()
    if not path.is_file():
        raise UserError(f"{path}: no such model file")
    if kind == ".cao":
        return [read_cao(path)]
    if kind == ".ifc":
        return read_ifc(path)
    if kind not in TRIMESH_KINDS:
        raise UserError(f"{path}: cannot read models of type {kind or 'without ending'}; "
                        f"known are {', '.join((*TRIMESH_KINDS, '.cao', '.ifc'))}")  # fmt: skip
    _check_size(path)
    check_textures(path)
    import trimesh

    try:
        scene: Any = trimesh.load_scene(path, process=False)
    except Exception as error:
        raise UserError(f"{path}: not a readable {kind[1:]} file: {error}") from None
    pieces = []
    for node in scene.graph.nodes_geometry:
        matrix, name = scene.graph[node]
        mesh = scene.geometry[name]
        if isinstance(mesh, trimesh.Trimesh) and len(mesh.faces):
            if np.shape(mesh.vertices)[1:] != (3,) or int(np.max(mesh.faces)) >= len(mesh.vertices):
                raise UserError(f"{path}: a face of {name} names a vertex that is not there; export the model again")
            piece = Loaded(
                np.array(mesh.vertices, dtype=np.float64), np.array(mesh.faces, dtype=np.int64), name=str(name)
            )
            piece = piece.moved(np.array(matrix[:3, :3]), np.array(matrix[:3, 3]))
            if np.linalg.det(matrix[:3, :3]) < 0:
                piece = piece.flipped()
            pieces.append(piece.dressed(mesh.visual))
    return pieces


def check(path: Path, vertices: Array, triangles: np.ndarray, *, allow_open: bool) -> None:
    """UserError when a mesh (metres) is empty, huge, out of scale, open or inside out."""
    if len(triangles) == 0:
        raise UserError(f"{path}: the model has no triangles; export it as a surface mesh")
    if len(triangles) > MOST_TRIANGLES:
        raise UserError(
            f"{path}: {len(triangles):,} triangles are more than the {MOST_TRIANGLES:,} that can be handled; "
            "simplify the model to its planar faces (edges shorter than a few pixels do not help a tracker)"
        )
    if not np.isfinite(vertices).all():
        raise UserError(f"{path}: some vertices are not finite numbers; export the model again")
    extent = float((vertices.max(axis=0) - vertices.min(axis=0)).max())
    if extent > LARGEST_M:
        raise UserError(f'{path}: the model is {extent:,.0f} m large; is it in millimetres? Then set unit = "mm"')
    if extent < SMALLEST_M:
        raise UserError(f'{path}: the model is {extent * 1000:.3g} mm large; set unit ("m", "mm", "cm", "in", "ft")')
    borders, volume = closedness(vertices, triangles)
    if borders and not allow_open:
        raise UserError(
            f"{path}: the mesh is open: {borders:,} of its edges have a triangle on one side only, or triangles that "
            "face opposite ways; close it in your modelling program, or accept it with allow_open = true"
        )
    if volume < 0 and not borders:
        raise UserError(f"{path}: the mesh is inside out (its faces look inwards); set flip = true or turn its normals")


def closedness(vertices: Array, triangles: np.ndarray) -> tuple[int, float]:
    """How many directed edges lack their opposite once equal vertices are one, and the enclosed volume (m3)."""
    scale = max(float(np.ptp(vertices, axis=0).max()), 1e-9)
    _, same = np.unique(np.round(vertices / (1e-7 * scale)), axis=0, return_inverse=True)
    corners = same.reshape(-1)[triangles].astype(np.int64)
    directed = np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]])
    directed = directed[directed[:, 0] != directed[:, 1]]
    n = len(vertices)
    key = np.minimum(*directed.T) * n + np.maximum(*directed.T)
    sign = np.where(directed[:, 0] < directed[:, 1], 1, -1)
    _, which = np.unique(key, return_inverse=True)
    balance = np.bincount(which.reshape(-1), weights=sign)
    a, b, c = (vertices[triangles[:, k]] - vertices[0] for k in range(3))
    return int(np.abs(balance).astype(np.int64).astype(bool).sum()), float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


def check_textures(path: Path) -> None:
    """UserError naming the first file that a model refers to (material, image) and that is not there, or elsewhere."""
    kind, wanted = path.suffix.lower(), []
    if kind == ".obj":
        for library in re.findall(r"^mtllib\s+(.+?)\s*$", path.read_text("utf-8", "replace"), re.MULTILINE):
            wanted.append(library)
            if _beside(path, library) and (path.parent / library).is_file():
                text = (path.parent / library).read_text("utf-8", "replace")
                wanted += [line.split()[-1] for line in re.findall(r"^\s*map_K[da]\s+(.+?)\s*$", text, re.MULTILINE)]
    elif kind == ".gltf":
        uris = re.findall(r'"uri"\s*:\s*"([^"]+)"', path.read_text("utf-8", "replace"))
        wanted = [uri.replace("%20", " ") for uri in uris if not uri.startswith("data:")]
    for name in wanted:
        if not _beside(path, name):
            raise UserError(f"{path}: refers to {name}, which is not in the folder of the model; put it there")
        if not (path.parent / name).is_file():
            raise UserError(f"{path}: refers to {name}, which is not there; put it beside the model or export it again")


def _beside(path: Path, name: str) -> bool:
    """Whether a file that a model refers to lies in the model's folder, links followed."""
    return (path.parent / name).resolve().is_relative_to(path.parent.resolve())


def _check_size(path: Path) -> None:
    """UserError from the header or a glance at the lines, before millions of triangles fill the memory."""
    count = {".stl": _stl_count, ".ply": _ply_count, ".obj": _obj_count}.get(path.suffix.lower(), lambda _: 0)(path)
    if count > MOST_TRIANGLES:
        check(path, np.zeros((1, 3)), np.broadcast_to(np.int64(0), (count, 3)), allow_open=True)


def _stl_count(path: Path) -> int:
    with path.open("rb") as handle:
        head = handle.read(84)
    count = int.from_bytes(head[80:84], "little") if len(head) == 84 else 0
    return count if path.stat().st_size == 84 + 50 * count else 0


def _ply_count(path: Path) -> int:
    with path.open("rb") as handle:
        found = re.search(rb"^element face (\d+)\s*$", handle.read(65536).split(b"end_header")[0], re.MULTILINE)
    return int(found[1]) if found else 0


def _obj_count(path: Path) -> int:
    if path.stat().st_size < 4 * MOST_TRIANGLES:
        return 0
    with path.open("rb") as handle:
        return sum(line.startswith(b"f ") for line in handle)


def _whole(pieces: list[Loaded]) -> tuple[Array, np.ndarray]:
    if not pieces:
        return np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64)
    shift = np.cumsum([0] + [len(p.vertices) for p in pieces[:-1]])
    triangles = np.concatenate([p.triangles + n for p, n in zip(pieces, shift, strict=True)])
    return np.concatenate([p.vertices for p in pieces]), triangles


def _part(piece: Loaded, bare: Material, two_sided: bool) -> Part:
    """The piece as it is drawn: with its own texture and colour, or covered with a material."""
    if piece.texture is not None and piece.uv is not None:
        return Part(
            vertices=piece.vertices,
            triangles=piece.triangles,
            uv=piece.uv,
            texture=piece.texture,
            tint=piece.tint,
            instance=1,
            name=piece.name,
            two_sided=two_sided,
        )
    longest = 3.0 if len(piece.triangles) < FINE_TRIANGLES else 1e9
    if piece.tint is None:
        plain = covered(Solid(piece.vertices, piece.triangles, bare, piece.name), longest_m=longest)
        return replace(plain, two_sided=two_sided)
    if len(piece.tint) > 1:
        longest = 1e9  # a colour at each corner: cutting would lose them
    plain = covered(Solid(piece.vertices, piece.triangles, _grain(), piece.name), longest_m=longest)
    tint = (
        piece.tint[piece.triangles.reshape(-1)]
        if len(piece.tint) > 1
        else np.repeat(piece.tint, len(plain.vertices), 0)
    )
    return replace(plain, tint=tint, two_sided=two_sided)


def _grain() -> Material:
    """Faint grain over a plain colour, always the same, so that a coloured wall is not a flat tone."""
    shade = 1 + 0.05 * noise.fractal((512, 512), 120, np.random.default_rng(0), octaves=7, gain=0.7)
    return Material(noise.finish(noise.paint((238.0, 238.0, 238.0), shade)), (3.0, 3.0))
