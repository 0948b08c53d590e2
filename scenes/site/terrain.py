"""Terrain of a site: a river channel or road bed along y, embankments along x, and the ground mesh."""

from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from uavbench.scenes.primitives.meshes import TriangleMesh, grid
from uavbench.scenes.renderables import Roadway
from uavbench.trajectories.pose import Array

BANK_SLOPE = 2.0
"""Run over rise of a grassed river bank (USDA NRCS, National Engineering Handbook 654, TS14A: 2:1 and flatter)."""
FILL_SLOPE = 1.5
"""Run over rise of an embankment of granular fill (FHWA NHI-06-088, section 7: 1.5:1 to 2:1)."""
SHOULDER_M = 1.0
"""Width of the verge between the edge of a road and the crest of its embankment, metres."""
BED_M, WATER_M = 1.6, 0.7
"""Depth of the river bed and of the water surface below the level ground, metres."""
GRASSED_M = 0.35
"""Depth below the bank's crest, metres, down to which grass grows; gravel lies below."""
SUNK_M = 0.2
"""Depth of the ground under a road that covers it, metres."""
APART_M = 0.09
"""Grid lines of the mesh closer than this are merged, metres."""
STEP_M = 2.0
FAR_M = 1080.0
"""Spacing of the mesh near the structure, and where it ends: behind the rim of hills."""


@dataclass(frozen=True)
class Course:
    """A river or road along y beneath a structure, its centre and half width along x in metres.

    bends: amplitude (m), wave number (rad/m) and phase (rad) of each sine of the centre line beyond straight_to_m.
    """

    kind: str
    centre_m: float
    half_m: float
    straight_to_m: float = 0.0
    bends: tuple[tuple[float, float, float], ...] = ()

    def aside(self, y: Array) -> Array:
        """Lateral offset (n,) of the centre line along x at positions y (n,), metres."""
        away = np.clip((np.abs(y) - self.straight_to_m) / 40.0, 0.0, 1.0)
        ease = away * away * (3 - 2 * away)
        return np.asarray(ease * sum((a * np.sin(f * y + p) for a, f, p in self.bends), np.zeros_like(y)))

    def across(self, points: Array) -> Array:
        """Absolute distance (n,) of points (n, 2) from the centre line along x, metres."""
        return np.asarray(np.abs(points[:, 0] - self.centre_m - self.aside(points[:, 1])))


@dataclass(frozen=True)
class Embankment:
    """Embankment of a road along x at both ends of a structure.

    The crest begins at |x| = start_m and has half width half_m; metres.
    """

    road: Roadway
    start_m: float
    half_m: float

    @classmethod
    def of(cls, road: Roadway) -> "Embankment":
        """The embankment of a road whose toe meets the front of the structure's ends."""
        return cls(road, road.front_m + FILL_SLOPE * road.level_m, road.half_width_m + SHOULDER_M)

    def height(self, points: Array) -> Array:
        """Height (n,) of the fill above the level ground at points (n, 2), metres."""
        x, y = np.abs(points[:, 0]), np.abs(points[:, 1])
        away = np.hypot(np.maximum(self.start_m - x, 0.0), np.maximum(y - self.half_m, 0.0))
        return np.asarray(np.maximum(self.road.level_m - SUNK_M - away / FILL_SLOPE, 0.0))


@dataclass(frozen=True)
class Terrain:
    """Ground at z = 0 except for a course and an embankment.

    bounds (2, 3) are those of the structure, feet (n, 2, 2) its footprints as lowest and highest (x, y); contact_m are
    distances from feet at which the mesh gets extra lines. World frame, metres.
    """

    bounds: Array
    feet: Array
    course: Course | None = None
    embankment: Embankment | None = None
    contact_m: tuple[float, ...] = field(default=())

    def height(self, points: Array) -> Array:
        """Height z (n,) of the ground at points (n, 2), metres."""
        out = np.zeros(len(points))
        if self.embankment is not None:
            out = self.embankment.height(points)
        if self.course is not None:
            inward = self.course.half_m - self.course.across(points)
            if self.course.kind == "river":
                out -= np.clip(inward / BANK_SLOPE, 0.0, BED_M)
            else:
                out -= np.clip(inward, 0.0, SUNK_M)
        return out

    def is_free(self, points: Array) -> NDArray[np.bool_]:
        """Mask (n,) of points (n, 2) on level, open ground, where clutter may stand."""
        free = np.abs(self.height(points)) < 1e-6
        return free if self.course is None else free & (self.course.across(points) > self.course.half_m + SHOULDER_M)

    def mesh(self) -> TriangleMesh:
        """The ground as a grid with lines at every change of slope and around footprints."""
        xs, ys = self._lines(0, self._breaks_x()), self._lines(1, self._breaks_y())
        one = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])
        vertices, triangles, _ = grid(np.zeros(3), *one, xs, ys)
        if self.course is not None:
            fade = np.clip(1 - (np.abs(vertices[:, 0] - self.course.centre_m) - self.course.half_m) / 60.0, 0.0, 1.0)
            vertices[:, 0] += fade * self.course.aside(vertices[:, 1])
        vertices[:, 2] = self.height(vertices[:, :2])
        return TriangleMesh(vertices, triangles)

    def tones(self, rng: np.random.Generator) -> Array:
        """Random values (n,) at the vertices of the mesh, normal and at most 2 in size.

        Drawn on the mesh without lines around footprints, between which they are interpolated: the lines leave the
        ground and all that is drawn after it as they are.
        """
        plain = replace(self, contact_m=())
        xs, ys = plain._lines(0, plain._breaks_x()), plain._lines(1, plain._breaks_y())
        drawn = np.clip(rng.standard_normal((len(ys), len(xs))), -2, 2)
        along_x = np.array([np.interp(self._lines(0, self._breaks_x()), xs, row) for row in drawn])
        both = np.array([np.interp(self._lines(1, self._breaks_y()), ys, column) for column in along_x.T])
        return np.asarray(both.T.ravel())

    def _breaks_x(self) -> list[float]:
        out: list[float] = []
        if self.course is not None:
            depths = (0.0, GRASSED_M, WATER_M, BED_M)
            inward = [0.0, SUNK_M] if self.course.kind == "road" else [BANK_SLOPE * depth for depth in depths]
            out += [self.course.centre_m + side * (self.course.half_m - d) for d in inward for side in (-1, 1)]
            out += [self.course.centre_m + side * (self.course.half_m + SHOULDER_M) for side in (-1, 1)]
        if self.embankment is not None:
            out += [side * self.embankment.start_m for side in (-1, 1)]
        return out

    def _breaks_y(self) -> list[float]:
        if self.embankment is None:
            return []
        run = FILL_SLOPE * (self.embankment.road.level_m - SUNK_M)
        return [side * (self.embankment.half_m + share * run) for share in (0.0, 0.5, 1.0) for side in (-1, 1)]

    def _lines(self, axis: int, breaks: Iterable[float]) -> Array:
        low, high = self.bounds[0, axis] - 12.0, self.bounds[1, axis] + 12.0
        wanted = np.array(sorted(breaks))
        feet = self.feet[:, :, axis]
        beside = [feet[:, 0] - d for d in self.contact_m] + [feet[:, 1] + d for d in self.contact_m]
        far = np.geomspace(STEP_M, FAR_M, 16)
        near = np.concatenate([np.arange(low, high, STEP_M), low - far, high + far, *beside])
        lines = wanted.tolist()
        for line in np.unique(near).tolist():
            if all(abs(line - other) > APART_M for other in lines):
                lines.append(line)
        return np.sort(lines)
