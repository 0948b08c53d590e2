"""Winding of triangles: which of them are wound against their neighbours, so that they face the other way."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from uavbench.trajectories.geometry.bvh import build_tree
from uavbench.trajectories.geometry.rays import rays_blocked
from uavbench.trajectories.pose import Array

MERGED_PART = 1e-7
"""Distance of vertices that are one, in extents of the mesh: about the rounding of 32-bit numbers."""
FARTHEST = 1e90
"""Coordinates whose products of three are numbers; meshes beyond, which are refused, stay as they are."""

RAYS = 16
"""Rays from a triangle, by which the side is told that is seen from afar."""
CLOSED_PART = 1e-9
"""Volume that is none, in volumes of all closed bodies."""
BACK_SEEN = 1 / 16
"""Share of the rays that leave the back of a body of which it is seen; through the edges of others a few may pass."""
MOST_ASKED = 20_000
"""Triangles from which rays are cast, in a second: of more of them every second or so."""

Indices = NDArray[np.int64]
Mask = NDArray[np.bool_]


def merged(vertices: Array, triangles: Indices) -> Indices:
    """The triangles (m, 3), with one index for vertices (n, 3) at one place."""
    scale = max(float(np.ptp(vertices, axis=0).max()), 1e-9)
    places = np.round(vertices / (MERGED_PART * scale))
    order = np.lexsort(places.T)  # a third of the time of np.unique over rows
    is_next = (np.diff(places[order], axis=0) != 0).any(axis=1)
    same = np.empty(len(vertices), dtype=np.int64)
    same[order] = np.concatenate([[0], np.cumsum(is_next)])
    return np.asarray(same[triangles], dtype=np.int64)


def first_of_equal(corners: Indices) -> Indices:
    """For each of the triangles (m, 3) the first one with its corners on its side: itself, if it is no copy."""
    lowest = corners.argmin(axis=1)[:, None]
    turned = np.take_along_axis(corners, (lowest + np.arange(3)) % 3, axis=1)
    order = np.lexsort(turned.T)  # stable: of equal ones the first one leads
    leads = np.ones(len(corners), dtype=np.bool_)
    leads[1:] = (np.diff(turned[order], axis=0) != 0).any(axis=1)
    first = np.empty(len(corners), dtype=np.int64)
    first[order] = order[leads][np.cumsum(leads) - 1]
    return first


def wound_against(vertices: Array, triangles: Indices) -> Mask:
    """Mask (m,) of the triangles (m, 3) to be turned, for neighbours to face the same way; vertices (n, 3) in metres.

    Triangles that share an edge with just one other agree where they pass it in opposite directions. Of a body that
    disagrees with itself the side that more rays leave to infinity becomes its outside (Takayama et al. 2014); where
    they leave none, as few square metres as possible are turned. One-sided surfaces (Moebius) stay as they are. Bodies
    that agree with themselves do, too, except closed ones that face inwards, as mirrored copies of parts do, and of
    which the rays see the back: of a cavity they do not. Those within the bounds of another body stay as well, as rooms
    in a shell that is open somewhere. Where the closed bodies hold less than nothing in all, the
    whole mesh faces inwards, and none of them is turned. Of triangles that are there twice each goes with the first.
    """
    if not (len(triangles) and (np.abs(vertices) < FARTHEST).all()):
        return np.zeros(len(triangles), dtype=np.bool_)
    joined = merged(vertices, triangles)
    first = first_of_equal(joined)
    once = np.flatnonzero(first == np.arange(len(first)))
    out = np.zeros(len(triangles), dtype=np.bool_)
    out[once] = _turned_of(vertices, triangles[once], joined[once])
    return out[first]


def _turned_of(vertices: Array, triangles: Indices, joined: Indices) -> Mask:
    """The mask (m,) of triangles (m, 3) of which none is another one again; joined: those of merged vertices."""
    joints = _joints(joined)
    bodies = _bodies(joints, len(triangles))
    disagrees = np.bincount(bodies.body[joints.one], joints.against, minlength=len(triangles)) > 0
    corners = vertices[triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inwards = _inwards(joints, bodies, corners, normal) & ~disagrees
    inwards &= ~_inside_others(bodies.body, corners, inwards)
    asked = np.flatnonzero((disagrees[bodies.body] & bodies.two_sided) | inwards[bodies.body])
    if not len(asked):
        return np.zeros(len(triangles), dtype=np.bool_)
    area = np.linalg.norm(normal, axis=1)
    some = asked[:: 1 + len(asked) // MOST_ASKED]
    sign = np.where(bodies.is_reversed, -1.0, 1.0)
    seen = np.bincount(bodies.body[some], (sign * area)[some] * _outward(corners, normal, some), len(triangles))
    as_it_is = np.bincount(bodies.body, sign * area, len(triangles))
    flip = np.where(seen != 0, seen < 0, as_it_is < 0)
    all_seen = RAYS / 2 * np.bincount(bodies.body[some], area[some], len(triangles))
    flip[inwards] = (seen < -BACK_SEEN * all_seen)[inwards]
    out = np.zeros(len(triangles), dtype=np.bool_)
    out[asked] = bodies.is_reversed[asked] ^ flip[bodies.body[asked]]
    return out


@dataclass(frozen=True, eq=False)
class _Joints:
    """Triangles `one` and `other` (j,) that share an edge with no third, and whether they disagree."""

    one: Indices
    other: Indices
    against: Mask


def _joints(corners: Indices) -> _Joints:
    """Joints of triangles (m, 3) of merged vertices."""
    directed = np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]])
    low, high = directed.min(axis=1), directed.max(axis=1)
    _, edge, times = np.unique(low * (corners.max() + 1) + high, return_inverse=True, return_counts=True)
    times[edge[low == high]] = 0  # of a triangle without area
    order = np.argsort(edge, kind="stable")
    paired = order[(times[edge] == 2)[order]].reshape(-1, 2)
    one, other = (paired % len(corners)).T
    return _Joints(one, other, directed[paired[:, 0], 0] == directed[paired[:, 1], 0])


@dataclass(frozen=True, eq=False)
class _Bodies:
    """The body (m,) of each triangle, numbered below m, and whether it is wound against the body's first triangle.

    two_sided (m,): whether the body has two sides.
    """

    body: Indices
    is_reversed: Mask
    two_sided: Mask


def _bodies(joints: _Joints, m: int) -> _Bodies:
    """Bodies of joined triangles: each triangle is two nodes, as it is and turned, and those that agree are joined."""
    from scipy.sparse import coo_array  # lazy: meshes that agree with themselves do not need it
    from scipy.sparse.csgraph import connected_components

    one, other, against = joints.one, joints.other, joints.against
    links = np.concatenate([[one, other + m * against], [one + m, other + m * ~against]], axis=1)
    graph = coo_array((np.ones(links.shape[1], dtype=np.int8), tuple(links)), shape=(2 * m, 2 * m))
    as_is, turned = connected_components(graph, directed=False)[1].reshape(2, m)
    _, body = np.unique(np.minimum(as_is, turned), return_inverse=True)
    return _Bodies(body.reshape(-1), as_is > turned, as_is != turned)


def _inwards(joints: _Joints, bodies: _Bodies, corners: Array, normal: Array) -> Mask:
    """Closed bodies (m,) of negative volume, none where those of all closed bodies add up to less than nothing.

    normal (m, 3): of triangles corners (m, 3, 3), as long as twice their area.
    """
    m = len(corners)
    sides = np.bincount(bodies.body[joints.one], minlength=m) * 2
    is_closed = (sides > 0) & (sides == 3 * np.bincount(bodies.body, minlength=m))
    middle = corners.mean(axis=(0, 1))  # of large coordinates little would be left
    volume = np.where(is_closed, np.bincount(bodies.body, ((corners[:, 0] - middle) * normal).sum(axis=1), m), 0.0)
    rounding = CLOSED_PART * np.abs(volume).sum()
    return np.asarray((volume < -rounding) & (volume.sum() >= -rounding), dtype=np.bool_)


def _inside_others(body: Indices, corners: Array, asked: Mask) -> Mask:
    """Which bodies (m,) of those asked for lie within the bounds of another one; body (m,) of each triangle."""
    out = np.zeros(len(asked), dtype=np.bool_)
    if not asked.any():
        return out
    order = np.argsort(body, kind="stable")
    first = np.flatnonzero(np.diff(body[order], prepend=-1))
    number = body[order][first]
    low = np.minimum.reduceat(corners.min(axis=1)[order], first)
    high = np.maximum.reduceat(corners.max(axis=1)[order], first)
    for k in np.flatnonzero(asked[number]):
        out[number[k]] = np.count_nonzero(((low <= low[k]) & (high >= high[k])).all(axis=1)) > 1
    return out


def _outward(corners: Array, normal: Array, rows: Indices) -> Array:
    """Rays that leave some triangles (k,) of all (m, 3, 3) to infinity in front of them, less those behind them."""
    heights = (np.arange(RAYS) + 0.5) / RAYS * 2 - 1  # a Fibonacci spiral on the sphere
    turns = np.arange(RAYS) * np.pi * (3 - np.sqrt(5))
    flat = np.sqrt(1 - heights**2)
    rays = np.column_stack([flat * np.cos(turns), flat * np.sin(turns), heights])
    start_m = MERGED_PART * 100 * float(np.ptp(corners.reshape(-1, 3), axis=0).max())
    unit = normal[rows] / np.maximum(np.linalg.norm(normal[rows], axis=1, keepdims=True), 1e-300)
    middle, tree, out = corners[rows].mean(axis=1), build_tree(corners), np.zeros(len(rows))
    for side in (1.0, -1.0):
        leaving = np.broadcast_to(rays, (len(rows), RAYS, 3))
        away = side * (unit @ rays.T) > 0
        blocked = rays_blocked(tree, middle + side * start_m * unit, np.ascontiguousarray(leaving), np.inf)
        out += side * (away & ~blocked).sum(axis=1)
    return out
