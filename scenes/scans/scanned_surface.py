"""The surface of a scan: its triangles, which of them are neighbours, and how rough it is."""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from uavbench.scenes.scans.region_kernels import fit_patches
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


class Patches(NamedTuple):
    """Normals (k, 3) of patches, their rms distances (k,) from planes, metres, inf for closed ones, and areas (k,)."""

    normals: Array
    residuals: Array
    areas: Array


def fitted_patches(rows: Indices, neighbours: Indices, centroids: Array, vector_areas: Array, size: int) -> Patches:
    """The patches of `size` triangles about those in rows (k,), of triangles (m, 3) by their centroids and areas."""
    found = Patches(np.empty((len(rows), 3)), np.empty(len(rows)), np.empty(len(rows)))
    fit_patches(rows, neighbours, centroids, vector_areas, size, (found.normals, found.residuals, found.areas))
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
        """The surface of a mesh: vertices at one place are merged, and triangles without area left out."""
        welded = merged(vertices, triangles)
        _, first = np.unique(welded, return_index=True)
        vertices, triangles = (
            vertices[triangles.ravel()[first]],
            np.unique(welded, return_inverse=True)[1].reshape(-1, 3),
        )
        corners = vertices[triangles]
        cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        doubled = np.linalg.norm(cross, axis=1)
        kept = (doubled > 0) & (np.diff(np.sort(triangles, axis=1), axis=1) > 0).all(axis=1)
        triangles, corners, cross, doubled = triangles[kept], corners[kept], cross[kept], doubled[kept]
        piece = pieces(twins_of(triangles) // 3, np.zeros(len(triangles), dtype=np.int64))
        size = np.bincount(piece, doubled)
        kept = size[piece] >= FLOATING * size.sum()
        triangles, corners, cross, doubled = triangles[kept], corners[kept], cross[kept], doubled[kept]
        used, places = np.unique(triangles, return_inverse=True)
        triangles = places.reshape(-1, 3)
        centroids, areas = corners.mean(axis=1), doubled / 2
        twins = twins_of(triangles)
        about = twins // 3, centroids, cross / 2
        all_rows = np.arange(len(triangles))
        some = np.linspace(0, len(triangles) - 1, ASKED).astype(np.int64)
        near = fitted_patches(all_rows, *about, PATCH_TRIANGLES)
        noise = float(np.quantile(near.residuals, FLAT_SHARE, method="lower"))
        steep = max(FLAT, RISE * noise / float(np.sqrt(np.median(near.areas) / np.pi)))
        for count in WIDER:
            wide = fitted_patches(some, *about, count)
            residual = float(np.quantile(wide.residuals, FLAT_SHARE, method="lower"))
            if residual < steep * float(np.sqrt(np.median(wide.areas) / np.pi)):
                noise = max(noise, residual)
        return cls(vertices[used], triangles, centroids, areas, twins, near.normals, near.residuals, noise)

    @cached_property
    def neighbours(self) -> Indices:
        """Triangle (m, 3) across each side, -1 for none."""
        return np.asarray(self.twins // 3)

    @property
    def side_m(self) -> float:
        """Typical length of a triangle's side, metres: that of an equilateral one of the median area."""
        return float(np.sqrt(4 / np.sqrt(3) * np.median(self.areas)))


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
