"""Outlines of planar regions: straight where two planes meet, and simplified where the surface of a region ends."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from uavbench.scenes.scans.planar_regions import PlanarRegions
from uavbench.scenes.scans.scanned_surface import ScannedSurface
from uavbench.scenes.structure import Indices
from uavbench.trajectories.pose import Array

NOWHERE = -1
"""Label of what lies beyond a border of the scan, or in no region."""
MEETING_DEG = 8.0
"""Angle from which two planes have a line in common that the noise of the scan does not move far, degrees."""
LINE_SIDES = 3.5
"""Distance of a rounded border from the line of its planes, in sides of triangles."""
ON_LINE = 0.8
"""Part of a border that has to be near the line of two planes for it to be their edge."""
SIMPLE_SIDES = 1.5
"""Distance of a simplified border from the scan's, in sides of triangles."""

SAME_SIDES = 1e-3
"""Distance of a corner from each of the planes that meet there, in sides of triangles."""
ROUND_SIDES = 1.5
"""Distance from a corner within which a border is rounded, in sides of triangles."""
FEWEST = 4
"""Points of a border through which a line is fitted."""
TURN_DEG = 20.0
"""Angle from which two lines of a border meet at a corner, degrees."""


@dataclass(frozen=True, eq=False)
class Outline:
    """A closed loop (k, 3) of a region, metres, counter-clockwise about its normal or, of a hole, clockwise."""

    region: int
    points: Array


def outlines(surface: ScannedSurface, regions: PlanarRegions) -> list[Outline]:
    """The outlines of all regions; where two of them meet they have the same corners."""
    drawing = _Drawing(surface, regions)
    return [found for loop in drawing.loops() if (found := drawing.outline(loop)) is not None]


class _Drawing:
    def __init__(self, surface: ScannedSurface, regions: PlanarRegions) -> None:
        self.surface, self.regions = surface, regions
        self.side = surface.side_m
        self.noise = 3 * regions.noise_m
        twin = surface.twins.ravel()
        own = np.repeat(regions.labels, 3)
        self.beyond = np.where(twin >= 0, regions.labels[twin // 3], NOWHERE)
        self.border = (own >= 0) & (self.beyond != own)
        self.twin = twin
        self.starts = surface.triangles.ravel()
        pairs = np.unique(np.stack([self.starts, own], axis=1)[own >= 0], axis=0)
        ends = np.searchsorted(pairs[:, 0], np.arange(len(surface.vertices) + 1))
        self.labels_at = [pairs[ends[k] : ends[k + 1], 1] for k in range(len(surface.vertices))]
        self.corners: dict[int, Array | None] = {}
        self.shared: dict[tuple[int, ...], list[Array]] = {}

    def loops(self) -> list[list[int]]:
        """Loops of sides, as 3 * triangle + corner, with a region on their left."""
        done, found = ~self.border, []
        for first in np.flatnonzero(self.border).tolist():
            if done[first]:
                continue
            loop, side = [], first
            while not done[side]:
                done[side] = True
                loop.append(side)
                side = self._after(side)
            found.append(loop)
        return found

    def _after(self, side: int) -> int:
        side = side - side % 3 + (side + 1) % 3
        while not self.border[side]:
            side = int(self.twin[side])
            side = side - side % 3 + (side + 1) % 3
        return side

    def outline(self, loop: list[int]) -> Outline | None:
        """The outline of a loop of sides; None for a hole in the scan within a region, or for one without area."""
        region = int(self.regions.labels[loop[0] // 3])
        beyond = self.beyond[loop]
        if (beyond == NOWHERE).all() and self._area(region, self._placed(region, self.starts[loop])) < 0:
            return None
        change = np.flatnonzero(beyond != np.roll(beyond, 1))
        if not len(change):
            points = self._placed(region, self.starts[loop])
            points = np.roll(points, -int(np.argmax(np.linalg.norm(points - points[0], axis=1))), axis=0)
            points = straightened(np.concatenate([points, points[:1]]), self.regions.normals[region], self.side)[:-1]
        else:
            parts = []
            for first, last in zip(change, np.roll(change, -1), strict=True):
                rows = np.arange(first, last if last > first else last + len(loop)) % len(loop)
                vertices = self.starts[np.take(loop, [*rows, (rows[-1] + 1) % len(loop)])]
                parts.append(self._arc(region, int(beyond[first]), vertices))
            points = np.concatenate(parts)
        points = without_spikes(points, 1e-6 * self.side)
        return Outline(region, points) if len(points) > 2 else None

    def _area(self, region: int, points: Array) -> float:
        centred = points - points[0]
        return float(np.cross(centred, np.roll(centred, -1, axis=0)).sum(axis=0) @ self.regions.normals[region] / 2)

    def _arc(self, region: int, beyond: int, vertices: Indices) -> Array:
        """Points (k, 3) of an arc of a border over vertices."""
        straight = beyond != NOWHERE and self._on_line(region, beyond, vertices)
        points = self._placed(region, vertices[[0, -1]] if straight else vertices)
        for k, vertex in ((0, int(vertices[0])), (-1, int(vertices[-1]))):
            corner = self._corner(vertex)
            if corner is not None:
                points[k] = corner
            elif straight:
                pair = sorted((region, beyond))
                points[k] = self.surface.vertices[vertex] + self._step(vertex, np.array(pair))
        return points if straight else straightened(points, self.regions.normals[region], self.side)

    def _on_line(self, a: int, b: int, vertices: Indices) -> bool:
        normals, at = self.regions.normals[[a, b]], self.regions.points[[a, b]]
        if abs(float(normals[0] @ normals[1])) > np.cos(np.radians(MEETING_DEG)):
            return False
        away = np.einsum("ki,vki->vk", normals, self.surface.vertices[vertices][:, None] - at)
        step = np.linalg.norm(away @ np.linalg.pinv(normals).T, axis=1)
        return float(np.mean(step < LINE_SIDES * self.side + self.noise)) >= ON_LINE

    def _placed(self, region: int, vertices: Indices) -> Array:
        points = self.surface.vertices[vertices]
        normal = self.regions.normals[region]
        return np.asarray(points - ((points - self.regions.points[region]) @ normal)[:, None] * normal)

    def _corner(self, vertex: int) -> Array | None:
        """Where the planes at a vertex meet; None where that is far from it."""
        if vertex not in self.corners:
            at, here = self.labels_at[vertex], self.surface.vertices[vertex]
            step = self._step(vertex, at)
            far = np.linalg.norm(step) > np.sqrt(3) * (LINE_SIDES * self.side + self.noise)
            off = np.abs(np.einsum("ki,ki->k", self.regions.normals[at], here + step - self.regions.points[at]))
            far |= off.max() > SAME_SIDES * self.side
            corner = here + step
            if len(at) > 2 and not far:  # the same numbers for all vertices at which the same planes meet
                known = self.shared.setdefault(tuple(at.tolist()), [])
                for other in known:
                    if np.linalg.norm(other - corner) < 1e-6 * self.side:
                        corner = other
                        break
                else:
                    known.append(corner)
            self.corners[vertex] = None if far else corner
        return self.corners[vertex]

    def _step(self, vertex: int, planes: Indices) -> Array:
        """The shortest way (3,) from a vertex to what planes have in common."""
        normals = self.regions.normals[planes]
        away = np.einsum("ki,ki->k", normals, self.regions.points[planes] - self.surface.vertices[vertex])
        return np.asarray(np.linalg.pinv(normals, rcond=float(np.sin(np.radians(MEETING_DEG)) / 2)) @ away)


def straightened(points: Array, normal: Array, side_m: float) -> Array:
    """Corners of a path (k, 3) across a normal: the lines fitted to its straight parts, and where they meet.

    Its ends stay, but those of a closed path, whose corners all lie on such lines.
    """
    rows = simplified(points, SIMPLE_SIDES * side_m)
    closed = bool((points[0] == points[-1]).all())
    lines = [_line(points[a : b + 1], side_m) for a, b in pairwise(rows.tolist())]
    corners = [points[row] for row in rows]
    for k in range(0 if closed else 1, len(rows) - 1):
        corners[k] = _meeting(corners[k], lines[k - 1], lines[k], normal, side_m)
    if closed:
        corners[-1] = corners[0]
    return np.array(corners)


def _line(points: Array, side_m: float) -> Array | None:
    """Point and direction (2, 3) of the line through a part of a path, without its ends, which are rounded."""
    ends = np.minimum(*(np.linalg.norm(points - end, axis=1) for end in points[[0, -1]]))
    points = points[ends > ROUND_SIDES * side_m]
    if len(points) < FEWEST:
        return None
    centre = points.mean(axis=0)
    return np.stack([centre, np.linalg.svd(points - centre, full_matrices=False)[2][0]])


def _meeting(corner: Array, before: Array | None, after: Array | None, normal: Array, side_m: float) -> Array:
    """Where two lines meet near a corner of a path; on one of them, where the other is none or about the same."""
    if before is not None and after is not None:
        across = np.cross(normal, after[1])
        slope = float(before[1] @ across)
        if abs(slope) > np.sin(np.radians(TURN_DEG)):
            meeting = before[0] + before[1] * float((after[0] - before[0]) @ across) / slope
            if np.linalg.norm(meeting - corner) < LINE_SIDES * side_m:
                return np.asarray(meeting)
    line = before if before is not None else after
    return corner if line is None else np.asarray(line[0] + line[1] * float((corner - line[0]) @ line[1]))


def simplified(points: Array, tolerance: float) -> Indices:
    """Rows of the corners, ends too, of a path that stays within a distance of one (k, 3) (Douglas & Peucker 1973)."""
    kept = np.zeros(len(points), dtype=np.bool_)
    kept[[0, -1]] = True
    waiting = [(0, len(points) - 1)]
    if (points[0] == points[-1]).all() and len(points) > 3:
        far = int(np.argmax(np.linalg.norm(points - points[0], axis=1)))
        kept[far] = True
        waiting = [(0, far), (far, len(points) - 1)]
    while waiting:
        first, last = waiting.pop()
        if last - first < 2:
            continue
        along = points[last] - points[first]
        length = np.linalg.norm(along)
        step = points[first + 1 : last] - points[first]
        if length > 0:
            share = np.clip(step @ along / length**2, 0, 1)
            step = step - share[:, None] * along
        away = np.linalg.norm(step, axis=1)
        worst = int(np.argmax(away))
        if away[worst] > tolerance:
            middle = first + 1 + worst
            kept[middle] = True
            waiting += [(first, middle), (middle, last)]
    return np.flatnonzero(kept)


def without_spikes(points: Array, same: float) -> Array:
    """A loop (k, 3) without repeated points, and without ways to a point and back."""
    loop = [points[k] for k in range(len(points))]
    k = 0
    while len(loop) > 2 and k < len(loop):
        before, here, after = loop[k - 1], loop[k], loop[(k + 1) % len(loop)]
        u, v = here - before, after - here
        nu, nv = np.linalg.norm(u), np.linalg.norm(v)
        if nu <= same or (u @ v < 0 and np.linalg.norm(np.cross(u, v)) <= 1e-9 * nu * nv):
            del loop[k]
            k = max(k - 2, 0)
        else:
            k += 1
    return np.array(loop)
