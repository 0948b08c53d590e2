"""Compiled loops over pixels."""

from typing import Any

import numpy as np

from trajectories.kernels import compiled


@compiled
def mix(x: np.uint64) -> np.uint64:
    """SplitMix64 finalizer (Steele, Lea & Flood 2014): one well-mixed word of a counter."""
    x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return x ^ (x >> np.uint64(31))


@compiled
def add_noise(image: Any, gain: float, floor: float, key: np.uint64, normal: Any, out: Any) -> None:
    """Out = image + sqrt(gain * image + floor) * n, with n standard normal and independent.

    normal (65536,) holds the quantiles of the normal distribution; a 64-bit word gives four numbers.
    """
    size = image.size
    for block in range((size + 3) // 4):
        word = mix(key + np.uint64(block) * np.uint64(0x9E3779B97F4A7C15))
        for k in range(4):
            i = 4 * block + k
            if i < size:
                value = image[i]
                deviation = np.float32(np.sqrt(np.float32(gain) * max(value, np.float32(0)) + np.float32(floor)))
                out[i] = value + deviation * normal[word & np.uint64(0xFFFF)]
                word >>= np.uint64(16)


@compiled
def code(image: Any, table: Any, out: Any) -> None:
    """8-bit codes of linear light by a table over 0..1; light outside is clipped."""
    top = np.float32(table.size - 1)
    for i in range(image.size):
        value = image[i] * top + np.float32(0.5)
        out[i] = table[int(min(max(value, np.float32(0)), top))]


@compiled
def displacement(depth: Any, step: int, intrinsics: Any, before: Any, after: Any, out: Any) -> None:
    """Motion in px between two poses of what every step-th pixel shows.

    depth (h, w) of the view in the middle, 0: infinitely far; intrinsics fx fy cx cy; before and after
    (3, 4) take points of the middle camera to the cameras at the two times; out (h', w', 2).
    """
    fx, fy, cx, cy = intrinsics
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            u, v = min(j * step, depth.shape[1] - 1), min(i * step, depth.shape[0] - 1)
            d = depth[v, u]
            x, y = (u - cx) / fx, (v - cy) / fy
            w = 1.0 / d if d > 0 else 0.0
            ax = before[0, 0] * x + before[0, 1] * y + before[0, 2] + before[0, 3] * w
            ay = before[1, 0] * x + before[1, 1] * y + before[1, 2] + before[1, 3] * w
            az = before[2, 0] * x + before[2, 1] * y + before[2, 2] + before[2, 3] * w
            bx = after[0, 0] * x + after[0, 1] * y + after[0, 2] + after[0, 3] * w
            by = after[1, 0] * x + after[1, 1] * y + after[1, 2] + after[1, 3] * w
            bz = after[2, 0] * x + after[2, 1] * y + after[2, 2] + after[2, 3] * w
            if az > 1e-6 and bz > 1e-6:
                out[i, j, 0] = fx * (bx / bz - ax / az)
                out[i, j, 1] = fy * (by / bz - ay / az)
            else:
                out[i, j, 0] = 0.0
                out[i, j, 1] = 0.0


@compiled
def row_places(nearness: Any, nearest: Any, base: Any, intrinsics: Any, rows: Any, out: Any) -> None:
    """Where in a view (nearness (h, w): 1 / depth) lies what each pixel sees from the pose of its own row.

    base (h', w', 2) is the pixel's place without motion; rows (h', 3, 4) take points of the view's camera to the row's;
    nearest is the greatest nearness around each pixel: if that surface covers the pixel, it hides the others.
    """
    fx, fy, cx, cy = intrinsics
    h, w = nearness.shape
    for i in range(base.shape[0]):
        T = rows[i]
        for j in range(base.shape[1]):
            u0, v0 = float(base[i, j, 0]), float(base[i, j, 1])
            ci, cj = min(max(int(v0 + 0.5), 0), h - 1), min(max(int(u0 + 0.5), 0), w - 1)
            near = nearest[ci, cj]
            done = False
            u, v = u0, v0
            if near > 1.02 * nearness[ci, cj]:
                for _ in range(3):
                    x, y = (u - cx) / fx, (v - cy) / fy
                    z = T[2, 0] * x + T[2, 1] * y + T[2, 2] + T[2, 3] * near
                    du = u0 - (fx * (T[0, 0] * x + T[0, 1] * y + T[0, 2] + T[0, 3] * near) / z + cx)
                    dv = v0 - (fy * (T[1, 0] * x + T[1, 1] * y + T[1, 2] + T[1, 3] * near) / z + cy)
                    u += du
                    v += dv
                    if du * du + dv * dv < 0.04:  # what is left is some percent of this step
                        break
                ci, cj = min(max(int(v + 0.5), 0), h - 1), min(max(int(u + 0.5), 0), w - 1)
                done = abs(nearness[ci, cj] - near) < 0.02 * near
                if not done:
                    u, v = u0, v0
            if not done:
                for _ in range(3):
                    ci, cj = min(max(int(v + 0.5), 0), h - 1), min(max(int(u + 0.5), 0), w - 1)
                    k = nearness[ci, cj]
                    x, y = (u - cx) / fx, (v - cy) / fy
                    z = T[2, 0] * x + T[2, 1] * y + T[2, 2] + T[2, 3] * k
                    du = u0 - (fx * (T[0, 0] * x + T[0, 1] * y + T[0, 2] + T[0, 3] * k) / z + cx)
                    dv = v0 - (fy * (T[1, 0] * x + T[1, 1] * y + T[1, 2] + T[1, 3] * k) / z + cy)
                    u += du
                    v += dv
                    if du * du + dv * dv < 0.04:  # what is left is some percent of this step
                        break
            out[i, j, 0] = u
            out[i, j, 1] = v


@compiled
def tint(color: Any, shade: Any, out: Any) -> None:
    """Out (h, w, 3) = color (3,) * shade (h, w)."""
    for i in range(shade.shape[0]):
        for j in range(shade.shape[1]):
            for k in range(3):
                out[i, j, k] = color[k] * shade[i, j]


@compiled
def lay(under: Any, over: Any, mask: Any, out: Any) -> None:
    """Out (h, w, 3) = under + (over - under) * mask (h, w)."""
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            share = mask[i, j]
            for k in range(3):
                out[i, j, k] = under[i, j, k] + (over[i, j, k] - under[i, j, k]) * share


@compiled
def lay_color(under: Any, color: Any, mask: Any, out: Any) -> None:
    """Out (h, w, 3) = under + (color (3,) - under) * mask (h, w)."""
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            share = mask[i, j]
            for k in range(3):
                out[i, j, k] = under[i, j, k] + (color[k] - under[i, j, k]) * share


@compiled
def round_off(values: Any, out: Any) -> None:
    """Values rounded to 8 bits, clipped to 0..255."""
    for i in range(values.size):
        out[i] = np.uint8(min(max(values[i], 0.0), 255.0) + 0.5)
