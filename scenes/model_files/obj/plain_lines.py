"""An OBJ file's lines in the one form that its reader knows: it takes other forms for nothing, or for other faces."""

import re
from pathlib import Path

from uavbench.trajectories.errors import UserError

CONTINUED = re.compile(rb"(?:[^\n]*\\\n)+[^\n]*")
INDENT = re.compile(rb"^[ \t]+", re.MULTILINE)
TAB = re.compile(rb"^([a-z]+)[ \t]*\t[ \t]*", re.MULTILINE)
REMARK = re.compile(rb"^((?:v|vt|vn|f) [^#\n]*)#[^\n]*", re.MULTILINE)
FROM_THE_LAST = re.compile(rb"^f [^\n#]*-", re.MULTILINE)
COUNTED = (b"v ", b"vt ", b"vn ")
"""What the numbers of a corner count, in their order in `vertex/texture/normal`."""


def with_plain_lines(path: Path, data: bytes) -> bytes:
    """An OBJ file's content with one line for each statement, in its place, and indices that count from the first one.

    Line ends become those of Unix; continued lines are joined; indents, tabs after a keyword and remarks behind numbers
    are left out. UserError naming the line of a face that counts back to before the first vertex.
    """
    if b"\r" in data:
        data = data.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    if b"\\\n" in data:
        data = CONTINUED.sub(_joined, data)
    for unusual, plain in ((INDENT, b""), (TAB, rb"\1 "), (REMARK, rb"\1")):
        if unusual.search(data):
            data = unusual.sub(plain, data)
    return _counted_from_the_first(path, data) if FROM_THE_LAST.search(data) else data


def _joined(found: re.Match[bytes]) -> bytes:
    """A continued line as one, and as many empty ones behind it as were joined, so that numbers of lines stay."""
    return found[0].replace(b"\\\n", b" ") + b"\n" * found[0].count(b"\\\n")


def _counted_from_the_first(path: Path, data: bytes) -> bytes:
    lines, seen = data.split(b"\n"), [0, 0, 0]
    for row, line in enumerate(lines):
        for kind, prefix in enumerate(COUNTED):
            seen[kind] += line.startswith(prefix)
        if line.startswith(b"f ") and b"-" in line:
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
