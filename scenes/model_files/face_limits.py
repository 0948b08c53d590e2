"""How many triangles a model may have, and how much work its faces of many corners may be."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from uavbench.trajectories.errors import UserError

MOST_TRIANGLES = 2_000_000
MOST_SQUARES = 5_000_000
"""Sum of the squared numbers of corners (beyond three) of all faces: five of 1,000 corners, about a minute."""


def check_count(path: Path, triangles: int) -> None:
    """UserError when a model has more than MOST_TRIANGLES triangles."""
    if triangles > MOST_TRIANGLES:
        raise UserError(
            f"{path}: {triangles:,} triangles are more than the {MOST_TRIANGLES:,} that can be handled; "
            "simplify the model to its planar faces (edges shorter than a few pixels do not help a tracker)"
        )


@dataclass
class FaceWork:
    """Faces of a model so far: their triangles, and the squares of their corners, as which ear clipping takes time."""

    path: Path
    triangles: int = 0
    squares: int = 0

    def add(self, corners: Iterable[int]) -> None:
        """Count faces by their numbers of corners; UserError beyond MOST_TRIANGLES or MOST_SQUARES."""
        for count in corners:
            self.triangles += count - 2
            self.squares += (count - 3) ** 2
        check_count(self.path, self.triangles)
        if self.squares > MOST_SQUARES:
            raise UserError(f"{self.path}: its faces have too many corners; split those of more than a hundred")
