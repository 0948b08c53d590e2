"""An OBJ file's lines in the one form that its reader knows: it takes other forms for nothing, or for other faces."""

import re
from pathlib import Path

from uavbench.trajectories.errors import UserError

CONTINUED = re.compile(rb"^(?:[^\n]*\\\n)+[^\n]*", re.MULTILINE)
COMMENT_END = re.compile(rb"^([ \t]*#[^\n]*?)\\+$", re.MULTILINE)
INDENT = re.compile(rb"^[ \t]+", re.MULTILINE)
TAB = re.compile(rb"^([a-z]+)[ \t]*\t[ \t]*", re.MULTILINE)
REMARK = re.compile(rb"^((?:v|vt|vn|f) [^#\n]*)#[^\n]*", re.MULTILINE)
FROM_THE_LAST = re.compile(rb"\nf [^\n#]*-")
FROM_ZERO = re.compile(rb"f (?<![^\n]f )(?:[ \t]*+(?![+-]?0++(?![0-9.]))[^ \t\n]++)*+[ \t]*+[^ \t\n]")
"""A face up to a corner whose vertex is 0: by whole words, and found by its letter, since a file has many faces."""
COUNTED = {b"v ": 0, b"vt": 1, b"vn": 2}
"""Beginnings of the lines that the numbers of a corner count, by their place in `vertex/texture/normal`."""


def with_plain_lines(path: Path, data: bytes) -> bytes:
    """An OBJ file's content with one line for each statement, in its place, and indices that count from the first one.

    Line ends become those of Unix; continued lines are joined, but none to a comment, which may end with a folder's
    backslash; indents, tabs after a keyword and remarks behind numbers are left out. UserError naming the line of a
    face that counts from 0, which the reader takes for the last vertex, or back to before the first one.
    """
    if b"\r" in data:
        data = data.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    if b"\\\n" in data:
        data = CONTINUED.sub(_joined, COMMENT_END.sub(rb"\1", data))
    if any(data.startswith(blank) or b"\n" + blank in data for blank in (b" ", b"\t")):
        data = INDENT.sub(b"", data)
    if b"\t" in data:
        data = TAB.sub(rb"\1 ", data)
    if data.count(b"#") > data.count(b"\n#") + data.startswith(b"#"):
        data = REMARK.sub(rb"\1", data)
    if wrong := FROM_ZERO.search(data):
        row = data.count(b"\n", 0, wrong.start()) + 1
        raise UserError(
            f"{path}: line {row}: a face refers to vertex 0, and OBJ counts from 1; add 1 to its indices, or "
            "export the model again"
        )
    return _counted_from_the_first(path, data) if FROM_THE_LAST.search(data) else data


def _joined(found: re.Match[bytes]) -> bytes:
    """A continued line as one, and as many empty ones behind it as were joined, so that numbers of lines stay."""
    return found[0].replace(b"\\\n", b" ") + b"\n" * found[0].count(b"\\\n")


def _counted_from_the_first(path: Path, data: bytes) -> bytes:
    lines, seen = data.split(b"\n"), [0, 0, 0]
    for row, line in enumerate(lines):
        kind = COUNTED.get(line[:2])
        if kind is not None:
            seen[kind] += 1
        elif b"-" in line and line.startswith(b"f "):
            try:
                corners = [_corner(word, seen) for word in line.split()[1:]]
            except ValueError as error:
                raise UserError(f"{path}: line {row + 1}: {error}; export the model again") from None
            lines[row] = b"f " + b" ".join(corners)
    return b"\n".join(lines)


def _corner(word: bytes, seen: list[int]) -> bytes:
    """A corner such as -4/-4/-1 with indices from the first one; ValueError for one that is none."""
    numbers = word.split(b"/")
    for kind, (number, count) in enumerate(zip(numbers, seen, strict=False)):
        if number.startswith(b"-"):
            if (index := int(number) + count + 1) < 1:
                raise ValueError(f"a face refers to a missing vertex, {word.decode('ascii', 'replace')}")
            numbers[kind] = b"%d" % index
    return b"/".join(numbers)
