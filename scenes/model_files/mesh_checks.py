"""Validation of a user's model before it is rendered, and where possible before it is parsed."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import unquote

import numpy as np

from uavbench.scenes.model_files.face_limits import MOST_TRIANGLES, check_count
from uavbench.scenes.model_files.gltf.features import check_features
from uavbench.scenes.model_files.gltf.images import GLB_JSON, check_embedded
from uavbench.scenes.model_files.obj.materials import LIBRARY, libraries, texture_lines
from uavbench.scenes.model_files.referenced_files import is_beside, is_there, read_library, textures_of
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.limits import MODEL, MOST_PIXELS
from uavbench.trajectories.files.reading import json_value
from uavbench.trajectories.geometry.winding import first_of_equal, merged
from uavbench.trajectories.pose import Array

MOST_MATERIALS = 2_000
"""Materials of a file, and textures of glTF: each becomes a piece, and trimesh's time is quadratic in them (2 s)."""
MOST_NODES = 20_000
"""Nodes of a glTF file and the pieces that they place: each is drawn by itself, in large buildings some thousand."""
MOST_LEVELS = 100
"""Levels of a glTF file's nodes: an assembly has 10, a skeleton 30; trimesh's time is quadratic in them."""
MOST_VALUES = MODEL.most_bytes // 4
"""Numbers in all accessors of a glTF file: those that fit into it as float32; accessors without bytes are zeros."""
VALUES = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
"""Numbers of an element of an accessor by its type."""
MOST_CHUNKS = 16
"""Chunks of a GLB file: one of JSON, one of numbers, and those of extensions, of which none is in use."""
LARGEST_M, SMALLEST_M = 2000.0, 0.02
COARSEST = 1e-4
"""Coarsest step of stored coordinates, in extents of the model: 1 mm of 10 m; in UTM coordinates it is 0.5 m."""
UNREADABLE = ("KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_texture_basisu")
"""glTF extensions for compressed meshes or images that trimesh cannot decode."""
STL_HEADER_BYTES, STL_TRIANGLE_BYTES = 84, 50
"""Bytes of a binary STL file before its triangles, the last four of which count them, and of each (3D Systems 1989)."""

STL_LAST_BYTES = 4096
"""Bytes at the end of an STL file of text that hold `endsolid`, a name, and remarks of the program behind it."""
STL_OPEN = re.compile(rb"^[ \t]*(?:solid|facet|outer|vertex|endloop|endfacet)\b", re.MULTILINE)
"""Beginning of a line that belongs to a solid without its end."""


def check(path: Path, vertices: Array, triangles: np.ndarray, *, allow_open: bool) -> None:
    """Validate a mesh of vertices (n, 3) in metres and triangles (m, 3).

    UserError when it is empty, has non-finite vertices, is too large, of implausible scale, open (unless allow_open) or
    inside out.
    """
    if len(triangles) == 0:
        raise UserError(f"{path}: the model has no triangles; export it as a surface mesh")
    check_count(path, len(triangles))
    if not np.isfinite(vertices).all():
        raise UserError(f"{path}: some vertices are not finite numbers; export the model again")
    extent = float((vertices.max(axis=0) - vertices.min(axis=0)).max())
    if extent > LARGEST_M:
        raise UserError(
            f'{path}: the model is {extent:,.0f} m large; is it in millimetres? Then set unit = "mm", '
            "or scale it to metres for uavbench track"
        )
    if extent < SMALLEST_M:
        raise UserError(
            f'{path}: the model is {extent * 1000:.3g} mm large; set unit ("m", "mm", "cm", "in", "ft"), '
            "or scale it to metres for uavbench track"
        )
    borders, volume = closedness(vertices, triangles)
    if borders and not allow_open:
        raise UserError(
            f"{path}: the mesh is open: {borders:,} of its edges have a triangle on one side only, or triangles that "
            "face opposite ways; close it in your modelling program, or accept it with allow_open = true"
        )
    if volume < 0 and not borders:
        raise UserError(
            f"{path}: the mesh is inside out (its faces look inwards); flip its normals, or set flip = true in a suite"
        )


def step_of(vertices: Array) -> float:
    """Distance of neighbouring 32-bit numbers at the largest coordinate of (n, 3); 0 where some are no such numbers."""
    single = vertices.astype(np.float32)
    return float(np.spacing(np.abs(single).max(initial=0))) if np.array_equal(single, vertices) else 0.0


def check_steps(path: Path, step: float, vertices: Array) -> None:
    """UserError where a file's numbers round its vertices (n, 3), in its unit, to steps that its shape shows."""
    extent = float(np.ptp(vertices, axis=0).max()) if len(vertices) else 0.0
    if step > COARSEST * extent:
        raise UserError(
            f"{path}: its vertices lie so far from its origin, {np.abs(vertices).max():,.0f} units, that numbers of "
            f"32 bits or few digits round them to {step:g}; move the model to the origin in your modelling program, or "
            "export OBJ with all digits"
        )


class Closedness(NamedTuple):
    """Number of directed edges without their opposite (0: closed), and signed volume, negative when inside out."""

    open_edges: int
    volume_m3: float


def closedness(vertices: Array, triangles: np.ndarray) -> Closedness:
    """Open edges and signed volume of a mesh of vertices (n, 3) in metres and triangles (m, 3).

    Identical vertices are merged first. Where edges are open, triangles that are there twice count once.
    """
    corners = merged(vertices, triangles)
    if open_edges := _open_edges(corners, len(vertices)):
        once = np.unique(first_of_equal(corners))
        triangles, open_edges = triangles[once], _open_edges(corners[once], len(vertices))
    a, b, c = (vertices[triangles[:, k]] - vertices[0] for k in range(3))
    return Closedness(open_edges, float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6))


def _open_edges(corners: np.ndarray, n: int) -> int:
    """Number of edges of triangles (m, 3) of n merged vertices that are not passed as often in both directions."""
    directed = np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]])
    directed = directed[directed[:, 0] != directed[:, 1]]
    key = np.minimum(*directed.T) * n + np.maximum(*directed.T)
    sign = np.where(directed[:, 0] < directed[:, 1], 1, -1)
    _, which = np.unique(key, return_inverse=True)
    balance = np.bincount(which.reshape(-1), weights=sign)
    return int(np.abs(balance).astype(np.int64).astype(bool).sum())


def check_file(path: Path, data: bytes, *, coloured: bool = True) -> None:
    """UserError for a file that is too large, uses an unsupported compression, or refers to a missing file.

    coloured: the materials of an OBJ file are read, so that they must be there.
    """
    kind = path.suffix.lower()
    _check_size(path, data)
    if kind == ".stl":
        _check_stl(path, data)
    scene = _gltf_scene(path, data) if kind in (".gltf", ".glb") else {}
    wanted = _obj_wants(path, data) if kind == ".obj" else _gltf_wants(path, scene) if scene else []
    for name in wanted:
        if not _beside(path, name):
            raise UserError(f"{path}: refers to {name}, which is not in the folder of the model; put it there")
        if not is_there(path.parent / name) and (coloured or kind != ".obj"):
            raise UserError(f"{path}: refers to {name}, which is missing; put it next to the model or export it again")
    with _told_as_unreadable(path):
        check_embedded(path, data, scene)
        check_features(path, scene)


def _check_stl(path: Path, data: bytes) -> None:
    """UserError for a binary STL file of other triangles than its header counts, and for text without its end."""
    header = data[:STL_HEADER_BYTES]
    if b"\0" not in header:
        _, end, behind = data.rstrip()[-STL_LAST_BYTES:].lower().rpartition(b"endsolid")
        if header.lstrip()[:5].lower() == b"solid" and (not end or STL_OPEN.search(behind.partition(b"\n")[2])):
            raise UserError(
                f"{path}: is truncated: it does not end with endsolid; copy it again, or export the model again"
            )
        return
    held = max(len(data) - STL_HEADER_BYTES, 0) // STL_TRIANGLE_BYTES
    if (told := _told(data)) != held:
        raise UserError(
            f"{path}: {'is truncated' if told > held else 'is not as it was written'}: its header counts {told:,} "
            f"triangles, and it holds {held:,}; copy it again, or export the model again"
        )


def without_padding(data: bytes) -> bytes:
    """A binary STL file up to its last triangle: with bytes behind it, trimesh takes it for text without triangles."""
    return data[: STL_HEADER_BYTES + STL_TRIANGLE_BYTES * _told(data)] if b"\0" in data[:STL_HEADER_BYTES] else data


def _told(data: bytes) -> int:
    """Number of triangles by the header of a binary STL file."""
    return int.from_bytes(data[STL_HEADER_BYTES - 4 : STL_HEADER_BYTES], "little")


def _beside(path: Path, name: str) -> bool:
    """Whether a referenced file lies in the model's folder, with symbolic links resolved."""
    try:
        return (path.parent / name).resolve().is_relative_to(path.parent.resolve())
    except (OSError, ValueError, RuntimeError):  # a null character, a cycle of links
        return False


def _obj_wants(path: Path, data: bytes) -> list[str]:
    """Material libraries that an OBJ file refers to, and their textures; UserError for too many materials."""
    joined = data.replace(b"\\\r\n", b"").replace(b"\\\n", b"")  # lines that a backslash continues
    _check_materials(path, len({name.strip() for name in re.findall(rb"usemtl ([^\r\n]*)", joined)}))
    wanted: list[str] = []
    _check_materials(path, len(set(LIBRARY.findall(data))))
    for library in libraries(data, partial(is_beside, path.parent)):
        wanted.append(library)
        if is_beside(path.parent, library):
            _check_materials(path, len(texture_lines(read_library(path.parent, library))))
            try:
                wanted += textures_of(path.parent, library)
            except UserError as error:
                raise UserError(f"{path}: {library}: {error}") from None
    return wanted


def _check_materials(path: Path, count: int) -> None:
    if count > MOST_MATERIALS:
        raise UserError(
            f"{path}: {count:,} materials are more than the {MOST_MATERIALS:,} that can be handled; "
            "join those that look alike"
        )


def _gltf_scene(path: Path, data: bytes) -> dict[str, Any]:
    """Header of a glTF file; UserError when it has none."""
    binary = data[:4] == b"glTF"  # GLB: magic, version, length; length and type of its first chunk, the JSON
    if binary:
        _check_chunks(path, data)
    text = data[GLB_JSON : GLB_JSON + int.from_bytes(data[12:16], "little")] if binary else data
    with _told_as_unreadable(path):
        return dict(json_value(text))


@contextmanager
def _told_as_unreadable(path: Path) -> Iterator[None]:
    """Raise UserError for any error of a header whose values are not as glTF has them."""
    try:
        yield
    except (ValueError, AttributeError, TypeError, LookupError, OverflowError) as error:
        raise UserError(f"{path}: not a readable {path.suffix[1:]} file: {error}") from None


def _gltf_wants(path: Path, scene: dict[str, Any]) -> list[str]:
    """External buffers and images of a glTF file; UserError for an unsupported extension or too many triangles."""
    with _told_as_unreadable(path):
        needed = sorted(set(scene.get("extensionsRequired", [])) & set(UNREADABLE))
        entries = [*scene.get("buffers", []), *scene.get("images", [])]
        uris = [str(entry["uri"]) for entry in entries if "uri" in entry]
        accessors = scene.get("accessors", [])
        counts = [int(accessor["count"]) for accessor in accessors]
        values = sum(count * VALUES[accessor["type"]] for count, accessor in zip(counts, accessors, strict=True))
        _check_nodes(path, scene.get("nodes", []), scene.get("meshes", []))
        _check_materials(path, max(len(scene.get(key, [])) for key in ("materials", "textures", "images")))
    if needed:
        raise UserError(f"{path}: is compressed with {', '.join(needed)}; export it without compression")
    check_count(path, max(counts, default=0) // 3)
    if min(counts, default=0) < 0 or values > MOST_VALUES:
        raise UserError(f"{path}: its accessors claim more values than a model can have; export the model again")
    return [unquote(uri) for uri in uris if not uri.startswith("data:")]


def _check_chunks(path: Path, data: bytes) -> None:
    """UserError for a GLB file of more than MOST_CHUNKS chunks, which trimesh reads one by one."""
    at = 12  # after the header
    for _ in range(MOST_CHUNKS):
        at += 8 + int.from_bytes(data[at : at + 4], "little")
    if at < len(data):
        raise UserError(f"{path}: has more than {MOST_CHUNKS} chunks; export the model again")


def _check_nodes(path: Path, nodes: list[dict[str, Any]], meshes: list[dict[str, Any]]) -> None:
    """UserError for a glTF file of too many nodes and pieces, or whose nodes are nested too deeply or in a circle."""
    pieces = [len(mesh.get("primitives", [])) for mesh in meshes]
    children = [node.get("children", []) for node in nodes]
    count = max(len(nodes), sum(map(len, children))) + sum(pieces[node["mesh"]] for node in nodes if "mesh" in node)
    if max(count, sum(pieces)) > MOST_NODES:
        raise UserError(
            f"{path}: {max(count, sum(pieces)):,} nodes and pieces are more than the {MOST_NODES:,} that can be "
            "handled; join the meshes in your modelling program"
        )
    level = set(range(len(nodes)))
    for _ in range(MOST_LEVELS):
        level = {child for node in level for child in children[node]}
    if level:
        raise UserError(
            f"{path}: its nodes are nested deeper than {MOST_LEVELS} levels, or in a circle; "
            "export the model again without this hierarchy"
        )


def check_textures(path: Path, pixels: int) -> None:
    """UserError when the textures of a model have more than MOST_PIXELS in total."""
    if pixels > MOST_PIXELS:
        raise UserError(
            f"{path}: its textures have {pixels:,} pixels in total, more than {MOST_PIXELS:,}; scale them down"
        )


def _check_size(path: Path, data: bytes) -> None:
    """UserError when the header or a scan of the lines announces too many triangles, before they are parsed."""
    counts = {".stl": _stl_count, ".ply": _ply_count, ".obj": _obj_count, ".off": _off_count}
    check_count(path, counts.get(path.suffix.lower(), lambda _: 0)(data))


def _stl_count(data: bytes) -> int:
    count = int.from_bytes(data[80:84], "little") if len(data) >= 84 else 0
    return count if len(data) == 84 + 50 * count else data.count(b"facet normal")


def _ply_count(data: bytes) -> int:
    """Number of faces, or a third of the number of vertices or other elements if that is more."""
    header = data[:65536].split(b"end_header")[0]
    found = {name: int(count) for name, count in re.findall(rb"^element (\w+) (\d{1,18})\s*$", header, re.MULTILINE)}
    return max([found.pop(b"face", 0), *(count // 3 for count in found.values())])


def _obj_count(data: bytes) -> int:
    """Number of triangles after triangulation, or a third of the number of vertices if that is more."""
    if len(data) < 4 * MOST_TRIANGLES:
        return 0
    return max(data.count(b"\nf "), data.count(b"\nv ") // 3)


def _off_count(data: bytes) -> int:
    found = re.match(rb"\s*(?:[A-Z]*OFF)?(?:\s|#[^\n]*\n)*(\d{1,18})\s+(\d{1,18})", data[:65536])
    return max(int(found[2]), int(found[1]) // 3) if found else 0
