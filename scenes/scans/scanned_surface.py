"""The surface of a scan: its triangles, which of them are neighbours, and how rough it is."""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from uavbench.scenes.primitives.meshes import TriangleMesh
from uavbench.scenes.scans.region_kernels import Patches, fit_patches
from uavbench.scenes.structure import Indices
from uavbench.trajectories.geometry.winding import merged
from uavbench.trajectories.pose import Array

FLOATING = 0.01
"""Part of a scan's surface of which a separate piece is more than a floating bit."""
PATCH_TRIANGLES = 40
"""Triangles about each one to whose vector area its normal is smoothed: some two lengths of a side to either side."""
WIDER = (160, 640, 2560)
"""Triangles of patches by which errors are seen that neighbours have in common."""
ASKED = 500
"""Patches of each size, evenly spread over the triangles of the file."""
FLAT_SHARE = 0.25
"""Share of a scan's patches that have no edge in them, at least: the noise is the residual of this quantile."""
FLAT = 0.03
"""Residual of a patch without an edge, in radii: that of one in two halves at right angles is 0.2."""
RISE = 1.2
"""Growth of a residual in radii up to which wider patches still show noise: edges make it grow, noise makes it fall."""


def fitted_patches(rows: Indices, neighbours: Indices, centroids: Array, vector_areas: Array, size: int) -> Patches:
    """The patches of `size` triangles about those in rows (k,), of triangles (m, 3) by their centroids and areas."""
    found = Patches(np.empty((len(rows), 3)), np.empty(len(rows)), np.empty(len(rows)))
    fit_patches(rows, neighbours, centroids, vector_areas, size, found)
    return found


@dataclass(frozen=True, eq=False)
class ScannedSurface:
    """Welded triangles (m, 3) of vertices (n, 3), and of each its centroid and area, and the sides (m, 3) that its
    sides meet, as 3 * triangle + corner, -1 for none.

    normals (m, 3) are those of the patch about each triangle; residuals (m,) its rms distance from a plane,
    and noise_m that of patches without an edge, metres.
    """

    vertices: Array
    triangles: Indices
    centroids: Array
    areas: Array
    twins: Indices
    normals: Array
    residuals: Array
    noise_m: float

    @classmethod
    def of(cls, vertices: Array, triangles: Indices) -> "ScannedSurface":
        """The surface of a mesh: vertices at one place are merged; without flat triangles and floating bits."""
        vertices, triangles = _welded(vertices, triangles)
        triangles = triangles[_have_area(vertices, triangles)]
        triangles = triangles[_are_of_the_scan(vertices, triangles)]
        used, places = np.unique(triangles, return_inverse=True)
        vertices, triangles = vertices[used], places.reshape(-1, 3)
        centroids, vector_areas = vertices[triangles].mean(axis=1), _doubled(vertices, triangles) / 2
        twins = twins_of(triangles)
        fitted = partial(fitted_patches, neighbours=twins // 3, centroids=centroids, vector_areas=vector_areas)
        near = fitted(np.arange(len(triangles)), size=PATCH_TRIANGLES)
        some = np.linspace(0, len(triangles) - 1, ASKED).astype(np.int64)
        noise = _noise_m(near, (fitted(some, size=count) for count in WIDER))
        areas = np.linalg.norm(vector_areas, axis=1)
        return cls(vertices, triangles, centroids, areas, twins, near.normals, near.residuals, noise)

    @cached_property
    def neighbours(self) -> Indices:
        """Triangle (m, 3) across each side, -1 for none."""
        return np.asarray(self.twins // 3)

    @property
    def side_m(self) -> float:
        """Typical length of a triangle's side, metres: that of an equilateral one of the median area."""
        return float(np.sqrt(4 / np.sqrt(3) * np.median(self.areas)))


def _welded(vertices: Array, triangles: Indices) -> TriangleMesh:
    """The triangles with one vertex for all those at one place."""
    joined = merged(vertices, triangles)
    _, first, numbers = np.unique(joined, return_index=True, return_inverse=True)
    return TriangleMesh(vertices[triangles.ravel()[first]], numbers.reshape(-1, 3))


def _doubled(vertices: Array, triangles: Indices) -> Array:
    """Twice the vector areas (m, 3) of triangles, square metres."""
    corners = vertices[triangles]
    return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])


def _have_area(vertices: Array, triangles: Indices) -> NDArray[np.bool_]:
    """Which triangles (m,) have an area, and three vertices."""
    distinct = (np.diff(np.sort(triangles, axis=1), axis=1) > 0).all(axis=1)
    return np.asarray((np.linalg.norm(_doubled(vertices, triangles), axis=1) > 0) & distinct)


def _are_of_the_scan(vertices: Array, triangles: Indices) -> NDArray[np.bool_]:
    """Which triangles (m,) are of no floating bit: of a piece of a hundredth of the surface at least."""
    piece = pieces(twins_of(triangles) // 3, np.zeros(len(triangles), dtype=np.int64))
    size = np.bincount(piece, np.linalg.norm(_doubled(vertices, triangles), axis=1))
    return np.asarray(size[piece] >= FLOATING * size.sum())


def _noise_m(near: Patches, wider: Iterable[Patches]) -> float:
    """Standard deviation of flat patches about their planes, metres; of wider ones while they show noise, not shape."""
    noise = float(np.quantile(near.residuals, FLAT_SHARE, method="lower"))
    steep = max(FLAT, RISE * noise / float(np.sqrt(np.median(near.areas) / np.pi)))
    for wide in wider:
        residual = float(np.quantile(wide.residuals, FLAT_SHARE, method="lower"))
        if residual < steep * float(np.sqrt(np.median(wide.areas) / np.pi)):
            noise = max(noise, residual)
    return noise


def twins_of(triangles: Indices) -> Indices:
    """Of each side (m, 3), from corner k to the next, that of its neighbour, as 3 * triangle + corner; -1 for none.

    Where more than two triangles meet none is a neighbour.
    """
    n = int(triangles.max()) + 1
    start, end = triangles.ravel(), triangles[:, [1, 2, 0]].ravel()
    key, against = start * n + end, end * n + start
    order = np.argsort(key, kind="stable")
    place = np.minimum(np.searchsorted(key[order], against), len(key) - 1)
    found = order[place]
    once = np.ones(len(key), dtype=np.bool_)
    alike = key[order][1:] == key[order][:-1]
    once[order[1:][alike]] = once[order[:-1][alike]] = False
    fits = (key[found] == against) & once[found] & once
    return np.where(fits, found, -1).reshape(-1, 3)


def pieces(neighbours: Indices, labels: Indices) -> Indices:
    """Number (m,) of the connected piece of equal labels (m,) that each triangle belongs to."""
    from scipy.sparse import coo_array  # lazy: trackers do not need it
    from scipy.sparse.csgraph import connected_components

    one, other = np.repeat(np.arange(len(labels)), 3), neighbours.ravel()
    same = (other >= 0) & (labels[one] == labels[np.maximum(other, 0)])
    ones = np.ones(int(same.sum()), dtype=np.int8)
    links = coo_array((ones, (one[same], other[same])), shape=(len(labels), len(labels)))
    return np.asarray(connected_components(links, directed=False)[1], dtype=np.int64)
