"""Images embedded in a glTF file: trimesh drops those that it cannot read, and draws the piece in one colour."""

import base64
from pathlib import Path
from typing import Any
from urllib.parse import unquote

from uavbench.scenes.image_files import TEXTURES, refuse_damage, size_px
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.limits import MODEL
from uavbench.trajectories.files.reading import read_bytes

GLB_JSON = 20
"""Offset in bytes of the JSON in a GLB file: after the header of the file and that of the chunk."""
CHUNK_HEADER = 8
"""Bytes of the length and the type of a chunk."""


def check_embedded(path: Path, data: bytes, scene: dict[str, Any]) -> None:
    """UserError for an embedded image that a texture shows and that cannot be read.

    AttributeError, LookupError, TypeError or ValueError for a header that refers to what is not there.
    """
    images = scene.get("images", [])
    for source in sorted({texture["source"] for texture in scene.get("textures", []) if "source" in texture}):
        image = images[source]
        content = _content(path, image, scene, data)
        if content is None:
            continue
        try:
            size_px(path, content, TEXTURES)
            refuse_damage(path, content)
        except UserError:
            name = image.get("name") or image.get("mimeType") or "without a name"
            raise UserError(
                f"{path}: its image {source} ({name}) is damaged, too large, or not one of {', '.join(TEXTURES)}; "
                "embed it as PNG or JPEG"
            ) from None


def _content(path: Path, image: dict[str, Any], scene: dict[str, Any], data: bytes) -> bytes | None:
    """Bytes of an embedded image; None for one in a file of its own."""
    if "bufferView" not in image:
        return _decoded(image["uri"]) if image["uri"].startswith("data:") else None
    view = scene["bufferViews"][image["bufferView"]]
    uri = scene["buffers"][view["buffer"]].get("uri")
    if uri is None:
        first = GLB_JSON + int.from_bytes(data[12:16], "little") + CHUNK_HEADER
        whole = data[first : first + int.from_bytes(data[first - CHUNK_HEADER : first - 4], "little")]
    else:
        whole = _decoded(uri) if uri.startswith("data:") else _beside(path, uri)
    offset = view.get("byteOffset", 0)
    return whole[offset : offset + view["byteLength"]]


def _decoded(uri: str) -> bytes:
    """Content of a data URI."""
    return base64.b64decode(uri.partition(",")[2])


def _beside(path: Path, uri: str) -> bytes:
    """Content of a file in the model's folder."""
    return read_bytes(path.parent / unquote(uri), MODEL, inside=path.parent)
