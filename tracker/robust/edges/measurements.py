"""Arrays passed between the stages of a fit: control points, their search lines, candidates and weights."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.trajectories.kernels.argument_types import named_tuple
from uavbench.trajectories.pose import Array

Indices = NDArray[np.int64]


class ControlPoints(NamedTuple):
    """Points on the visible edges, grouped by edge.

    points (n, 3) in the world; keys (n, 3): see `columns`; rows (n,) of appearance; first (g + 1,) first row of each of
    the g edges in view, and n.
    """

    points: Array
    keys: Indices
    rows: Indices
    first: Indices


class SearchLines(NamedTuple):
    """Control points at a pose.

    lines (n, 4) pixel and unit normal; jacobian (n, 6) motion in px along the normal per unit of a twist of the
    camera; side (n,) a code of `columns`.
    """

    lines: Array
    jacobian: Array
    side: Indices


class Candidates(NamedTuple):
    """Intensity steps found on the search lines, k for each.

    distance (n, k) from the line's middle, px, inf where none; contrast (n, k), grey levels.
    """

    distance: Array
    contrast: Array


class EdgeMeasurements(NamedTuple):
    """Measurements of the edges in an image: weight (n,) in [0, 1] before robust weighting, variance_px2 (n,).

    by_numbers (n, r): derivatives of the distances for the numbers that all edges share, px.
    """

    points: ControlPoints
    lines: SearchLines
    candidates: Candidates
    weight: Array
    variance_px2: Array
    by_numbers: Array


CONTROL_POINTS = named_tuple(ControlPoints, "f2! i2! i1! i1!")
SEARCH_LINES = named_tuple(SearchLines, "f2! f2! i1!")
CANDIDATES = named_tuple(Candidates, "f2! f2!")
EDGE_MEASUREMENTS = named_tuple(
    EdgeMeasurements,
    "points lines candidates f1! f1! f2!",
    points=CONTROL_POINTS,
    lines=SEARCH_LINES,
    candidates=CANDIDATES,
)
