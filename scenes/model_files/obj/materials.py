"""Materials of an OBJ file: which libraries and textures its lines name, and how a texture lies on the surface.

Names are read as exporters write them: with blanks, in quotes, with backslashes, or as paths of another machine.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass

from uavbench.trajectories.errors import UserError

OPTIONS = {
    **dict.fromkeys(("-blendu", "-blendv", "-bm", "-boost", "-cc", "-clamp", "-imfchan", "-texres", "-type"), (1, 1)),
    "-mm": (2, 2),
    **dict.fromkeys(("-o", "-s", "-t"), (1, 3)),
}
"""Option of a texture -> its fewest and most arguments (Wavefront, "MTL material format", 1995)."""
UNCHANGED = {"-mm": (0.0, 1.0), "-t": (0.0,)}
"""Values of options that leave a texture as it is; others would have to be baked into it."""
LONGEST = 4096
"""Greatest length of a name with its options in characters, that of a path."""
LIBRARY = re.compile(rb"^[ \t]*mtllib[ \t]+([^\r\n]*)", re.MULTILINE)
TEXTURE = re.compile(r"^[ \t]*map_kd[ \t]+([^\r\n]*)", re.MULTILINE | re.IGNORECASE)
MATERIAL = re.compile(r"^[ \t]*newmtl[ \t]+([^\r\n]*)", re.MULTILINE | re.IGNORECASE)


@dataclass(frozen=True)
class TextureMap:
    """A texture as an MTL file names it: texture coordinates are scale * uv + offset, and end at 1 if clamped."""

    name: str
    scale: tuple[float, float] = (1.0, 1.0)
    offset: tuple[float, float] = (0.0, 0.0)
    clamped: bool = False


def texture_map(text: str) -> TextureMap:
    """The texture of what follows `map_Kd`; UserError for an option that changes its colours or its place by noise."""
    left, given = text[:LONGEST].strip(), dict[str, list[str]]()
    while (found := re.match(r"(-\w+)\s+(?=\S)", left)) and found[1].lower() in OPTIONS:
        option, left = found[1].lower(), left[found.end() :]
        fewest, most = OPTIONS[option]
        given[option] = []
        while len(given[option]) < most and (word := re.match(r"(\S+)\s+(?=\S)", left)):  # the rest is the name
            if len(given[option]) >= fewest and _number(word[1]) is None:
                break
            given[option].append(word[1])
            left = left[word.end() :]
    for option, plain in UNCHANGED.items():
        if any(_number(word) != plain[min(k, len(plain) - 1)] for k, word in enumerate(given.get(option, []))):
            raise UserError(f"the option {option} of its texture {left} is not supported; bake it into the image")
    if "-imfchan" in given:
        raise UserError(f"the option -imfchan of its texture {left} is not supported; give an image of that channel")
    clamped = given.get("-clamp", ["off"]) == ["on"]
    return TextureMap(left, _pair(given.get("-s"), 1.0), _pair(given.get("-o"), 0.0), clamped)


def _number(word: str) -> float | None:
    try:
        return float(word)
    except ValueError:
        return None


def _pair(words: list[str] | None, default: float) -> tuple[float, float]:
    """The first two numbers of an option, for u and v; `default` where one is missing."""
    u, v, *_ = [*(default if (n := _number(w)) is None else n for w in words or ()), default, default]
    return u, v


def spellings(name: str) -> tuple[str, ...]:
    """Names of files that a name may mean, the most literal first; the last is the bare name of the file."""
    plain, unquoted = name.strip(), _unquoted(name)
    forward = unquoted.replace("\\", "/")
    bare = forward.partition(" #")[0].rstrip()
    return tuple(dict.fromkeys(word for word in (plain, unquoted, forward, bare, bare.rpartition("/")[2]) if word))


def found_name(name: str, is_file: Callable[[str], bool]) -> str:
    """The first spelling of a name that is a file, else the name itself without quotes."""
    return next(filter(is_file, spellings(name)), _unquoted(name))


def _unquoted(name: str) -> str:
    plain = name.strip()
    return plain[1:-1] if len(plain) > 2 and plain[0] == plain[-1] and plain[0] in "\"'" else plain


def libraries(data: bytes, is_file: Callable[[str], bool]) -> list[str]:
    """Names of the material libraries of an OBJ file, each once; a line may name several."""
    found: dict[str, None] = {}
    for line in dict.fromkeys(LIBRARY.findall(data)):
        text = line.decode("utf-8", "replace")[:LONGEST]
        name, each = found_name(text, is_file), text.split()
        several = not is_file(name) and any(any(map(is_file, spellings(word))) for word in each)
        found |= dict.fromkeys(found_name(word, is_file) for word in each) if several else {name: None}
    return list(found)


def texture_lines(library: str) -> list[str]:
    """What follows each `map_Kd` of a library's text."""
    return [line.strip() for line in TEXTURE.findall(library) if line.strip()]


def textures_by_material(library: str) -> dict[str, TextureMap]:
    """Textures of a library's text by the names of their materials; UserError as `texture_map`."""
    found: dict[str, TextureMap] = {}
    starts = list(MATERIAL.finditer(library))
    for start, end in zip(starts, [*(m.start() for m in starts[1:]), len(library)], strict=True):
        for line in texture_lines(library[start.end() : end]):
            found[" ".join(start[1].split())] = texture_map(line)
    return found


def with_plain_names(library: str, named: Callable[[str], str]) -> str:
    """A library's text whose textures have no options, and the names that `named` gives for theirs."""
    return TEXTURE.sub(lambda found: f"map_Kd {named(texture_map(found[1]).name)}" if found[1].strip() else "", library)
