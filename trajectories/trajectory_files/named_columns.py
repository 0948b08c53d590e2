"""Names of columns in the comments of a trajectory file, compared with the order that its format has."""

import re
from collections.abc import Mapping
from pathlib import Path

from uavbench.trajectories.errors import UserError

UNIT = re.compile(r"\[[^\]]*\]|\([^)]*\)")
"""A unit, as in `p_RS_R_x [m]`, EuRoC's, or `timestamp(s)`."""
POSITION = re.compile(r"(?:[tp]|[tp]\w*_)?([xyz])(?:_m)?", re.IGNORECASE)
QUATERNION = re.compile(r"q(?:\w*_)?([wxyz])", re.IGNORECASE)
"""Names of a component of the position or the quaternion: tx, px_m, p_RS_R_x, x; qw, q_RS_w."""
ORDERS: Mapping[str, tuple[str, ...]] = {
    "tum": ("x", "y", "z", "qx", "qy", "qz", "qw"),
    "euroc": ("x", "y", "z", "qw", "qx", "qy", "qz"),
}
MEANT: Mapping[str, str] = {
    "tum": "; or, if it is tum, write its stamps in seconds, with decimals",
    "euroc": "; or, if it is euroc, write its stamps in integer nanoseconds",
}
"""What to do about a file in the order of another format, which its stamps do not tell."""


def check_named_columns(path: Path, comments: str, format: str) -> None:
    """UserError when a comment names all columns of a pose in an order other than that of the format.

    Comments that name others, or only some of them, say nothing.
    """
    expected = ORDERS[format]
    for line in comments.splitlines():
        named = _components(line)
        if sorted(named) == sorted(expected) and tuple(named) != expected:
            other = next((name for name, order in ORDERS.items() if order == tuple(named)), "")
            raise UserError(
                f"{path}: its comment names the columns {' '.join(named)}, but in the format {format} they are "
                f"{' '.join(expected)}; put the columns into this order, or correct the comment{MEANT.get(other, '')}"
            )


def names_all_columns(comments: str) -> bool:
    """Whether a comment names all columns of a pose."""
    return any(sorted(_components(line)) == sorted(ORDERS["tum"]) for line in comments.splitlines())


def _components(line: str) -> list[str]:
    """Names of the components in a line: x y z of the position, qw qx qy qz of the quaternion."""
    found = []
    for name in re.split(r"[,;\s]+", UNIT.sub(" ", line.strip().lstrip("#%/"))):
        if position := POSITION.fullmatch(name):
            found.append(position[1].lower())
        elif quaternion := QUATERNION.fullmatch(name):
            found.append(f"q{quaternion[1].lower()}")
    return found
