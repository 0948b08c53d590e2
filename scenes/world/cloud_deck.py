"""Clouds with flat bases and heaped tops on a shell about the Earth, as seen in a panorama of the sky."""

from dataclasses import dataclass

import cv2
import numpy as np

from uavbench.scenes.materials import procedural_texture as noise
from uavbench.scenes.materials.procedural_texture import Image
from uavbench.trajectories.pose import Array

EARTH = 6371.0 / 1.2
"""Radius of the Earth, 6371 km, over the height of the bases of clouds, 1.2 km by eye: low clouds are below 2 km (WMO
International Cloud Atlas 2017)."""
PX_PER_HEIGHT, ZENITH_PX = 130.0, 4000
"""Pixels of the tile of clouds for each height of their bases above the ground, and the one at the zenith in either
direction: those of plain clouds, so that the same ones are overhead."""
LAYERS, THICK, HEAP = 6, 0.22, 0.85
"""Slices of a cloud, the height of its top above its base over that of the base, and by how much its edge is higher
there, in standard deviations of the field: by eye."""
SOFT = 0.7
"""Width of the edge of clouds, in standard deviations of the field, by eye."""
BLUR_PX, DARK = 4.0, 1.9
"""Blur of the depth of clouds, px of the tile, and the depth from which bases are darkest, in standard deviations:
by eye."""
DENSEST_EDGE = np.float32(-1.4)
"""Edge of clouds below which they become no darker, as where they leave no gap, in standard deviations of the field."""
HAZE_DISTANCE = 14.0
"""Distance over the height of the bases at which clouds have lost 1 - 1/e of their contrast, by eye: 17 km."""
FINE_ROWS = 4
"""Rows that are computed for each row of the panorama below LOW_RAD, and averaged: distant clouds are foreshortened."""
LOW_RAD = 0.22
"""Elevation below which rows are averaged, rad."""


@dataclass(frozen=True, eq=False)
class Clouds:
    """Opacity (h, w) of clouds in a panorama, and how much of the light of lit tops they lack, 0..1."""

    opacity: Image
    shade: Image


def clouds(field: Image, edge: float, elevation: Array, azimuth: Array) -> Clouds:
    """Clouds where a tileable field (n, n) exceeds an edge, at elevations (h,) and azimuths (w,), rad.

    Each slice of them is seen at its own height, so that they have sides; the base is the nearest.
    """
    low = elevation < LOW_RAD
    step = float(elevation[0] - elevation[1])
    opacity = np.empty((len(elevation), len(azimuth)), dtype=np.float32)
    shade = np.empty_like(opacity)
    for rows, fine in ((~low, 1), (low, FINE_ROWS)):
        offsets = ((np.arange(fine) + 0.5) / fine - 0.5) * step
        seen = _seen(field, edge, (elevation[rows][:, None] - offsets).reshape(-1), azimuth)
        size = (int(rows.sum()), fine, len(azimuth))
        opacity[rows], shade[rows] = (each.reshape(size).mean(axis=1) for each in (seen.opacity, seen.shade))
    return Clouds(opacity, shade)


def _seen(field: Image, edge: float, elevation: Array, azimuth: Array) -> Clouds:
    """Clouds at single elevations, composited from their tops down to their bases."""
    opacity = np.zeros((len(elevation), len(azimuth)), dtype=np.float32)
    lit = np.zeros_like(opacity)
    up = np.maximum(np.sin(elevation), 0.0)
    for k in range(LAYERS - 1, -1, -1):
        share = k / (LAYERS - 1)
        height = 1 + THICK * share
        shell = np.sqrt((EARTH * up) ** 2 + 2 * EARTH * height + height**2) - EARTH * up  # distance to it
        slice_of = _slice(field, edge + HEAP * share)
        here = _sampled(slice_of, shell * np.cos(elevation), azimuth)
        here *= (np.exp(-shell / HAZE_DISTANCE) * (up > 0)).astype(np.float32)[:, None]
        lit = lit * (1 - here) + here * np.float32(share)
        opacity = opacity + here * (1 - opacity)
    beneath = 1 - lit / np.maximum(opacity, np.float32(1e-6))
    flat = np.sqrt((EARTH * up) ** 2 + 2 * EARTH + 1) - EARTH * up
    depth = np.clip((noise.blurred_tile(field, BLUR_PX) - max(np.float32(edge), DENSEST_EDGE)) / np.float32(DARK), 0, 1)
    shade = np.asarray(beneath * _sampled(depth, flat * np.cos(elevation), azimuth), dtype=np.float32)
    return Clouds(opacity, shade)


def _slice(field: Image, edge: float) -> Image:
    cover = np.clip((field - np.float32(edge)) / np.float32(SOFT), 0, 1)
    return np.asarray(cover * cover * (3 - 2 * cover), dtype=np.float32)


def _sampled(tile: Image, distance: Array, azimuth: Array) -> Image:
    """A tile (n, n) that repeats in the plane, at distances (h,) over the height of the bases and azimuths (w,).

    The farther away, the coarser a level of the tile's pyramid.
    """
    out = np.zeros((len(distance), len(azimuth)), dtype=np.float32)
    wide = distance * PX_PER_HEIGHT * float(azimuth[1] - azimuth[0])
    level = np.clip(np.log2(np.maximum(wide, 1.0)), 0, np.log2(len(tile)) - 3)
    cosine, sine = (way(azimuth).astype(np.float32) for way in (np.cos, np.sin))
    smaller: Image = tile
    for k in range(int(level.max(initial=0)) + 2):
        weight = np.clip(1 - np.abs(level - k), 0, 1)
        rows = np.flatnonzero(weight > 0)
        if len(rows):
            far = (distance[rows] * PX_PER_HEIGHT / 2**k).astype(np.float32)[:, None]
            zenith = np.float32((ZENITH_PX % len(tile) + 0.5) / 2**k - 0.5)
            u, v = far * cosine + zenith, far * sine + zenith
            out[rows] += weight[rows, None].astype(np.float32) * cv2.remap(
                smaller, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP
            )
        smaller = np.asarray(cv2.resize(smaller, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA), dtype=np.float32)
    return out
