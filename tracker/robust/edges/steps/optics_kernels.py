"""How light becomes codes through a blurred lens, and the light that is learned of an edge's two sides."""

import math
from typing import NamedTuple

import numpy as np

from uavbench.tracker.robust.edges.columns import (
    NEGATIVE_COLOUR,
    NORMAL_U,
    NORMAL_V,
    POSITIVE_COLOUR,
    TIMES_SEEN,
    U,
    V,
)
from uavbench.tracker.robust.edges.profile_kernels import Image
from uavbench.trajectories.kernels.argument_types import named_tuple
from uavbench.trajectories.kernels.compiled import inlined
from uavbench.trajectories.pose import Array

PIXEL_PX = 1 / math.sqrt(12)
"""Standard deviation of the area of a pixel, in any direction: the least blur."""
FIRST_BLUR_PX = 0.5
"""Blur of a frame before any was measured: that of a pixel, and 0.4 px of a sharp lens."""
BLOWN_OUT = 250
"""Least code of light that may be more than a pixel holds: 255, less what noise and compression take away."""
NEARLY_BLOWN_OUT = 247
"""Least code of a channel that is blown out where another one of its side is: video codes white as 250, 253, 251."""
LEAST_PART = 0.25
"""Least part of the square of a step in the channels that are not blown out, which are then enough: half of its height.
Not tuned."""
COLOURS = 3
"""Channels of an image that is not grey."""
WEIGHT, OUTWARDS, ALONG_U, ALONG_V = 0, 1, 2, 3
"""Columns of what is known of a channel: weight of its light; by how much its image is displaced, px: outwards from the
middle, half of the diagonal away from there, and along u and v everywhere."""
ALIGNED = np.array([[1.0, 0.0, 0.0, 0.0]] * COLOURS)
"""Channels of the same weight that lie upon each other."""


class Optics(NamedTuple):
    """How light becomes codes: light (1 + r, 256) of each code, then its derivatives for r numbers of the response, the
    standard deviation blur_px of the blur, and colours (3, 4), what is known of the channels.
    """

    light: Array
    blur_px: float
    colours: Array


OPTICS = named_tuple(Optics, "f2! f0 f2!")


@inlined
def without_derivatives(optics: Optics) -> Optics:
    """The optics with the light alone."""
    return Optics(optics.light[:1], optics.blur_px, optics.colours)


@inlined(allocates=False)
def highest_code(row: Array, channel: int) -> float:
    """Code of the brighter side of an edge in a channel."""
    return float(max(row[POSITIVE_COLOUR + channel], row[NEGATIVE_COLOUR + channel]))


@inlined(allocates=False)
def light_step(row: Array, channel: int, light: Array) -> float:
    """Step of light from the negative to the positive side of an edge in a channel."""
    high, low = row[POSITIVE_COLOUR + channel], row[NEGATIVE_COLOUR + channel]
    return float(light[0, min(255, int(high + 0.5))] - light[0, min(255, int(low + 0.5))])


@inlined(allocates=False)
def least_blown(row: Array, channels: int) -> float:
    """Least code of a channel of an edge's sides that is blown out."""
    highest = 0.0
    for c in range(channels):
        highest = max(highest, highest_code(row, c))
    return float(NEARLY_BLOWN_OUT if highest >= BLOWN_OUT else BLOWN_OUT)


@inlined(allocates=False)
def learned_light(row: Array, channels: int, optics: Optics, colour: Array) -> float:
    """Learned intensity step of an edge, 0 if nothing is learned, along a direction in colour space: `colour`.

    The direction is that of the step, each channel by its weight. Channels of which a side is blown out are left out if
    the others tell enough.
    """
    colour[:] = 0.0
    if not row[TIMES_SEEN] > 0.0:
        return 0.0
    square, seen, least = 0.0, 0.0, least_blown(row, channels)
    for c in range(channels):
        colour[c] = light_step(row, c, optics.light)
        square += colour[c] * colour[c]
        seen += colour[c] * colour[c] if highest_code(row, c) < least else 0.0
    if LEAST_PART * square <= seen < square:
        for c in range(channels):
            if highest_code(row, c) >= least:
                colour[c] = 0.0
    step, weighted = 0.0, 0.0
    for c in range(channels):
        along = colour[c] * optics.colours[c, WEIGHT]
        step, weighted = step + along * colour[c], weighted + along * along
        colour[c] = along
    if not weighted > 0.0:
        return 0.0
    for c in range(channels):
        colour[c] /= math.sqrt(weighted)
    return step / math.sqrt(weighted)


@inlined(allocates=False)
def outwards(image: Image, line: Array) -> float:
    """Displacement of a step on a search line (4,), px, of an image that is enlarged by 1 px half of its diagonal away
    from its middle.
    """
    h, w = image.shape[0], image.shape[1]
    away = (line[U] - 0.5 * (w - 1)) * line[NORMAL_U] + (line[V] - 0.5 * (h - 1)) * line[NORMAL_V]
    return float(2.0 * away / math.hypot(w, h))


@inlined(allocates=False)
def displaced_px(row: Array, image: Image, line: Array, optics: Optics, colour: Array) -> float:
    """Displacement of an edge's step on its search line (4,), px, along the direction `colour` of `learned_light`."""
    total, moved, of_image = 0.0, 0.0, outwards(image, line)
    for c in range(image.shape[2] if image.shape[2] == COLOURS else 0):
        share = colour[c] * light_step(row, c, optics.light)
        total, moved = total + share, moved + share * channel_px(c, of_image, line, optics)
    return moved / total if total > 0.0 else 0.0


@inlined(allocates=False)
def channel_px(channel: int, of_image: float, line: Array, optics: Optics) -> float:
    """Displacement of a step on its search line (4,), px, in a channel; of_image: that of `outwards`."""
    known = optics.colours[channel]
    return float(of_image * known[OUTWARDS] + line[NORMAL_U] * known[ALONG_U] + line[NORMAL_V] * known[ALONG_V])


@inlined(allocates=False)
def blown_side(row: Array, channels: int, light: Array) -> float:
    """Side of an edge that is blown out in the channels that tell most of its step: 1 the positive one, -1 the other.

    0 where none is, or nothing is learned.
    """
    if not row[TIMES_SEEN] > 0.0:
        return 0.0
    square, seen, brighter, least = 0.0, 0.0, 0.0, least_blown(row, channels)
    for c in range(channels):
        step = light_step(row, c, light)
        square, brighter = square + step * step, brighter + step
        seen += step * step if highest_code(row, c) < least else 0.0
    return 0.0 if seen >= LEAST_PART * square else math.copysign(1.0, brighter)
