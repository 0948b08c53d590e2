"""Number of false alarms of the edges and patches found, a test against chance (Desolneux, Moisan & Morel 2000).

Background model: on a search line with m random candidates at least one is within the cutoff of the M-estimator with
probability 1 - (1 - width / half length)^m. m is counted on each line, so that more edges are required in cluttered
images, which match by chance. Points of one part of an edge are found or missed together, so parts are counted. A
patch is found as easily as an edge with one candidate.

A search may lay the edges onto any straight line of the image: a horizon, a kerb. All edges that are seen on one line
are then found at once. So after a loss they count as one edge.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.tracker.robust.edges.columns import BINS
from uavbench.trajectories.kernels.argument_types import named_tuple
from uavbench.trajectories.kernels.compiled import compiled
from uavbench.trajectories.pose import Array

Indices = NDArray[np.int64]

PARTS_OF_LINE = BINS
"""Most parts of a straight line of an image that count: those of one edge."""


class Chance(NamedTuple):
    """Decimal logarithms of bounds on the probability that a random pose finds as much: of the edges alone, and of
    edges or edges and patches together, whichever is less likely.
    """

    edges: float
    whole: float


class Found(NamedTuple):
    """What was found at a pose.

    rows (n,), equal for the points of one part; distance (n, k) of the candidates in px, inf where none; weight (n,)
    and patch_weight (m,) > 0 for inliers; correlation (m,) < 0 for patches that were not searched; width_px: cutoff of
    the weights; half_px: half length of the search lines.
    """

    rows: Indices
    distance: Array
    weight: Array
    patch_weight: Array
    correlation: Array
    width_px: float
    half_px: float


FOUND = named_tuple(Found, "i1! f2! f1! f1! f1! f0 f0")


class Parts(NamedTuple):
    """Number of parts, how many of them are found, and how many chance would find."""

    number: int
    found: float
    expected: float


PARTS = named_tuple(Parts, "i0 f0 f0")


@compiled("f0 f0 i0", inner=True)
def log10_tail(found: float, expected: float, n: int) -> float:
    """log10 of Chernoff's bound on the probability that so many or more of n are found, where `expected` are."""
    if found <= expected:
        return 0.0
    if expected <= 0.0:
        return -math.inf
    bound = found * math.log(found / expected)
    if found < n:
        bound += (n - found) * math.log((n - found) / (n - expected))
    return min(0.0, -bound / math.log(10.0))


@compiled("found i0 i0", inner=True, found=FOUND)
def parts_between(found: Found, first: int, last: int) -> Parts:
    """The parts of edges that the points from row `first` up to `last` belong to."""
    parts, share, expected, p = 0, 0.0, 0.0, first
    by_candidate = 1.0 - found.width_px / found.half_px
    while p < last:
        start, inliers, by_chance = p, 0, 0.0
        while p < last and found.rows[p] == found.rows[start]:
            candidates = 0
            for k in range(found.distance.shape[1]):
                candidates += int(found.distance[p, k] < np.inf)
            by_chance += 1.0 - by_candidate**candidates
            inliers += int(found.weight[p] > 0.0)
            p += 1
        parts, share, expected = parts + 1, share + inliers / (p - start), expected + by_chance / (p - start)
    return Parts(parts, share, expected)


@compiled("found", inner=True, found=FOUND)
def patches_of(found: Found) -> Parts:
    """The patches that were searched."""
    patches, share = 0, 0.0
    for i in range(len(found.correlation)):
        if found.correlation[i] >= 0.0:
            patches += 1
            share += 1.0 if found.patch_weight[i] > 0.0 else 0.0
    return Parts(patches, share, patches * found.width_px / found.half_px)


@compiled("parts found", inner=True, parts=PARTS, found=FOUND)
def chance_of_parts(parts: Parts, found: Found) -> Chance:
    """Bounds on the probability that a random pose finds as many of these parts of edges, and the patches."""
    patches = patches_of(found)
    edges = log10_tail(parts.found, parts.expected, parts.number)
    whole = log10_tail(parts.found + patches.found, parts.expected + patches.expected, parts.number + patches.number)
    return Chance(edges, min(0.0, min(edges, whole) + math.log10(2.0)))


@compiled("found", found=FOUND)
def chance(found: Found) -> Chance:
    """Bounds on the probability that a random pose finds as many parts of edges, and patches."""
    return chance_of_parts(parts_between(found, 0, len(found.rows)), found)


@compiled("found i1 f2 f0", found=FOUND)
def chance_of_lines(found: Found, first: Indices, rays: Array, apart_rad: float) -> Chance:
    """Bounds as those of `chance`, of which all edges on one straight line of the image count as one.

    first, rays, apart_rad: see `lines_of_edges`.
    """
    lines = lines_of_edges(first, rays, apart_rad)
    counted, share, expected = np.zeros(len(lines)), np.zeros(len(lines)), np.zeros(len(lines))
    for g in range(len(lines)):
        parts = parts_between(found, first[g], first[g + 1])
        counted[lines[g]] += parts.number
        share[lines[g]] += parts.found
        expected[lines[g]] += parts.expected
    for line in range(len(lines)):
        if counted[line] > PARTS_OF_LINE:
            part = PARTS_OF_LINE / counted[line]
            counted[line], share[line], expected[line] = PARTS_OF_LINE, part * share[line], part * expected[line]
    return chance_of_parts(Parts(int(counted.sum()), share.sum(), expected.sum()), found)


@compiled("i1 f2 f0", inner=True)
def lines_of_edges(first: Indices, rays: Array, apart_rad: float) -> Indices:
    """The line of the image (g,) that each edge is seen on, named by the longest edge there.

    first (g + 1,): first row of each edge, and n; rays (n, 3): unit vectors from the camera to the points; apart_rad:
    edges of which both ends are no farther than this from a line, or from an edge that is no longer, are on it.
    """
    edges = len(first) - 1
    normals, length, lines = np.zeros((edges, 3)), np.zeros(edges), np.empty(edges, dtype=np.int64)
    for g in range(edges):
        normals[g] = np.cross(rays[first[g]], rays[first[g + 1] - 1])
        length[g] = math.sqrt((normals[g] ** 2).sum())
    longest, n = np.empty(edges, dtype=np.int64), 0
    for g in np.argsort(-length, kind="mergesort"):
        start, end, lines[g] = rays[first[g]], rays[first[g + 1] - 1], g
        for each in longest[:n]:
            if length[each] > apart_rad:
                away = max(abs((normals[each] * start).sum()), abs((normals[each] * end).sum())) / length[each]
            else:
                there = rays[first[each]]
                away = max(np.abs(start - there).max(), np.abs(end - there).max())
            if away <= apart_rad:
                lines[g] = each
                break
        if lines[g] == g:
            longest[n] = g
            n += 1
    return lines
