"""The files that a model's file refers to: materials, textures, buffers, further models."""

import json
import re
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from urllib.parse import unquote

from uavbench.trajectories.source_files import stamp

REFERENCES = {
    ".obj": (re.compile(r"^[ \t]*mtllib[ \t]+(.+)$", re.MULTILINE | re.IGNORECASE), ".mtl"),
    ".mtl": (re.compile(r"^[ \t]*(?:map_\w+|bump|disp|decal|norm|refl)[ \t]+(.+)$", re.MULTILINE | re.IGNORECASE), ""),
    ".ply": (re.compile(r"^[ \t]*comment[ \t]+texturefile[ \t]+(.+)$", re.MULTILINE | re.IGNORECASE), ""),
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
    found: dict[Path, Path] = {}
    waiting = [(path, path.suffix.lower().replace(".glb", ".gltf"))]
    while waiting:
        file, kind = waiting.pop()
        if kind not in REFERENCES or not _there(file):
            continue
        for name in _named(file, stamp(file), kind):
            if _there(part := file.parent / name) and (real := part.resolve()) not in found:
                found[real] = part
                waiting.append((part, REFERENCES[kind][1]))
    return tuple(found.values())


@lru_cache(maxsize=1024)
def _named(path: Path, _: tuple[int, ...], kind: str) -> tuple[str, ...]:
    """All that the references in a file may mean."""
    matches = REFERENCES[kind][0].finditer(_text(path, kind))
    return tuple(dict.fromkeys(name for match in matches for name in _names(match[1][:LONGEST])))


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
    words = given.strip().replace("\\", "/").split(" ")
    yield from (" ".join(words[first:]) for first in range(len(words)) if words[first])
    yield from (word for word in words[:-1] if word)


def _there(path: Path) -> bool:
    try:
        return path.is_file()
    except (OSError, ValueError):  # too long for a name, or a null character in it
        return False
