"""What is wrong with a user's model, told before it is rendered; where it can be, before it is read."""

import json
import re
from pathlib import Path
from urllib.parse import unquote

import numpy as np

from trajectories.errors import UserError
from trajectories.pose import Array

MOST_TRIANGLES = 2_000_000
LARGEST_M, SMALLEST_M = 2000.0, 0.02
UNREADABLE = ("KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_texture_basisu")
"""glTF extensions that pack meshes or images in ways that trimesh does not unpack."""


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


def check_file(path: Path) -> None:
    """UserError for a file that is too large, compressed in a way that cannot be read, or lacks a file it refers to."""
    _check_size(path)
    kind = path.suffix.lower()
    wanted = _obj_wants(path) if kind == ".obj" else _gltf_wants(path) if kind in (".gltf", ".glb") else []
    for name in wanted:
        if not _beside(path, name):
            raise UserError(f"{path}: refers to {name}, which is not in the folder of the model; put it there")
        if not (path.parent / name).is_file():
            raise UserError(f"{path}: refers to {name}, which is not there; put it beside the model or export it again")


def _beside(path: Path, name: str) -> bool:
    """Whether a file that a model refers to lies in the model's folder, links followed."""
    return (path.parent / name).resolve().is_relative_to(path.parent.resolve())


def _obj_wants(path: Path) -> list[str]:
    """Material libraries of an OBJ file, and the images that they name."""
    wanted = []
    for library in re.findall(r"^mtllib\s+(.+?)\s*$", path.read_text("utf-8", "replace"), re.MULTILINE):
        wanted.append(library)
        if _beside(path, library) and (path.parent / library).is_file():
            text = (path.parent / library).read_text("utf-8", "replace")
            wanted += [line.split()[-1] for line in re.findall(r"^\s*map_K[da]\s+(.+?)\s*$", text, re.MULTILINE)]
    return wanted


def _gltf_wants(path: Path) -> list[str]:
    """Buffers and images beside a glTF file; UserError when it needs an extension that cannot be read."""
    with path.open("rb") as handle:
        head = handle.read(20)  # GLB: magic, version, length; length and type of its first chunk, the JSON
        binary = head[:4] == b"glTF"
        text = handle.read(int.from_bytes(head[12:16], "little")) if binary else head + handle.read()
    try:
        scene = json.loads(text)
        needed = sorted(set(scene.get("extensionsRequired", [])) & set(UNREADABLE))
        entries = [*scene.get("buffers", []), *scene.get("images", [])]
        uris = [str(entry["uri"]) for entry in entries if "uri" in entry]
    except (ValueError, AttributeError, TypeError) as error:
        raise UserError(f"{path}: not a readable {path.suffix[1:]} file: {error}") from None
    if needed:
        raise UserError(f"{path}: is compressed with {', '.join(needed)}; export it without compression")
    return [unquote(uri) for uri in uris if not uri.startswith("data:")]


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
