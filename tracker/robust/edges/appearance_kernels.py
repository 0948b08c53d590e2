"""Compiled learning of what the edges of an image look like, from a fit."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.tracker.robust.config.edges import AppearanceConfig
from uavbench.tracker.robust.edges.measurements import SEARCH_LINES, SearchLines
from uavbench.tracker.robust.edges.profile_kernels import APPEARANCE, Image, learn, learn_squares
from uavbench.tracker.robust.edges.steps.blur_kernels import excess_blur
from uavbench.tracker.robust.edges.steps.colour_kernels import SeenColours, colours_apart, nothing_seen
from uavbench.tracker.robust.edges.steps.optics_kernels import COLOURS, OPTICS, Optics, displaced_px, learned_light
from uavbench.tracker.robust.edges.steps.sharpening_kernels import UNKNOWN, Excess, Sharpened, excess_sharpening
from uavbench.trajectories.kernels.argument_types import named_tuple
from uavbench.trajectories.kernels.compiled import compiled
from uavbench.trajectories.pose import Array

Indices = NDArray[np.int64]


class Images(NamedTuple):
    """A frame's image (h, w, c) as edges are searched in it, and as they are located in it: before it was smoothed."""

    searched: Image
    sharp: Image


class LookedAt(NamedTuple):
    """Control points after a fit: rows (n,) of appearance, signed residual (n,) in px, weight (n,) in the fit.

    steps (n,): number of steps of light that locate each, 0 where none does. by_numbers (n, r): derivatives of the
    residual for the numbers that all edges share, numbers (r,), which it is before.
    """

    rows: Indices
    residual: Array
    weight: Array
    steps: Indices
    by_numbers: Array
    numbers: Array


class Nearness(NamedTuple):
    """Residuals in px below which the step at a control point is its edge's, and the colours beside it are; the optics
    that are assumed, the amount of sharpening that was undone, and whether it is asked for.
    """

    near_px: float
    beside_px: float
    optics: Optics
    undone: float
    asks: bool


class SeenOptics(NamedTuple):
    """What an image shows beside the optics that were assumed, NaN where unknown: variance of its blur in px^2 if it
    was not sharpened; what it shows if it was, and where its colours lie, where that is asked for.
    """

    blur_px2: float
    if_sharpened: Excess
    colours: SeenColours


IMAGES = named_tuple(Images, "u3 u3")
LOOKED_AT = named_tuple(LookedAt, "i1! f1! f1! i1! f2! f1!")
NEARNESS = named_tuple(Nearness, "f0 f0 optics f0 b0", optics=OPTICS)


@compiled(
    "images lines seen f2 f2! nearness appearance",
    inner=True,
    images=IMAGES,
    lines=SEARCH_LINES,
    seen=LOOKED_AT,
    nearness=NEARNESS,
    appearance=APPEARANCE,
)
def learn_appearance(
    images: Images,
    at: SearchLines,
    seen: LookedAt,
    covariance: Array,
    appearance: Array,
    limits: Nearness,
    config: AppearanceConfig,
) -> SeenOptics:
    """Update `appearance` in place from a fit with this covariance (6, 6); what the image shows of its optics."""
    n, rows = len(seen.rows), seen.rows
    distance, found, alone, colour = np.full(n, np.inf), np.zeros(n), np.full(n, np.inf), np.empty(COLOURS)
    for p in range(n):
        by_numbers = 0.0
        for k in range(len(seen.numbers)):
            by_numbers += seen.by_numbers[p, k] * seen.numbers[k]
        residual = seen.residual[p] - by_numbers
        away = abs(residual)
        if away < limits.near_px:
            distance[p] = residual
            if seen.steps[p] == 1 and seen.weight[p] > 0.0:
                row, line = appearance[rows[p]], at.lines[p]
                learned_light(row, images.sharp.shape[2], limits.optics, colour)
                alone[p] = residual + displaced_px(row, images.sharp, line, limits.optics, colour)
        if away < limits.beside_px:
            found[p] = seen.weight[p]
    learn_squares(at, rows, distance, covariance, appearance, config)
    learn(images.searched, at, rows, found, appearance, config)
    if_sharpened, colours = UNKNOWN, nothing_seen()
    if limits.asks:
        colours = colours_apart(images.sharp, at, rows, appearance, alone, limits.optics)
        if_sharpened = excess_sharpening(
            images.sharp, at, rows, appearance, alone, Sharpened(limits.optics, limits.undone)
        )
    blur_px2 = excess_blur(images.sharp, at, rows, appearance, alone, limits.optics)
    return SeenOptics(blur_px2, if_sharpened, colours)
