"""Texture coordinates of an OBJ file's faces: where one has none, its reader leaves the texture of all out."""

import re
from collections.abc import Container

from uavbench.trajectories.errors import UserError

COORDINATE = re.compile(rb"vt(?<![^\n]vt)[ \t]")  # a search for `^vt` stops at each character of a file
MATERIAL = re.compile(rb"usemtl(?<![^\n]usemtl)[ \t]+([^\n]*)")
PLACED = re.compile(rb"^f [^\n]*?\d/\d", re.MULTILINE)
BARE = re.compile(rb"^f (?:[^\n]*?[ \t])??\d+(?:/?(?=[ \t\n])|/?\Z|//)", re.MULTILINE)
"""A face with a corner that names no texture coordinate, as `4`, `4/` or `4//2`."""


def check_texture_places(data: bytes, textured: Container[str]) -> None:
    """UserError naming the line of a face whose material has a texture, and whose texture coordinates are missing.

    data: one line for each statement, indices from the first. Materials whose faces have no coordinates at all are
    left: their texture has no place.
    """
    count = len(COORDINATE.findall(data))
    greater = rb"0*+(?:" + _greater(count) + rb")(?!\d)"
    beyond = re.compile(rb"^f(?=[ \t])[^\n]*?[ \t]\d+/" + greater, re.MULTILINE)
    corner = rb"\d++/(?!" + greater + rb")\d++(?:/\d*+)?+(?!\S)"
    unlike = re.compile(rb"f (?<![^\n]f )(?!(?:[ \t]*+" + corner + rb")++[ \t]*+$)", re.MULTILINE)
    uses = list(MATERIAL.finditer(data))
    ends = [*(found.start() for found in uses), len(data)][1:]
    bare: dict[str, int] = {}
    placed: set[str] = set()
    for use, end in zip(uses, ends, strict=True):
        start, material = use.end(), " ".join(use[1].decode("utf-8", "replace").split())
        if material not in textured:
            continue
        if not unlike.search(data, start, end):  # all its faces have their places: one fast search tells
            if PLACED.search(data, start, end):
                placed.add(material)
            continue
        if found := beyond.search(data, start, end):
            raise UserError(
                f"line {_line(data, found)}: a face refers to a missing texture coordinate, of which the file "
                f"has {count}; export the model again"
            )
        if found := BARE.search(data, start, end):
            bare.setdefault(material, _line(data, found))
        if PLACED.search(data, start, end):
            placed.add(material)
    for material in [name for name in bare if name in placed]:
        raise UserError(
            f"line {bare[material]}: a face has no texture coordinates, and others of its material {material} "
            "have; unwrap it, or give it a material without texture"
        )


def _greater(count: int) -> bytes:
    """Pattern of the numbers above `count`, without zeros before them."""
    digits = str(count)
    more = [rf"[1-9]\d{{{len(digits)},}}"]
    for k, digit in enumerate(digits):
        if digit < "9":
            more.append(rf"{digits[:k]}[{int(digit) + 1}-9]\d{{{len(digits) - k - 1}}}")
    return "|".join(more).encode()


def _line(data: bytes, found: re.Match[bytes]) -> int:
    return data.count(b"\n", 0, found.start()) + 1
