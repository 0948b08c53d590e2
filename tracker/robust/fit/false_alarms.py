"""Number of false alarms of what is found at a pose, a test against chance (Desolneux, Moisan & Morel 2000).

What is found is judged by its likelihood ratio. If chance has put m candidates on a search line of half length h, the
nearest one is at the distance r with the density m / h (1 - r / h)^(m - 1). If the structure is there, a part of it is
hidden, where chance finds what it finds, and elsewhere r is normal. How large that part is, is not known: the ratio is
the mean over all parts. Under chance its expectation is no more than one, so that by Markov's inequality the
probability of a ratio as large is no more than its inverse (an e-value: Vovk & Wang 2021, Annals of Statistics 49).

Points of one part of an edge are found or missed together, and count as one, by the geometric mean of their ratios. Any
straight line of the image, a horizon or a kerb, passes for all edges at once that are seen on one line.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.trajectories.kernels.argument_types import named_tuple
from uavbench.trajectories.kernels.compiled import compiled
from uavbench.trajectories.pose import Array

Indices = NDArray[np.int64]
LN_10 = math.log(10.0)

PARTS_OF_LINE = 6
"""Most parts of a straight line of an image that count, of the eight of an edge: those beside each other tell less than
as many apart. Chosen on 2,797 fits from displaced poses, and checked on 2,910 others (docs/robust-measured.md).
"""
HIDDEN_PARTS = (np.arange(10) + 0.5) / 10
"""Parts of the structure that may be hidden, in the middle of equal steps from none to all."""

OTHERWISE_HIDDEN = 0.1
"""Probability that of what one pose shows beside another one a part is hidden that the rest tells nothing of: as
something passes before it, or as light leaves it without contrast, a pipe before brick for example."""


class Chance(NamedTuple):
    """Decimal logarithms of bounds on the probability that a random pose finds as much: of the edges alone, and of
    edges or edges and patches together, whichever is less likely.
    """

    edges: float
    whole: float


class Found(NamedTuple):
    """What was found at a pose.

    Control points: rows (n,), equal for the points of one part; first (g + 1,) of each edge; candidates (n,), number of
    those on a search line; residual (n,) of the nearest one, px, infinite where it was skipped; variance_px2 (n,).
    Patches: patch_weight (m,) > 0 for inliers; correlation (m,) < 0 for those that were not searched. half_px: half
    length of the search lines; patch_px: distance within which a patch is found.
    """

    rows: Indices
    first: Indices
    candidates: Indices
    residual: Array
    variance_px2: Array
    patch_weight: Array
    correlation: Array
    half_px: float
    patch_px: float


FOUND = named_tuple(Found, "i1! i1! i1! f1! f1! f1! f1! f0 f0")


@compiled("found i0", inner=True, allocates=False, found=FOUND)
def likelihood_ratio(found: Found, p: int) -> float:
    """Ratio of the likelihoods of a control point's nearest candidate if its edge is there, and by chance."""
    candidates, r, half_px = found.candidates[p], abs(found.residual[p]), found.half_px
    if candidates == 0 or not r < half_px:
        return 0.0
    variance_px2 = found.variance_px2[p]
    there = math.exp(-0.5 * r * r / variance_px2) * math.sqrt(2.0 / (math.pi * variance_px2))
    return float(there * half_px / (candidates * (1.0 - r / half_px) ** (candidates - 1)))


@compiled("i1! i0 i0", inner=True, allocates=False)
def parts_between(rows: Indices, first: int, last: int) -> int:
    """Number of parts that the points from row `first` up to `last` belong to."""
    parts = int(last > first)
    for p in range(first + 1, last):
        parts += int(rows[p] != rows[p - 1])
    return parts


@compiled("found i1", inner=True, found=FOUND)
def ratios_of_edges(found: Found, lines: Indices) -> Array:
    """Logarithm of the likelihood ratio of all edges, by the part that is hidden; lines: see `lines_of_edges`."""
    edges, hidden = len(lines), len(HIDDEN_PARTS)
    on_line, total, product = np.zeros(edges), np.zeros(hidden), np.empty(hidden)
    for g in range(edges):
        on_line[lines[g]] += parts_between(found.rows, found.first[g], found.first[g + 1])
    for g in range(edges):
        counted, p = min(1.0, PARTS_OF_LINE / max(1.0, on_line[lines[g]])), found.first[g]
        while p < found.first[g + 1]:
            start = p
            product[:] = 1.0
            while p < found.first[g + 1] and found.rows[p] == found.rows[start]:
                ratio = likelihood_ratio(found, p)
                for i in range(hidden):
                    product[i] *= HIDDEN_PARTS[i] + (1.0 - HIDDEN_PARTS[i]) * ratio
                p += 1
            for i in range(hidden):
                total[i] += counted / (p - start) * math.log(product[i])
    return total


@compiled("found", inner=True, found=FOUND)
def ratios_of_patches(found: Found) -> Array:
    """Logarithm of the likelihood ratio of the patches that were searched, by the part that is hidden.

    A patch is found by chance as easily as an edge with one candidate.
    """
    total, by_chance = np.zeros(len(HIDDEN_PARTS)), found.patch_px / found.half_px
    for m in range(len(found.correlation)):
        if found.correlation[m] >= 0.0:
            ratio = 1.0 / by_chance if found.patch_weight[m] > 0.0 else 0.0
            for i in range(len(HIDDEN_PARTS)):
                total[i] += math.log(HIDDEN_PARTS[i] + (1.0 - HIDDEN_PARTS[i]) * ratio)
    return total


@compiled("f1", inner=True)
def log10_bound(ratios: Array) -> float:
    """Decimal logarithm of the inverse of the mean of ratios (k,), which are given by their logarithms."""
    most, total = ratios.max(), 0.0
    for each in ratios:
        total += math.exp(each - most)
    return float(-(most + math.log(total / len(ratios))) / LN_10)


def evidence(some: Array, others: Array) -> float:
    """Decimal logarithm of the likelihood ratio of some points, given what others tell of the part that is hidden.

    Both by the logarithms (k,) of their ratios by that part. Of the points another part may be hidden, any of them.
    """
    alike = np.exp(others - others.max())
    part = (1.0 - OTHERWISE_HIDDEN) * alike / alike.sum() + OTHERWISE_HIDDEN / len(others)
    return float(np.logaddexp.reduce(np.log(part) + some)) / LN_10


@compiled("found i1", inner=True, found=FOUND)
def chance(found: Found, lines: Indices) -> Chance:
    """Bounds on the probability that a random pose finds as much; lines (g,) of the edges: see `lines_of_edges`."""
    of_edges = ratios_of_edges(found, lines)
    edges, whole = log10_bound(of_edges), log10_bound(of_edges + ratios_of_patches(found))
    return Chance(min(0.0, edges), min(0.0, min(edges, whole) + math.log10(2.0)))


@compiled("f2 f1 f2! i1! f0", inner=True)
def lines_of_edges(R: Array, t: Array, points: Array, first: Indices, apart_rad: float) -> Indices:
    """The line of the image (g,) that each edge is seen on at a pose, named by the longest edge there.

    points (n, 3) on the edges, first (g + 1,) row of each and n; apart_rad: edges of which both ends are no farther
    than this from a line, or from an edge that is no longer, are on it.
    """
    edges = len(first) - 1
    ends, normals, length = np.empty((edges, 2, 3)), np.empty((edges, 3)), np.empty(edges)
    for g in range(edges):
        for side in range(2):
            p, norm = first[g] if side == 0 else first[g + 1] - 1, 0.0
            for i in range(3):
                ends[g, side, i] = R[i, 0] * points[p, 0] + R[i, 1] * points[p, 1] + R[i, 2] * points[p, 2] + t[i]
                norm += ends[g, side, i] ** 2
            for i in range(3):
                ends[g, side, i] /= math.sqrt(norm)
        a, b = ends[g, 0], ends[g, 1]
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            normals[g, i] = a[j] * b[k] - a[k] * b[j]
        length[g] = math.sqrt(normals[g, 0] ** 2 + normals[g, 1] ** 2 + normals[g, 2] ** 2)
    lines, longest, n = np.empty(edges, dtype=np.int64), np.empty(edges, dtype=np.int64), 0
    for edge in np.argsort(-length, kind="mergesort"):
        lines[edge] = edge
        for each in longest[:n]:
            if is_on_line(ends[edge], ends[each, 0], normals[each], length[each], apart_rad):
                lines[edge] = each
                break
        if lines[edge] == edge:
            longest[n] = edge
            n += 1
    return lines


@compiled("f2 f1 f1 f0 f0", inner=True, allocates=False)
def is_on_line(ends: Array, start: Array, normal: Array, length: float, apart_rad: float) -> bool:
    """Whether both ends (2, 3) are seen near the line with a normal (3,), or, if that is a point, near its start."""
    for side in range(2):
        away = 0.0
        for i in range(3):
            if length > apart_rad:
                away += normal[i] * ends[side, i] / length
            else:
                away = max(away, abs(ends[side, i] - start[i]))
        if abs(away) > apart_rad:
            return False
    return True
