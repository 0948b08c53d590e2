"""Planar regions of a scanned surface: which triangles lie in one plane, by the noise of the scan itself."""

from dataclasses import dataclass, replace

import numpy as np

from uavbench.scenes.scans.region_kernels import Limits, grow_regions, spread_labels
from uavbench.scenes.scans.scanned_surface import ScannedSurface, pieces
from uavbench.scenes.structure import Indices
from uavbench.trajectories.pose import Array

TURN_DEG = 25.0
"""Angle between the normal of a patch and that of its region, degrees: rounding turns by more, noise by less."""
TOLERANCE = 3.0
"""Distance from the plane of a region, in standard deviations of the surface about it."""
WIDTH_SIDES = 4.0
"""Width of the smallest region, in sides of triangles: narrower ones are rounding."""
REACH_SIDES = 2.5
"""Distance from a plane up to which triangles of a rounded border belong to it, in sides of triangles."""
POCKET = 4.0
"""Largest area in no region that is taken for a part of the regions around it, in areas of the smallest one."""
ROUNDS = 60
"""Rounds in which regions take the triangles beside them."""


@dataclass(frozen=True, eq=False)
class PlanarRegions:
    """Region (m,) of each triangle, -1 for none; unit normals (r, 3) and points (r, 3) of the planes, areas (r,).

    noise_m: standard deviation of the surface about its planes; reach_m: relief up to this height is rounding.
    """

    labels: Indices
    normals: Array
    points: Array
    areas: Array
    noise_m: float
    reach_m: float = 0.0


def planar_regions(surface: ScannedSurface, least_area_m2: float = 0.0) -> PlanarRegions:
    """The planar regions of a surface of no less than an area, and of no less than some triangles.

    Regions grow over neighbours, from where the surface is flattest; those that have a plane in common are joined,
    and those that lie no farther from the planes beside them than rounding are given to these.
    """
    noise, side = surface.noise_m, surface.side_m
    least = max(least_area_m2, (WIDTH_SIDES * side) ** 2)
    tolerance = max(TOLERANCE * noise, 1e-3 * side)
    order = np.argsort(surface.residuals, kind="stable")
    cosine = float(np.cos(np.radians(TURN_DEG)))
    for _ in range(2):  # the second time with the noise about the planes of the first
        labels = np.full(len(surface.triangles), -1, dtype=np.int64)
        calm = order[surface.residuals[order] <= tolerance]
        limits = Limits(cosine, tolerance, least)
        grow_regions(calm, surface.neighbours, surface.centroids, surface.normals, surface.areas, limits, labels)
        if labels.max(initial=-1) < 0:
            none = np.zeros((0, 3))
            return PlanarRegions(labels, none, none, none[:, 0], noise)
        labels = merge_alike(surface, labels, tolerance)
        found = fitted(surface, labels)
        tolerance = max(TOLERANCE * found.noise_m, 1e-3 * side)
    reach = tolerance + REACH_SIDES * side
    labels = without_rounding(surface, labels, reach)
    found = fitted(surface, labels)
    for _ in range(2):
        planes = found.normals, found.points
        spread_labels(surface.neighbours, surface.centroids, surface.normals, planes, reach, ROUNDS, labels)
        labels = without_islands(surface, labels, least)
    labels = _without_pockets(surface, found, labels, POCKET * least)
    return replace(found, labels=labels, reach_m=reach)


@dataclass(frozen=True, eq=False)
class Moments:
    """Areas (r,), means (r, 3) and second moments (r, 3, 3) about them of the surface in regions, and its facing."""

    areas: Array
    means: Array
    spreads: Array
    facing: Array

    @classmethod
    def of(cls, surface: ScannedSurface, labels: Indices) -> "Moments":
        """The moments of labelled triangles (m,)."""
        count, inside = int(labels.max(initial=-1)) + 1, labels >= 0
        of, areas, at = labels[inside], surface.areas[inside], surface.centroids[inside]
        whole = np.bincount(of, areas, count).astype(np.float64)
        origin = surface.centroids.mean(axis=0)
        means = np.stack([np.bincount(of, areas * x, count) for x in (at - origin).T], axis=1) / whole[:, None]
        off = at - origin - means[of]
        spreads = np.stack([np.bincount(of, areas * off[:, i] * off[:, j], count) for i in range(3) for j in range(3)])
        facing = np.stack([np.bincount(of, areas * n, count) for n in surface.normals[inside].T], axis=1)
        return cls(whole, np.asarray(means + origin), np.asarray(spreads.T.reshape(-1, 3, 3)), np.asarray(facing))

    def joined(self, a: int, b: int) -> None:
        """Add region b to region a."""
        whole = self.areas[a] + self.areas[b]
        step = self.means[b] - self.means[a]
        self.spreads[a] += self.spreads[b] + self.areas[a] * self.areas[b] / whole * np.outer(step, step)
        self.means[a] += self.areas[b] / whole * step
        self.facing[a] += self.facing[b]
        self.areas[a], self.areas[b] = whole, 0.0

    def residual(self, region: int, normal: Array, point: Array) -> float:
        """Rms distance of a region from a plane, metres."""
        square = (
            normal @ self.spreads[region] @ normal / self.areas[region] + (normal @ (self.means[region] - point)) ** 2
        )
        return float(np.sqrt(max(square, 0.0)))


def fitted(surface: ScannedSurface, labels: Indices) -> PlanarRegions:
    """The planes of labelled triangles (m,), by least squares over area."""
    moments = Moments.of(surface, labels)
    values, axes = np.linalg.eigh(moments.spreads / moments.areas[:, None, None])
    normals = axes[:, :, 0]
    normals = normals * np.where(np.einsum("ij,ij->i", normals, moments.facing) < 0, -1.0, 1.0)[:, None]
    noise = float(np.sqrt(max(np.average(values[:, 0], weights=moments.areas), 0.0))) if len(values) else 0.0
    return PlanarRegions(labels, normals, moments.means, moments.areas, noise)


def merge_alike(surface: ScannedSurface, labels: Indices, tolerance: float) -> Indices:
    """Labels (m,) with neighbouring regions joined whose common plane fits both."""
    moments = Moments.of(surface, labels)
    pairs = border_pairs(surface, labels, gap=3)
    ways = np.arange(len(moments.areas))
    while True:
        pairs = np.unique(np.sort(ways[pairs], axis=1), axis=0)
        pairs = pairs[pairs[:, 0] != pairs[:, 1]]
        merged = False
        for a, b in sorted(pairs.tolist(), key=lambda pair: -float(moments.areas[pair].min())):
            a, b = int(ways[a]), int(ways[b])
            if a == b or moments.facing[a] @ moments.facing[b] <= 0:
                continue
            large, small = (a, b) if moments.areas[a] >= moments.areas[b] else (b, a)
            step = moments.means[small] - moments.means[large]
            whole = moments.areas[a] + moments.areas[b]
            spread = (
                moments.spreads[a]
                + moments.spreads[b]
                + moments.areas[a] * moments.areas[b] / whole * np.outer(step, step)
            )
            normal = np.linalg.eigh(spread)[1][:, 0]
            middle = moments.means[large] + moments.areas[small] / whole * step
            if max(moments.residual(k, normal, middle) for k in (a, b)) < tolerance / 2:
                moments.joined(large, small)
                ways[ways == small] = large
                merged = True
        if not merged:
            break
    _, ways = np.unique(ways, return_inverse=True)
    return np.where(labels >= 0, ways[labels], -1)


def border_pairs(surface: ScannedSurface, labels: Indices, gap: int) -> Indices:
    """Pairs (p, 2) of regions no more than `gap` triangles without a region apart from each other."""
    near = labels.copy()
    for _ in range(gap):
        beside = np.where(surface.neighbours >= 0, near[surface.neighbours], -1)
        near = np.where(near >= 0, near, beside.max(axis=1))
    beside = np.where(surface.neighbours >= 0, near[surface.neighbours], -1)
    pairs = np.stack([np.repeat(near, 3), beside.ravel()], axis=1)
    pairs = np.sort(pairs[(pairs >= 0).all(axis=1) & (pairs[:, 0] != pairs[:, 1])], axis=1)
    return np.unique(pairs, axis=0)


def without_rounding(surface: ScannedSurface, labels: Indices, reach: float) -> Indices:
    """Labels (m,) without regions that are no farther than `reach` metres from planes of larger ones beside them."""
    planes = fitted(surface, labels)
    beside: dict[int, set[int]] = {}
    for a, b in border_pairs(surface, labels, gap=3).tolist():
        beside.setdefault(a, set()).add(b)
        beside.setdefault(b, set()).add(a)
    gone = np.zeros(len(planes.areas), dtype=np.bool_)
    rows = np.argsort(labels, kind="stable")
    ends = np.searchsorted(labels[rows], np.arange(len(planes.areas) + 1))
    for region in np.argsort(planes.areas, kind="stable").tolist():
        larger = [k for k in sorted(beside.get(region, ())) if not gone[k] and planes.areas[k] > planes.areas[region]]
        if not larger:
            continue
        at = surface.centroids[rows[ends[region] : ends[region + 1]]]
        away = np.abs(np.einsum("tki,ki->tk", at[:, None] - planes.points[larger], planes.normals[larger]))
        gone[region] = np.quantile(away.min(axis=1), 0.9) < reach
    gone = np.append(gone, True)
    return _renumbered(np.where(gone[labels], -1, labels))


def without_islands(surface: ScannedSurface, labels: Indices, least_area: float) -> Indices:
    """Labels (m,) without connected pieces of less than an area, which become triangles of no region."""
    piece = pieces(surface.neighbours, labels)
    area = np.bincount(piece, surface.areas)
    return np.where(area[piece] >= least_area / 2, labels, -1)


def _without_pockets(surface: ScannedSurface, planes: PlanarRegions, labels: Indices, largest_area: float) -> Indices:
    """Labels (m,) with small pieces of no region given to the regions around them."""
    piece = pieces(surface.neighbours, labels)
    small = (np.bincount(piece, surface.areas)[piece] < largest_area) & (labels < 0)
    large = (labels < 0) & ~small
    filled = np.where(large, len(planes.areas), labels)  # keeps its place: a plane that nothing is near
    nowhere = np.zeros((1, 3))
    both = np.concatenate([planes.normals, nowhere]), np.concatenate([planes.points, nowhere])
    farthest = float(np.sqrt(largest_area))
    spread_labels(surface.neighbours, surface.centroids, surface.normals, both, farthest, ROUNDS, filled)
    return np.where(large, -1, np.where(small & (filled < len(planes.areas)), filled, labels))


def _renumbered(labels: Indices) -> Indices:
    """Labels (m,) from 0 on without gaps, -1 as it is."""
    return np.asarray(np.unique(np.append(labels, -1), return_inverse=True)[1][:-1] - 1, dtype=np.int64)
