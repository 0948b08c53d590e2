"""The work of a frame, counted in evaluations instead of milliseconds, and thus equal on all machines.

An evaluation is an edge point looked up in an image, 2 ns (see `BudgetConfig`). Costs were measured as the least of 40
calls on one quiet core of an AMD EPYC: boxes, walls, a building, a truss and a bridge of 12 to 2286 edges, at right and
wrong poses.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

SAMPLING, PER_EDGE = 30_000, 75
"""Cost of finding the visible edge points of a pose, 60 us, and 0.15 us more for each edge of the structure."""
COARSE_SAMPLING, COARSE_PER_EDGE = 12_000, 20
"""The same for an overview: 24 us, and 0.04 us more for each edge."""
FIT, PER_POINT, PER_PATCH = 200_000, 1_700, 4_100
"""Cost of a fit from a wrong pose beside that for each edge, 400 us, and more for each control point and patch, 3.4 and
8.2 us; fits of tracking take about two thirds of it."""
LOCATED_POINT = 1_100
"""Cost of locating a control point between the pixels, 2.2 us."""
DISTANCES = 550_000
"""Cost of the distance transforms of an image, 1.1 ms."""
COARSE_DISTANCES = 130_000
"""The same for an overview, 0.26 ms."""
FEATURES = 3_000_000
"""Cost of finding the features of an image, 3 to 5 ms; 8 ms on bricks."""
SURFACE, SURFACE_PER_EDGE = 200_000, 175
"""Cost of reading what an image shows of a structure's surface, 0.4 ms, and 0.35 us more for each of its edges."""
SHOWN = 200_000
"""Cost of blurring an image for alignments, 0.4 ms."""
LOOK = 1_500_000
"""Usual cost of looking about a guess for where an image looks as remembered, 2 to 3 ms."""
ALIGNMENT, ALIGNED_POINT, SCANNED_POINT = 10_000, 25, 3
"""Cost of an alignment, 20 us, and of each point in each iteration, 50 ns; of a point at a shift of the image, 6 ns."""
RECALLED, PER_LANDMARK = 330_000, 4_500
"""Cost of a pose by the landmarks of a place, 0.7 ms, and more for each landmark, up to 9 us."""


def sampling_evaluations(edges: int) -> int:
    """Cost of finding the visible edge points of a structure of so many edges at a pose."""
    return SAMPLING + PER_EDGE * edges


def coarse_sampling_evaluations(edges: int) -> int:
    """Cost of finding its visible edge points for an overview."""
    return COARSE_SAMPLING + COARSE_PER_EDGE * edges


def fit_evaluations(edges: int, points: int, patches: int) -> int:
    """Cost of a fit of so many control points and patches."""
    return FIT + PER_EDGE * edges + PER_POINT * points + PER_PATCH * patches


def surface_evaluations(edges: int) -> int:
    """Cost of reading what an image shows of the surface of a structure of so many edges."""
    return SURFACE + SURFACE_PER_EDGE * edges


def recall_evaluations(landmarks: int) -> int:
    """Cost of a pose by so many landmarks of a place, once the features of the image are known."""
    return RECALLED + PER_LANDMARK * landmarks


@dataclass
class Work:
    """Evaluations (edge points looked up in an image) allowed for a frame, and spent so far."""

    allowed: int
    done: int = 0

    @property
    def left(self) -> int:
        """Evaluations left; negative if the budget was exceeded."""
        return self.allowed - self.done

    @contextmanager
    def reserved(self, evaluations: int) -> Iterator[None]:
        """Context in which so many evaluations are not allowed: they are left for what follows it in the frame."""
        self.allowed -= evaluations
        try:
            yield
        finally:
            self.allowed += evaluations
