"""Self-similarity of a structure: the shifts and turns that map its edges onto other edges.

Windows, panels and lattice members repeat, so that a pose that is off by one repetition has nearly as much support as
the true one. The shifts are those that map most length of edges onto parallel edges of the same length, found once per
structure. The score of a shift depends on the visible part: at the end of a row nothing maps onto anything. The turns
are those about the vertical through its middle: a box looks alike from its front and from behind.
"""

import numpy as np
from numpy.typing import NDArray

from uavbench.tracker.geometry_kernels import RigidMotion
from uavbench.tracker.robust.edges.edge_graph import EdgeMap
from uavbench.tracker.robust.relocalization.self_similarity_kernels import on_edges, shares_on_edges, table_of_edges
from uavbench.tracker.robust.row_numbers import row_numbers
from uavbench.trajectories.pose import Array

MOST_ALIKE = 400
"""Most edges of one length and direction that are compared with each other, since their pairs take memory."""
SHIFTS = 512
"""Most shifts of a structure onto itself that are stored. Measured on rendered bridges: those of a girder's stiffeners,
short compared with its chords, are among the first 300.
"""
TOLERANCE = 0.002
"""Distance, as a fraction of the structure's size, below which edges coincide: 2 cm of a building of 10 m.
"""
LENGTH_STEP = 0.01
"""Relative difference of lengths below which edges count as equally long."""
DIRECTION_STEP = 1 / 16
"""Difference of unit directions below which edges count as parallel."""
TURNS = 24
"""Parts of a whole turn, after each of which a structure may look alike: of square, hexagonal and round ones, 15
degrees apart."""
TURNED_PART, TURNED_POINTS = 0.5, 2000
"""Least part of the edges that a turn maps onto edges, and number of points by which it is told."""
STILL = np.zeros((1, 3))


class SelfSimilarity:
    """The shifts (k, 3) of a structure, in its unit, its turns, and the cells of space that its edges pass through."""

    def __init__(self, edges: EdgeMap) -> None:
        self.cell = TOLERANCE * float(np.linalg.norm(edges.extent[-1] - edges.extent[0]))
        along = edges.ends[:, 1] - edges.ends[:, 0]
        lengths = np.linalg.norm(along, axis=1)
        long = lengths > self.cell
        ends, lengths, along = edges.ends[long], lengths[long], along[long] / lengths[long, None]
        self.shifts = self._repetitions(ends.mean(axis=1), along, lengths)[:SHIFTS]
        counts = np.ceil(lengths / self.cell).astype(np.int64) + 1
        self.passed = table_of_edges(ends, counts, direction_numbers(along), self.cell)
        until, total = np.cumsum(counts), int(counts.sum())
        some = np.linspace(0, total - 1, min(total, TURNED_POINTS)).round().astype(np.int64)
        edge = np.searchsorted(until, some, side="right")
        part = (some - until[edge] + counts[edge]) / (counts[edge] - 1)
        places = ends[edge, 0] + part[:, None] * (ends[edge, 1] - ends[edge, 0])
        turns = [turn for middle in self._middles(ends, lengths) for turn in turns_about(middle)]
        self.turns = [turn for turn in turns if self.moved(turn, places, along[edge], TURNED_PART, STILL)]

    def _middles(self, ends: Array, lengths: Array) -> list[Array]:
        """Where the axis of a turn may be: the middle of the edges' extent, and that of their length if it is another.

        The first one of a building with a door at one side, the other one of a triangle.
        """
        if not len(ends):
            return []
        extent = 0.5 * (ends.reshape(-1, 3).min(axis=0) + ends.reshape(-1, 3).max(axis=0))
        length = np.average(ends.mean(axis=1), axis=0, weights=lengths)
        return [extent, length] if np.abs(length - extent)[:2].max() > self.cell else [extent]

    def shares(self, points: Array, along: Array) -> Array:
        """Fraction (k,) of points (n, 3) on edges of unit directions along (n, 3) that each shift maps onto an edge."""
        if not (len(points) and len(self.shifts)):
            return np.zeros(len(self.shifts))
        return np.asarray(shares_on_edges(self.shifts, points, direction_numbers(along), self.cell, self.passed))

    def moves(self, points: Array, along: Array, least: float) -> list[RigidMotion]:
        """Shifts and turns, with a shift or without, that map so large a part of points, as of `shares`, onto edges."""
        shares = self.shares(points, along)
        shifted = [RigidMotion(np.eye(3), shift) for shift in self.shifts[shares >= least]]
        shifts = np.concatenate([STILL, self.shifts])
        return shifted + [each for turn in self.turns for each in self.moved(turn, points, along, least, shifts)]

    def moved(self, turn: RigidMotion, points: Array, along: Array, least: float, shifts: Array) -> list[RigidMotion]:
        """A turn with those of shifts (k, 3) with which it maps so large a part of points onto edges."""
        if not len(points):
            return []
        there, directions = points @ turn.R.T + turn.t, direction_numbers(along @ turn.R.T)
        shares = np.asarray(shares_on_edges(shifts, there, directions, self.cell, self.passed))
        return [RigidMotion(turn.R, turn.t + shift) for shift in shifts[shares >= least]]

    def on_edges(self, points: Array, along: Array) -> NDArray[np.bool_]:
        """Mask (n,) of the points (n, 3) that lie on an edge of their unit direction along (n, 3)."""
        return np.asarray(on_edges(points, direction_numbers(along), self.cell, self.passed))

    def _repetitions(self, middles: Array, along: Array, lengths: Array) -> Array:
        """Shifts (k, 3) and their opposites, by descending length of edges that they map onto others."""
        alike = np.column_stack([np.round(np.log(lengths) / LENGTH_STEP), direction_numbers(along)]).astype(np.int64)
        _, group, members = np.unique(row_numbers(alike), return_inverse=True, return_counts=True)
        by_group = np.split(np.argsort(group, kind="stable"), np.cumsum(members))[:-1]
        apart, weight = [np.zeros((0, 3))], [np.zeros(0)]
        for these in (each[:MOST_ALIKE] for each, number in zip(by_group, members, strict=True) if number > 1):
            one, other = np.triu_indices(len(these), 1)
            apart.append(middles[these[other]] - middles[these[one]])
            weight.append(lengths[these[one]])
        shift, votes = np.concatenate(apart), np.concatenate(weight)
        steps = np.round(shift / self.cell).astype(np.int64)
        far = np.abs(steps).max(axis=1, initial=0) > 2
        steps, shift, votes = steps[far], shift[far], votes[far]
        back = first_signs(steps)[:, None]
        unique, place = np.unique(row_numbers(steps * back), return_inverse=True)
        total = np.bincount(place, votes, len(unique))
        sums = [np.bincount(place, votes * column, len(unique)) for column in (shift * back).T]
        mean = np.column_stack(sums) / total[:, None]
        best = np.argsort(-total, kind="stable")
        return np.stack([mean[best], -mean[best]], axis=1).reshape(-1, 3)


def turns_about(middle: Array) -> list[RigidMotion]:
    """Turns about the vertical through a point (3,), but the whole one."""
    found = []
    for angle in 2.0 * np.pi * np.arange(1, TURNS) / TURNS:
        cosine, sine = np.cos(angle), np.sin(angle)
        R = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
        found.append(RigidMotion(R, middle - R @ middle))
    return found


def direction_numbers(along: Array) -> NDArray[np.int64]:
    """A number (n,) for each unit direction (n, 3), the same for its opposite."""
    steps = np.round(along / DIRECTION_STEP).astype(np.int64)
    steps *= first_signs(steps)[:, None]
    return np.asarray((steps[:, 0] * 64 + steps[:, 1]) * 64 + steps[:, 2])


def first_signs(steps: NDArray[np.int64]) -> NDArray[np.int64]:
    """Sign (n,) of the first column of each row (n, 3) that is not zero."""
    x, y, z = np.sign(steps).T
    return np.asarray(np.where(x != 0, x, np.where(y != 0, y, z)))
