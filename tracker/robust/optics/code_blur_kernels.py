"""Compiled displacement of edges, if what blurs an image beyond its pixels blurred its codes and not its light.

Lens, pixel and motion blur light, before it becomes codes. What makes an image smaller or larger, smooths it or
interpolates its colours may blur codes, which displaces the steps of light that fit them best to their dark sides. Both
look alike: within half a per cent of the height of a step.
"""

import numpy as np
from numpy.typing import NDArray

from uavbench.tracker.robust.edges.columns import NEGATIVE_COLOUR, POSITIVE_COLOUR
from uavbench.tracker.robust.edges.steps.optics_kernels import COLOURS, OPTICS, PIXEL_PX, Optics, learned_light
from uavbench.tracker.robust.edges.steps.sum_kernels import AT, SLOPE, STEP, STEPS_PER_WIDTH
from uavbench.trajectories.kernels.compiled import compiled, inlined
from uavbench.trajectories.pose import Array

REACH = 2.5
"""Reach of a fit to either side of a step, in standard deviations of the blur: that of three pixels where it is 1.2 px,
from which on it matters."""
SAMPLES = np.flatnonzero((np.abs(AT) <= REACH) & (np.arange(len(AT)) % (STEPS_PER_WIDTH // 2) == 0))
"""Places of a step's samples in its tables, half a standard deviation apart."""
HEIGHTS = STEP[SAMPLES].copy()
"""Height of a step of 1 at the samples."""
BESIDE_LEVEL = SLOPE[SAMPLES] - SLOPE[SAMPLES].mean()
SHIFTS = -BESIDE_LEVEL / np.square(BESIDE_LEVEL).sum()
"""What light at the samples adds to the shift of the step of height 1 that fits it best, in standard deviations of the
blur: least squares in its level, its height and its shift. About the step the height is odd, the others are even."""

Indices = NDArray[np.int64]


@compiled("i1 i1 i1 f1 f2 optics i0", inner=True, optics=OPTICS)
def displaced_by_codes(
    rows: Indices, first: Indices, steps: Indices, weight: Array, appearance: Array, optics: Optics, channels: int
) -> Array:
    """Mean displacements (g,) of edges along their normals, px, if all of the blur but a pixel's blurred codes.

    rows (n,) of appearance of the control points, those of edge k from first[k] on; steps (n,) of light that locate
    each, and its weight (n,) in a fit. Points that no step locates do not count.
    """
    displaced, colour = np.zeros(len(first) - 1), np.empty(COLOURS)
    blurred_px = max(0.0, optics.blur_px - PIXEL_PX)
    for g in range(len(displaced)):
        total, located, last, shift = 0.0, 0.0, -1, 0.0
        for p in range(first[g], first[g + 1]):
            if not (steps[p] > 0 and weight[p] > 0.0):
                continue
            if rows[p] != last:
                last, shift = rows[p], shift_of_step(appearance[rows[p]], channels, optics, colour)
            total, located = total + weight[p] * shift, located + weight[p]
        if located > 0.0:
            displaced[g] = blurred_px * total / located
    return displaced


@inlined(allocates=False)
def shift_of_step(row: Array, channels: int, optics: Optics, colour: Array) -> float:
    """Shift of an edge's step whose codes are blurred, in standard deviations of the blur; 0 if nothing is learned.

    colour (3,): room for the direction of `learned_light`.
    """
    height, shift = learned_light(row, channels, optics, colour), 0.0
    for k in range(len(HEIGHTS) if height > 0.0 else 0):
        for c in range(channels):
            low, high = row[NEGATIVE_COLOUR + c], row[POSITIVE_COLOUR + c]
            code = min(max(low + (high - low) * HEIGHTS[k], 0.0), 255.0)
            before = min(254, int(code))
            light, step = optics.light[0, before], optics.light[0, before + 1] - optics.light[0, before]
            shift += SHIFTS[k] * colour[c] * (light + (code - before) * step) / height
    return shift
