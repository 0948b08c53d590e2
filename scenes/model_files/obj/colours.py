"""Colours of OBJ and MTL files, which are parts of 1: those from 0 to 255 would all be white."""

import re

from uavbench.trajectories.errors import UserError

BEYOND = r"(?:[2-9]|[1-9]\d+)(?:\.\d*)?(?=\s|$)"
"""A number of 2 or more; exporters' round-off and lights that are a little beyond 1 are left."""
OF_VERTEX = re.compile(
    rb"^[ \t]*v[ \t]+(?:\S+[ \t]+){3}(?=(?:\S+[ \t]+){2}\S)(?:\S+[ \t]+){0,2}" + BEYOND.encode(), re.MULTILINE
)
"""A vertex with a colour beyond 1: three coordinates, then three numbers or more, since four are a weight."""
OF_MATERIAL = re.compile(rf"^[ \t]*Kd[ \t]+(?:\S+[ \t]+){{0,2}}{BEYOND}[^\r\n]*", re.MULTILINE | re.IGNORECASE)
LONGEST = 80
"""Characters of a line that a message shows."""


def check_colours(data: bytes, libraries: str) -> None:
    """UserError for a vertex of an OBJ file, or a diffuse colour of its libraries' text, beyond 1."""
    vertex, material = OF_VERTEX.search(data), OF_MATERIAL.search(libraries)
    if vertex is None and material is None:
        return
    line = vertex[0].decode("utf-8", "replace") if vertex else material[0] if material else ""
    raise UserError(
        f"the colour in `{line.strip()[:LONGEST]}` is beyond 1, which is full brightness; divide colours from 0 to 255 "
        "by 255"
    )
