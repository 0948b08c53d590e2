"""The files that a model's file refers to: materials, textures, buffers, further models."""

import json
import re
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import unquote

REFERENCES = {
    ".obj": (re.compile(r"^\s*mtllib\s+(.+?)\s*$", re.MULTILINE | re.IGNORECASE), ".mtl"),
    ".mtl": (re.compile(r"^\s*(?:map_\w+|bump|disp|decal|norm|refl)\s+(.+?)\s*$", re.MULTILINE | re.IGNORECASE), ""),
    ".ply": (re.compile(r"^\s*comment\s+texturefile\s+(.+?)\s*$", re.MULTILINE | re.IGNORECASE), ""),
    ".cao": (re.compile(r"""load\s*\(\s*["']([^"']+)["']""", re.IGNORECASE), ".cao"),
    ".gltf": (re.compile(r'"uri"\s*:\s*("(?:[^"\\]|\\.)*")'), ""),
}
"""Kind of file -> (what is a reference in it, the kind of what is referred to)."""
LONGEST = 4096
"""Characters of a reference: as many as a path may have."""
HEADER_BYTES = 1 << 16
"""As much of a PLY file as is searched: its header."""


def parts_of(path: Path) -> tuple[Path, ...]:
    """The files that a model refers to and that are there, at any depth, each once; more rather than fewer."""
    found: dict[Path, None] = {}
    waiting = [(path, path.suffix.lower().replace(".glb", ".gltf"))]
    while waiting:
        file, kind = waiting.pop()
        if kind in REFERENCES and file.is_file():
            pattern, next_kind = REFERENCES[kind]
            for match in pattern.finditer(_text(file, kind)):
                parts = [part for name in _names(match[1][:LONGEST]) if _there(part := file.parent / name)]
                waiting += [(part, next_kind) for part in parts if part not in found]
                found.update(dict.fromkeys(parts))
    return tuple(found)


def _text(path: Path, kind: str) -> str:
    """The part of a file that can hold references."""
    with path.open("rb") as file:
        if kind == ".ply":
            return file.read(HEADER_BYTES).split(b"end_header")[0].decode("utf-8", "replace")
        head = file.read(20)  # GLB: magic, version, length; length and type of its first chunk, the JSON
        text = file.read(int.from_bytes(head[12:16], "little")) if head[:4] == b"glTF" else head + file.read()
    return text.decode("utf-8", "replace")


def _names(given: str) -> Iterator[str]:
    """What a reference may mean: all of it, or what follows the options before it."""
    if given.startswith('"'):
        try:
            given = unquote(json.loads(given))
        except ValueError:
            return
        if not given.startswith("data:"):
            yield given
        return
    words = given.replace("\\", "/").split(" ")
    yield from (" ".join(words[first:]) for first in range(len(words)) if words[first])
    yield from (word for word in words[:-1] if word)


def _there(path: Path) -> bool:
    try:
        return path.is_file()
    except (OSError, ValueError):  # too long for a name, or a null character in it
        return False
