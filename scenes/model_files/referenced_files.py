"""Files that a model file refers to: materials, textures, buffers, further models."""

import re
from collections.abc import Iterator
from functools import lru_cache, partial
from pathlib import Path
from urllib.parse import unquote

from uavbench.scenes.model_files.obj.materials import found_name, spellings, texture_lines, texture_map
from uavbench.trajectories.files.limits import MODEL, SETTINGS
from uavbench.trajectories.files.reading import json_value, read_bytes
from uavbench.trajectories.sources.digests import stamp

REFERENCES = {
    ".obj": (re.compile(r"^[ \t]*mtllib[ \t]+(.+)$", re.MULTILINE | re.IGNORECASE), ".mtl"),
    ".mtl": (re.compile(r"^[ \t]*(?:map_\w+|bump|disp|decal|norm|refl)[ \t]+(.+)$", re.MULTILINE | re.IGNORECASE), ""),
    ".ply": (re.compile(r"^[ \t]*comment[ \t]+texturefile[ \t]+(.+)$", re.MULTILINE | re.IGNORECASE), ""),
    ".cao": (re.compile(r"""load\s*\(\s*["']([^"']+)["']""", re.IGNORECASE), ".cao"),
}
"""File type -> (pattern of a reference, type of the referenced file), for models that are lines of text."""
LONGEST = 4096
"""Greatest length of a reference in characters, that of a path."""
MOST_WORDS = 64
"""Words of a reference: all options of a texture with their numbers are 40, and a name may have blanks."""
HEADER_BYTES = 1 << 16
"""Bytes of a PLY file that are searched for its header."""


def parts_of(path: Path) -> tuple[Path, ...]:
    """Existing files in a model's folder that it refers to, recursively, each once.

    Ambiguous references yield all of their interpretations: too many files rather than too few. Files elsewhere are not
    looked at: the model that refers to one is refused when it is read.
    """
    found: dict[Path, Path] = {}
    folder = path.parent.resolve()
    waiting = [(path, path.suffix.lower().replace(".glb", ".gltf"))]
    while waiting:
        file, kind = waiting.pop()
        if kind not in (*REFERENCES, ".gltf") or not is_there(file):
            continue
        for name in _named(file, stamp(file), kind):
            for part in dict.fromkeys(
                (file.parent / name, path.parent / name)
            ):  # a texture beside its library, or the model
                if not is_there(part) or (real := part.resolve()) in found:
                    continue
                if real.is_relative_to(folder):
                    found[real] = part
                    waiting.append((part, "" if kind == ".gltf" else REFERENCES[kind][1]))
    return tuple(found.values())


@lru_cache(maxsize=1024)
def _named(path: Path, _: tuple[int, ...], kind: str) -> tuple[str, ...]:
    """All interpretations of the references in a file, none in one too large to be read; cached by its stamp."""
    if path.stat().st_size > MODEL.most_bytes:
        return ()
    if kind == ".gltf":
        return tuple(dict.fromkeys(name for uri in _uris(path) for name in (uri, unquote(uri), *uri.split()[-1:])))
    matches = REFERENCES[kind][0].finditer(_text(path, kind))
    return tuple(dict.fromkeys(name for match in matches for name in _names(match[1][:LONGEST])))


def _uris(path: Path) -> Iterator[str]:
    """References anywhere in the JSON of a glTF file; none where it is invalid, and cannot be loaded either."""
    with path.open("rb") as file:
        head = file.read(20)  # GLB: magic, version, length; length and type of its first chunk, the JSON
        text = file.read(int.from_bytes(head[12:16], "little")) if head[:4] == b"glTF" else head + file.read()
    try:
        waiting = [json_value(text)]
    except ValueError:
        return
    while waiting:
        item = waiting.pop()
        if isinstance(item, dict):
            uri = item.get("uri")
            if isinstance(uri, str) and "base64," not in uri:  # which trimesh takes for the content itself
                yield uri.strip()
        if isinstance(item, dict | list):
            waiting += item.values() if isinstance(item, dict) else item


def _text(path: Path, kind: str) -> str:
    """Text of the part of a file that can hold references."""
    with path.open("rb") as file:
        data = file.read(HEADER_BYTES).split(b"end_header")[0] if kind == ".ply" else file.read()
    return data.decode("utf-8", "replace")


def _names(given: str) -> Iterator[str]:
    """Interpretations of a reference: the whole text, or what follows leading options, in all spellings."""
    words = re.split(r"(?<=\S)[ \t]", given.strip())[-MOST_WORDS:]
    for name in (*(" ".join(words[first:]) for first in range(len(words))), *words[:-1]):
        yield from spellings(name)


def is_beside(folder: Path, name: str) -> bool:
    """Whether a reference is that of a file in a model's folder, with symbolic links resolved."""
    try:
        return is_there(folder / name) and (folder / name).resolve().is_relative_to(folder.resolve())
    except (OSError, ValueError, RuntimeError):  # a null character, a cycle of links
        return False


def is_there(path: Path) -> bool:
    """Whether a reference, of any text, is that of a file."""
    try:
        return path.is_file()
    except (OSError, ValueError):  # a name that is too long, or has a null character
        return False


def read_library(folder: Path, name: str) -> str:
    """Text of a material library in the model's folder; UserError when it cannot be read."""
    return read_bytes(folder / name, SETTINGS, inside=folder).decode("utf-8", "replace")


def found_texture(folder: Path, library: str, name: str) -> str:
    """Name, from the model's folder, of a texture that a library names: beside the library, or beside the model."""
    below = Path(library).parent
    beside = str(below / found_name(name, lambda word: is_beside(folder, str(below / word))))
    return beside if is_beside(folder, beside) else found_name(name, partial(is_beside, folder))


def textures_of(folder: Path, library: str) -> list[str]:
    """Names, from the model's folder, of the textures of a library; UserError as `texture_map`."""
    lines = texture_lines(read_library(folder, library))
    return [found_texture(folder, library, texture_map(line).name) for line in lines]
