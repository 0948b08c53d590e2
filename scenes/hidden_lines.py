"""Hidden-line removal for drawings: the parts of a structure's edges that its own faces do not occlude.

Visibility is sampled along every edge; between a visible and a hidden sample the transition is found by bisection.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from uavbench.scenes.structure import Structure
from uavbench.trajectories.geometry.bvh import Tree, build_tree
from uavbench.trajectories.geometry.rays import ray_distances
from uavbench.trajectories.pose import Array

PROBES = 25
"""Samples along an edge: an occluder of less than 4 % of its length may be missed."""
BISECTIONS = 6
"""Bisections: a transition is known to 1/64 of the step between two samples, 1/4 px on an edge of 400 px."""
MARGIN = 1e-3
"""Relative depth tolerance, so that an edge is not occluded by its own or adjacent faces."""


def seen_parts(structure: Structure, eye_m: Array, segments_m: Array) -> Array:
    """Visible parts (j, 2, 3) of segments (k, 2, 3) on the structure from a viewpoint (3,), world frame, metres."""
    if not len(segments_m):
        return np.zeros((0, 2, 3))
    start, along = segments_m[:, 0], segments_m[:, 1] - segments_m[:, 0]

    def seen(rows: NDArray[np.int64], places: Array) -> NDArray[np.bool_]:
        return unhidden(structure, eye_m, start[rows] + places[:, None] * along[rows])

    places = np.linspace(0.0, 1.0, PROBES)
    rows = np.repeat(np.arange(len(segments_m)), PROBES - 1)
    middles = (places[:-1] + places[1:]) / 2  # not the ends, where other faces meet
    clear = seen(rows, np.tile(middles, len(segments_m))).reshape(len(segments_m), -1)
    row, left = np.nonzero(clear[:, 1:] != clear[:, :-1])
    low, high = middles[left], middles[left + 1]
    for _ in range(BISECTIONS if len(row) else 0):
        middle = (low + high) / 2
        like_low = seen(row, middle) == clear[row, left]
        low, high = np.where(like_low, middle, low), np.where(like_low, high, middle)
    borders = (low + high) / 2
    parts = []
    for k in range(len(segments_m)):
        ends = np.concatenate([[0.0], borders[row == k], [1.0]])
        first = 0 if clear[k, 0] else 1
        parts += [(k, ends[i], ends[i + 1]) for i in range(first, len(ends) - 1, 2)]
    index = np.array([k for k, _, _ in parts], dtype=np.int64)
    ends = np.array([[a, b] for _, a, b in parts]).reshape(-1, 2, 1)
    return np.asarray(start[index, None] + ends * along[index, None])


def unhidden(structure: Structure, eye_m: Array, points_m: Array) -> NDArray[np.bool_]:
    """Mask (n,) of points (n, 3) that no face occludes from a viewpoint eye_m (3,), world frame, metres."""
    if not len(points_m):
        return np.zeros(0, dtype=np.bool_)
    rays = points_m - eye_m
    distances = np.linalg.norm(rays, axis=1)
    directions = rays / np.maximum(distances, 1e-12)[:, None]
    met = ray_distances(_tree(structure), np.broadcast_to(eye_m, rays.shape).copy(), directions)
    return np.asarray(met >= (1 - MARGIN) * distances)


@lru_cache(maxsize=8)
def _tree(structure: Structure) -> Tree:
    return build_tree(structure.vertices[structure.triangles])
