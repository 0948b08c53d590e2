"""Kernels of geometric antialiasing (Persson 2011): pixels mixed by the places of outlines between them."""

from typing import Any

import numpy as np

from uavbench.scenes.rendering.antialiasing.border_kernels import FACET_TABLE, borders, ready
from uavbench.trajectories.kernels.compiled import compiled

BESIDE, ABOVE, BELOW = 0, 1, 2
"""Neighbours of a pixel: the next one in the row, and those in the rows above and below."""


@compiled("u3 s3 facets i1! u3!", facets=FACET_TABLE)
def antialias(color: Any, numbers: Any, facets: Any, seen: Any, out: Any) -> None:
    """Out (h, w, 3) BGR: the square root of the light of each pixel and its neighbours by the share that each covers.

    color (h, w, 4) RGBA is square-root coded and numbers (h, w, 2) are depth and facet + 1, from the bottom row on;
    seen (n + 1,) is scratch for n facets. A facet between two pixels has the colour of the last pixel that shows it.
    """
    h, w = out.shape[0], out.shape[1]
    facets.outlines[:, 3, 2] = np.nan
    seen[:] = -1
    for y in range(h):
        for u in range(1, w):
            if numbers[y, u, 1] != numbers[y, u - 1, 1]:
                seen[int(numbers[y, u, 1])] = y * w + u
    places, between = np.full((3, w, 2), 0.5), np.full((3, w), -1)
    mixed, light = np.zeros((2, w + 1), dtype=np.bool_), np.zeros(3)
    for v in range(h):
        y = h - 1 - v
        places[ABOVE], between[ABOVE] = places[BELOW], between[BELOW]
        places[BESIDE], places[BELOW] = 0.5, 0.5
        now, then = mixed[v % 2], mixed[1 - v % 2]
        then[:] = False
        for u in range(w):
            here = numbers[y, u, 1]
            right = numbers[y, u + 1, 1] if u + 1 < w else here
            down = numbers[y - 1, u, 1] if y else here
            if right == here and down == here:
                continue
            row = int(here) - 1
            seen[row + 1] = y * w + u
            ready(facets, row)
            now[u] = True
            if right != here:
                now[u + 1] = True
                other = int(right) - 1
                ready(facets, other)
                places[BESIDE, u, 0], places[BESIDE, u, 1], between[BESIDE, u] = borders(facets, row, other, u, v, 0)
            if down != here:
                then[u] = True
                other = int(down) - 1
                ready(facets, other)
                places[BELOW, u, 0], places[BELOW, u, 1], between[BELOW, u] = borders(facets, row, other, u, v, 1)
        for u in range(w):
            if not now[u]:
                for k in range(3):
                    out[v, u, k] = color[y, u, 2 - k]
                continue
            before, after, over, under = max(u - 1, 0), min(u + 1, w - 1), min(y + 1, h - 1), max(y - 1, 0)
            left, left_strip = _beyond(places[BESIDE, before, 0], places[BESIDE, before, 1]) if u else (0.0, 0.0)
            right, right_strip = _beyond(1.0 - places[BESIDE, u, 1], 1.0 - places[BESIDE, u, 0])
            top, top_strip = _beyond(places[ABOVE, u, 0], places[ABOVE, u, 1])
            bottom, bottom_strip = _beyond(1.0 - places[BELOW, u, 1], 1.0 - places[BELOW, u, 0])
            total = left + right + top + bottom + left_strip + right_strip + top_strip + bottom_strip
            if total == 0.0:
                for k in range(3):
                    out[v, u, k] = color[y, u, 2 - k]
                continue
            rest, scale = max(1.0 - total, 0.0), 1.0 / max(total, 1.0)
            light[:] = 0.0
            _add(color, y, u, rest, light)
            _add(color, y, before, scale * left, light)
            _add(color, y, after, scale * right, light)
            _add(color, over, u, scale * top, light)
            _add(color, under, u, scale * bottom, light)
            for row, share in (
                (between[BESIDE, before], left_strip),
                (between[BESIDE, u], right_strip),
                (between[ABOVE, u], top_strip),
                (between[BELOW, u], bottom_strip),
            ):
                if share > 0.0:
                    place = seen[row + 1] if seen[row + 1] >= 0 else y * w + u
                    _add(color, place // w, place % w, scale * share, light)
            for k in range(3):
                out[v, u, k] = np.uint8(np.sqrt(light[k]) + 0.5)


@compiled
def _beyond(begins: float, ends: float) -> tuple[float, float]:
    """Shares of the pixel at 1 on the near side of a strip between two places, and in the strip."""
    return max(begins - 0.5, 0.0), max(ends - 0.5, 0.0) - max(begins - 0.5, 0.0)


@compiled
def _add(color: Any, y: int, u: int, share: float, light: Any) -> None:
    """Add a share of the light of a pixel to light (3,) BGR, in squared codes."""
    if share > 0.0:
        for k in range(3):
            value = float(color[y, u, 2 - k])
            light[k] += share * value * value


@compiled("s3 u1 s2! u2!")
def depth_and_instances(numbers: Any, instance: Any, depth: Any, instances: Any) -> None:
    """Depth and instances (h, w) from the top row on, of numbers (h, w, 2) as in `antialias`.

    instance (n + 1,) is that of each facet, after that of the background.
    """
    h, w = depth.shape
    for v in range(h):
        for u in range(w):
            depth[v, u] = numbers[h - 1 - v, u, 0]
            instances[v, u] = instance[int(numbers[h - 1 - v, u, 1])]
