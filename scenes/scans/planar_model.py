"""The planar model of a scanned mesh: polygons in the planes of its surface, whose sides are the edges."""

from dataclasses import dataclass

import numpy as np

from uavbench.scenes.scans.outlines import Outline, outlines, without_spikes
from uavbench.scenes.scans.planar_regions import planar_regions
from uavbench.scenes.scans.scanned_surface import ScannedSurface
from uavbench.scenes.structure import Indices, Structure
from uavbench.trajectories.pose import Array

SAME_SIDES = 0.002
"""Distance of corners that are one, in sides of the scan's triangles."""
STRAIGHT_SIDES = 0.005
"""Distance of a corner from a straight border, in sides of the scan's triangles."""


@dataclass(frozen=True, eq=False)
class PlanarModel:
    """Vertices (n, 3) in metres and triangles (m, 3) of the polygons; the plane (m,) of each, and how many there are.

    noise_m: standard deviation of the scan about its planes; side_m: typical side of its triangles; reach_m: relief up
    to this height is taken for rounding. left_out: part of the scan's area that lies in no plane.
    """

    vertices: Array
    triangles: Indices
    plane: Indices
    planes: int
    noise_m: float
    side_m: float
    reach_m: float
    left_out: float

    @classmethod
    def of(cls, vertices: Array, triangles: Indices, least_area_m2: float = 0.0) -> "PlanarModel":
        """The model of a scan: vertices (n, 3) in metres, triangles (m, 3); ValueError when no plane is found."""
        surface = ScannedSurface.of(vertices, triangles)
        regions = planar_regions(surface, least_area_m2)
        if not len(regions.areas):
            raise ValueError("no plane is found in it")
        planes = [_Plane.of(*plane) for plane in zip(regions.points, regions.normals, strict=True)]
        loops = conforming(outlines(surface, regions), surface.side_m)
        loops = conforming(without_crossings(loops, planes), surface.side_m)
        points, triangles, plane = _faces(loops, planes)
        out = float(surface.areas[regions.labels < 0].sum() / surface.areas.sum())
        return cls(
            points,
            triangles,
            plane,
            planes=len(regions.areas),
            noise_m=regions.noise_m,
            side_m=surface.side_m,
            reach_m=regions.reach_m,
            left_out=out,
        )

    def structure(self) -> Structure:
        """The faces and edges of the model, as a mesh file of its triangles has."""
        return Structure.from_mesh(self.vertices, self.triangles)


def conforming(loops: list[Outline], side_m: float) -> list[Outline]:
    """The loops with equal corners where they are close, at all corners of others on their sides, and at no others."""
    from scipy.spatial import cKDTree

    points = np.concatenate([loop.points for loop in loops])
    near = cKDTree(points).query_pairs(SAME_SIDES * side_m, output_type="ndarray")
    first = np.arange(len(points))
    for a, b in near[np.lexsort(near.T)].tolist():
        first[b] = min(first[a], first[b])
    points = points[first]
    used = np.unique(first)
    corners = points[used]
    ends = np.cumsum([0, *(len(loop.points) for loop in loops)])
    chains = [_with_corners(first[ends[k] : ends[k + 1]], points, used, corners, side_m) for k in range(len(loops))]
    straight = _straight(chains, points, side_m)
    kept = [[v for v in chain if v not in straight] for chain in chains]
    tidy = [Outline(loop.region, without_spikes(points[chain], 0.0)) for loop, chain in zip(loops, kept, strict=True)
            if len(chain) > 2]  # fmt: skip
    return [loop for loop in tidy if len(loop.points) > 2]


def _with_corners(chain: Indices, points: Array, used: Indices, corners: Array, side_m: float) -> list[int]:
    """A closed chain of points with the corners that lie on its sides."""
    found: list[int] = []
    for a, b in zip(chain.tolist(), np.roll(chain, -1).tolist(), strict=True):
        found.append(a)
        along = points[b] - points[a]
        length = float(np.linalg.norm(along))
        if length == 0:
            continue
        place = (corners - points[a]) @ along / length
        away = np.linalg.norm(corners - points[a] - place[:, None] * along / length, axis=1)
        on = np.flatnonzero((away < STRAIGHT_SIDES * side_m) & (place > side_m / 2) & (place < length - side_m / 2))
        found += used[on[np.argsort(place[on], kind="stable")]].tolist()
    return found


def _straight(chains: list[list[int]], points: Array, side_m: float) -> set[int]:
    """Points at which all chains go straight on."""
    straight: set[int] = set()
    turns: set[int] = set()
    for chain in chains:
        at = points[chain]
        before, after = np.roll(at, 1, axis=0), np.roll(at, -1, axis=0)
        along = after - before
        length = np.maximum(np.linalg.norm(along, axis=1), 1e-300)
        off = np.linalg.norm(np.cross(at - before, along), axis=1) / length
        goes_on = (off < STRAIGHT_SIDES * side_m) & (np.einsum("ij,ij->i", at - before, after - at) > 0)
        straight.update(np.array(chain)[goes_on].tolist())
        turns.update(np.array(chain)[~goes_on].tolist())
    return straight - turns


@dataclass(frozen=True, eq=False)
class _Plane:
    """A plane by a point (3,) and two axes (2, 3) across its normal."""

    point: Array
    axes: Array

    @classmethod
    def of(cls, point: Array, normal: Array) -> "_Plane":
        u = np.cross(normal, np.eye(3)[int(np.argmin(np.abs(normal)))])
        u /= np.linalg.norm(u)
        return cls(point, np.stack([u, np.cross(normal, u)]))

    def flat(self, points: Array) -> Array:
        """Coordinates (k, 2) of points (k, 3)."""
        return np.asarray((points - self.point) @ self.axes.T)

    def placed(self, flat: Array) -> Array:
        """Points (k, 3) of coordinates (k, 2)."""
        return np.asarray(self.point + flat @ self.axes)


def without_crossings(loops: list[Outline], planes: list[_Plane]) -> list[Outline]:
    """The loops of each region without parts that cross others: noise puts a border across a border beside it."""
    from manifold3d import CrossSection, FillRule

    found: list[Outline] = []
    for region in sorted({loop.region for loop in loops}):
        plane = planes[region]
        rings = [plane.flat(loop.points) for loop in loops if loop.region == region]
        clean = CrossSection(rings, FillRule.Positive).to_polygons()
        found += [Outline(region, plane.placed(np.asarray(ring, dtype=np.float64))) for ring in clean]
    return found


def _faces(loops: list[Outline], planes: list[_Plane]) -> tuple[Array, Indices, Indices]:
    """Vertices (n, 3), triangles (m, 3) and their planes (m,) of the regions' loops, holes among them."""
    from manifold3d import triangulate

    points, triangles, count = [np.zeros((0, 3))], [np.zeros((0, 3), dtype=np.int64)], 0
    of: list[int] = []
    for region in sorted({loop.region for loop in loops}):
        own = [loop.points for loop in loops if loop.region == region]
        triangles.append(np.asarray(triangulate([planes[region].flat(at) for at in own]), dtype=np.int64) + count)
        points += own
        of += [region] * len(triangles[-1])
        count += sum(map(len, own))
    return np.concatenate(points), np.concatenate(triangles), np.array(of, dtype=np.int64)
