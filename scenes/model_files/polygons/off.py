"""An OFF file as an OBJ file, whose faces of many corners are read right; trimesh's reader of OFF fails on some."""

import re
from pathlib import Path

from uavbench.trajectories.errors import UserError


def as_obj(path: Path, data: bytes) -> bytes:
    """The OBJ file of an OFF file's vertices and faces, each in the line in which it was; UserError when it is none."""
    lines = [line.partition(b"#")[0].split() for line in data.splitlines()]
    first = next((row for row, line in enumerate(lines) if line), None)
    if first is None or not re.fullmatch(rb"(?:ST)?C?N?OFF", lines[first][0]):
        raise UserError(f"{path}: not a readable off file: it does not begin with OFF; export the model again")
    del lines[first][0]  # the numbers may stand beside it
    places = [row for row, line in enumerate(lines) if line]
    try:
        vertices, faces = map(int, lines[places[0]][:2])
        if len(places) <= vertices + faces:
            raise ValueError(f"it tells {vertices + faces:,} lines of vertices and faces, and has {len(places) - 1:,}")
        out = [b""] * len(lines)
        for row in places[1 : vertices + 1]:
            out[row] = b"v " + b" ".join(lines[row][:3])
        for row in places[vertices + 1 :][:faces]:
            count, *corners = map(int, lines[row][: int(lines[row][0]) + 1])
            if len(corners) < count or not all(0 <= corner < vertices for corner in corners):
                raise ValueError(f"line {row + 1}: a face refers to a missing vertex")
            out[row] = b"f " + b" ".join(b"%d" % (corner + 1) for corner in corners)
    except (ValueError, IndexError) as error:
        raise UserError(f"{path}: not a readable off file: {error}; export the model again") from None
    return b"\n".join(out) + b"\n"
