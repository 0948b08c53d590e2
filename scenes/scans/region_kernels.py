"""Compiled kernels over the neighbours of a scan's triangles: patches, and growth of planar regions."""

from typing import NamedTuple

import numpy as np

from uavbench.scenes.structure import Indices
from uavbench.trajectories.kernels.argument_types import named_tuple
from uavbench.trajectories.kernels.compiled import compiled
from uavbench.trajectories.pose import Array

NEAR = 0.5
"""Cost of an angle, times one less its cosine: that of 0.7 of the reach for a triangle at right angles to a plane."""
STRAIGHT = 0.05
"""Cost of each side of a triangle that is a border, by which borders are short: of a fifth of the reach."""
FIRST_FIT = 30
"""Triangles of a region after which its plane is fitted first."""

REFIT = 1.5
"""Growth of a region after which its plane is fitted again."""


class Patches(NamedTuple):
    """Normals (k, 3) of patches, their rms distances (k,) from planes, metres, inf for closed ones, and areas (k,)."""

    normals: Array
    residuals: Array
    areas: Array


PATCHES = named_tuple(Patches, "f2! f1! f1!")


@compiled("i1 i2 f2 f2 i0 patches", patches=PATCHES)
def fit_patches(
    rows: Indices,
    neighbours: Indices,
    centroids: Array,
    vector_areas: Array,
    size: int,
    found: Patches,
) -> None:
    """Fit a plane to the patch of `size` triangles about each of those in rows (k,)."""
    seen = np.full(len(centroids), -1, np.int64)
    queue = np.empty(size, np.int64)
    for row in range(len(rows)):
        t = rows[row]
        queue[0], seen[t], n, at = t, t, 1, 0
        while at < n:
            for k in range(3):
                other = neighbours[queue[at], k]
                if n < size and other >= 0 and seen[other] != t:
                    seen[other], queue[n] = t, other
                    n += 1
            at += 1
        whole, cx, cy, cz, nx, ny, nz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for i in range(n):
            q = queue[i]
            x, y, z = vector_areas[q, 0], vector_areas[q, 1], vector_areas[q, 2]
            area = np.sqrt(x * x + y * y + z * z)
            whole += area
            nx += x
            ny += y
            nz += z
            cx += area * centroids[q, 0]
            cy += area * centroids[q, 1]
            cz += area * centroids[q, 2]
        length = max(np.sqrt(nx * nx + ny * ny + nz * nz), 1e-300)
        nx, ny, nz = nx / length, ny / length, nz / length
        offset = (nx * cx + ny * cy + nz * cz) / whole
        total = 0.0
        for i in range(n):
            q = queue[i]
            x, y, z = vector_areas[q, 0], vector_areas[q, 1], vector_areas[q, 2]
            d = nx * centroids[q, 0] + ny * centroids[q, 1] + nz * centroids[q, 2] - offset
            total += np.sqrt(x * x + y * y + z * z) * d * d
        found.normals[row, 0], found.normals[row, 1], found.normals[row, 2] = nx, ny, nz
        found.residuals[row] = np.sqrt(total / whole) if 4 * length > whole else np.inf
        found.areas[row] = whole


class Limits(NamedTuple):
    """A region takes neighbours whose normals have a larger cosine with its own, within a distance of its plane in
    metres, and has at least an area in square metres.
    """

    cosine: float
    distance_m: float
    area_m2: float


LIMITS = named_tuple(Limits, "f0 f0 f0")


@compiled("i1 i2 f2 f2 f1 limits i1!", limits=LIMITS)
def grow_regions(
    order: Indices,
    neighbours: Indices,
    centroids: Array,
    normals: Array,
    areas: Array,
    limits: Limits,
    labels: Indices,
) -> None:
    """Label (m,) the triangles of planar regions from 0 on, -1 for none, from seeds in an order (s,)."""
    m = len(centroids)
    tried = np.full(m, -1, np.int64)
    queue = np.empty(m, np.int64)
    regions = 0
    mean, normal = np.empty(3), np.empty(3)
    for s in range(len(order)):
        seed = order[s]
        if labels[seed] >= 0 or tried[seed] >= 0:
            continue
        for k in range(3):
            mean[k], normal[k] = centroids[seed, k], normals[seed, k]
        queue[0], tried[seed], n, at = seed, s, 1, 0
        whole = 0.0
        first, second = np.zeros(3), np.zeros((3, 3))
        fit_at = float(FIRST_FIT)
        while at < n:
            t = queue[at]
            at += 1
            a = areas[t]
            whole += a
            for i in range(3):
                x = centroids[t, i] - centroids[seed, i]
                first[i] += a * x
                for j in range(3):
                    second[i, j] += a * x * (centroids[t, j] - centroids[seed, j])
            if at >= fit_at:
                fit_at = at * REFIT
                middle = first / whole
                spread = second / whole - np.outer(middle, middle)
                axis = np.ascontiguousarray(np.linalg.eigh(spread)[1][:, 0])
                way = axis[0] * normal[0] + axis[1] * normal[1] + axis[2] * normal[2]
                for k in range(3):
                    normal[k] = axis[k] if way > 0 else -axis[k]
                    mean[k] = middle[k] + centroids[seed, k]
            for k in range(3):
                other = neighbours[t, k]
                if other < 0 or labels[other] >= 0 or tried[other] == s:
                    continue
                away, turned = 0.0, 0.0
                for i in range(3):
                    away += normal[i] * (centroids[other, i] - mean[i])
                    turned += normal[i] * normals[other, i]
                if abs(away) < limits.distance_m and turned > limits.cosine:
                    tried[other], queue[n] = s, other
                    n += 1
        if whole >= limits.area_m2:
            for i in range(n):
                labels[queue[i]] = regions
            regions += 1


@compiled("i2 f2 f2 (f2 f2) f0 i0 i1!")
def spread_labels(
    neighbours: Indices,
    centroids: Array,
    normals: Array,
    planes: tuple[Array, Array],
    reach: float,
    rounds: int,
    labels: Indices,
) -> None:
    """Give triangles without a region, and those at the borders of regions, the best plane among their neighbours'.

    planes: their normals and points. Best is the nearest, by distance and angle; none is farther than `reach` metres.
    """
    plane_normals, plane_points = planes
    m = len(centroids)
    new = labels.copy()
    for _ in range(rounds):
        changed = 0
        for t in range(m):
            best, least = labels[t], 1e300
            border = labels[t] < 0
            for k in range(3):
                other = neighbours[t, k]
                if other >= 0 and labels[other] != labels[t]:
                    border = True
            if not border:
                continue
            for k in range(-1, 3):
                label = labels[t] if k < 0 else (labels[neighbours[t, k]] if neighbours[t, k] >= 0 else -1)
                if label < 0:
                    continue
                away, turned = 0.0, 0.0
                for i in range(3):
                    away += plane_normals[label, i] * (centroids[t, i] - plane_points[label, i])
                    turned += plane_normals[label, i] * normals[t, i]
                away = abs(away) / reach
                if away > 1.0 or turned < 0.0:
                    continue
                other_sides = 0.0
                for j in range(3):
                    if neighbours[t, j] >= 0 and labels[neighbours[t, j]] != label:
                        other_sides += 1.0
                cost = away * away + NEAR * (1.0 - turned) + STRAIGHT * other_sides
                if cost < least - 1e-12:
                    best, least = label, cost
            if best != labels[t]:
                changed += 1
            new[t] = best
        for t in range(m):
            labels[t] = new[t]
        if changed == 0:
            break
