"""Compiled kernels over pixels."""

from typing import Any

import numpy as np

from uavbench.trajectories.kernels.compiled import compiled


@compiled
def mix(x: np.uint64) -> np.uint64:
    """SplitMix64 finalizer (Steele, Lea & Flood 2014): a hash of a 64-bit counter."""
    x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return x ^ (x >> np.uint64(31))


HASHES_AT_ONCE = 256
"""Hashes that are computed before the quantiles are looked up; with their samples they stay in the fastest cache."""
AT_ONCE = 4 * HASHES_AT_ONCE
"""Values that are computed at once, in vectors; they stay in the fastest cache."""


@compiled("s1 f0 f0 w0 s1 s1!")
def add_noise(image: Any, gain: float, floor: float, key: np.uint64, normal: Any, out: Any) -> None:
    """Out = image + sqrt(gain * image + floor) * n, with n independent and standard normal.

    normal (65536,) holds the quantiles of the standard normal distribution; each 64-bit hash gives four samples.
    """
    words = np.empty(HASHES_AT_ONCE, dtype=np.uint64)
    for first in range(0, image.size, AT_ONCE):
        part, into = image[first : first + AT_ONCE], out[first : first + AT_ONCE]
        _look_up_normal(key, first // 4, words, normal, into)
        _disturb(part, gain, floor, into)


@compiled("u1 f0 f0 w0 s1 u1 u1!")
def code_noisy(roots: Any, gain: float, floor: float, key: np.uint64, normal: Any, table: Any, out: Any) -> None:
    """Out as by `square_codes`, `add_noise` and `code` one after the other; what is between stays in the cache."""
    words, places = np.empty(HASHES_AT_ONCE, dtype=np.uint64), np.empty(AT_ONCE, dtype=np.uint16)
    lights, noisy = np.empty(AT_ONCE, dtype=np.float32), np.empty(AT_ONCE, dtype=np.float32)
    for first in range(0, roots.size, AT_ONCE):
        part, into = roots[first : first + AT_ONCE], out[first : first + AT_ONCE]
        light, disturbed = lights[: part.size], noisy[: part.size]
        _square(part, light)
        _look_up_normal(key, first // 4, words, normal, disturbed)
        _disturb(light, gain, floor, disturbed)
        _code(disturbed, table, places, into)


@compiled
def _look_up_normal(key: np.uint64, first: int, words: Any, normal: Any, out: Any) -> None:
    """Samples (n,) of the normal distribution by hashes from a first one on, four of each."""
    for k in range(HASHES_AT_ONCE):
        words[k] = mix(key + np.uint64(first + k) * np.uint64(0x9E3779B97F4A7C15))
    places = words.view(np.uint16)
    for i in range(out.size):
        out[i] = normal[places[i]]


@compiled
def _disturb(light: Any, gain: float, floor: float, out: Any) -> None:
    """Out = light + sqrt(gain * light + floor) * out."""
    for i in range(light.size):
        deviation = np.float32(np.sqrt(np.float32(gain) * max(light[i], np.float32(0)) + np.float32(floor)))
        out[i] = light[i] + deviation * out[i]


@compiled("u1 s1!", allocates=False)
def square_codes(codes: Any, out: Any) -> None:
    """Linear radiance (n,) of the renderer's 8-bit codes (n,), its square roots."""
    _square(codes, out)


@compiled
def _square(codes: Any, out: Any) -> None:
    """The same, for kernels."""
    for i in range(codes.size):
        root = np.float32(codes[i]) / np.float32(255)
        out[i] = root * root


@compiled("s1 u1 u1!")
def code(image: Any, table: Any, out: Any) -> None:
    """8-bit codes of linear radiance by a lookup table over 0..1, of at most 65536 codes.

    Values outside are clipped, NaN counts as 0.
    """
    places = np.empty(AT_ONCE, dtype=np.uint16)
    for first in range(0, image.size, AT_ONCE):
        _code(image[first : first + AT_ONCE], table, places, out[first : first + AT_ONCE])


@compiled
def _code(light: Any, table: Any, places: Any, out: Any) -> None:
    """The same of at most AT_ONCE values, whose places in the table are computed before any is looked up."""
    top, zero = np.float32(table.size - 1), np.float32(0)
    for i in range(light.size):
        value = light[i] * top + np.float32(0.5)
        value = value if value > zero else zero
        places[i] = np.uint16(np.int32(value if value < top else top))
    for i in range(light.size):
        out[i] = table[places[i]]


@compiled("s2 i0 (f0 f0 f0 f0) f2 f2 s3!")
def displacement(depth: Any, step: int, intrinsics: Any, before: Any, after: Any, out: Any) -> None:
    """Optical flow in px between two poses, at every step-th pixel.

    depth (h, w) in metres of the view in the middle, 0: at infinity; intrinsics fx fy cx cy; before and after (3, 4)
    map points of the middle camera to the cameras at the two times; out (h', w', 2).
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


CELL_PX = 4
CELL_ERROR_PX = 0.02
"""Interpolation error at the centre of a cell, px, below which all of its pixels are interpolated."""


@compiled("s2 s2 s3 (f0 f0 f0 f0) f3 s3!")
def row_places(nearness: Any, nearest: Any, base: Any, intrinsics: Any, rows: Any, out: Any) -> None:
    """Sampling position (h', w', 2) in a view of each pixel of a rolling-shutter image, from the pose of its row.

    nearness (h, w) is the inverse depth of the view, 1/m; nearest its maximum around each pixel: a surface that covers
    the pixel occludes those behind. base (h', w', 2) is the position without motion; rows (h', 3, 4) map points of the
    view's camera to that of the row. Computed at the corners and centres of cells and interpolated where smooth,
    otherwise at every pixel.
    """
    h, w = base.shape[0], base.shape[1]
    for i in range(0, h, CELL_PX):
        for j in range(0, w, CELL_PX):
            out[i, j, 0], out[i, j, 1] = _row_place(nearness, nearest, intrinsics, rows[i], base[i, j])
    for top in range(0, h, CELL_PX):
        for left in range(0, w, CELL_PX):
            bottom, right = top + CELL_PX, left + CELL_PX
            mid_i, mid_j = top + CELL_PX // 2, left + CELL_PX // 2
            smooth = bottom < h and right < w
            if smooth:
                u, v = _row_place(nearness, nearest, intrinsics, rows[mid_i], base[mid_i, mid_j])
                for k, exact in enumerate((u, v)):
                    even = 0.0
                    for i in (top, bottom):
                        for j in (left, right):
                            even += 0.25 * (out[i, j, k] - base[i, j, k])
                    smooth &= abs(exact - base[mid_i, mid_j, k] - even) < CELL_ERROR_PX
            for i in range(top, min(bottom, h)):
                for j in range(left, min(right, w)):
                    if i == top and j == left:
                        continue
                    if smooth:
                        t, s = (i - top) / CELL_PX, (j - left) / CELL_PX
                        for k in range(2):
                            high = (1 - s) * (out[top, left, k] - base[top, left, k])
                            high += s * (out[top, right, k] - base[top, right, k])
                            low = (1 - s) * (out[bottom, left, k] - base[bottom, left, k])
                            low += s * (out[bottom, right, k] - base[bottom, right, k])
                            out[i, j, k] = base[i, j, k] + (1 - t) * high + t * low
                    else:
                        out[i, j, 0], out[i, j, 1] = _row_place(nearness, nearest, intrinsics, rows[i], base[i, j])


@compiled
def _row_place(nearness: Any, nearest: Any, intrinsics: Any, T: Any, base: Any) -> tuple[float, float]:
    """Sampling position (u, v) in the view of one pixel, by fixed-point iteration on its depth."""
    fx, fy, cx, cy = intrinsics
    h, w = nearness.shape
    u0, v0 = float(base[0]), float(base[1])
    ci, cj = min(max(int(v0 + 0.5), 0), h - 1), min(max(int(u0 + 0.5), 0), w - 1)
    near = nearest[ci, cj]
    begin = 0 if near > 1.02 * nearness[ci, cj] else 1
    u, v = u0, v0
    for nearer_first in range(begin, 2):
        u, v = u0, v0
        for _ in range(3):
            ci, cj = min(max(int(v + 0.5), 0), h - 1), min(max(int(u + 0.5), 0), w - 1)
            k = near if nearer_first == 0 else nearness[ci, cj]
            x, y = (u - cx) / fx, (v - cy) / fy
            z = T[2, 0] * x + T[2, 1] * y + T[2, 2] + T[2, 3] * k
            du = u0 - (fx * (T[0, 0] * x + T[0, 1] * y + T[0, 2] + T[0, 3] * k) / z + cx)
            dv = v0 - (fy * (T[1, 0] * x + T[1, 1] * y + T[1, 2] + T[1, 3] * k) / z + cy)
            u += du
            v += dv
            if du * du + dv * dv < 0.04:  # the remaining error is a few percent of this step
                break
        ci, cj = min(max(int(v + 0.5), 0), h - 1), min(max(int(u + 0.5), 0), w - 1)
        if nearer_first == 0 and abs(nearness[ci, cj] - near) < 0.02 * near:
            break
    return u, v


@compiled("s1 s2 s3!")
def tint(color: Any, shade: Any, out: Any) -> None:
    """Out (h, w, 3) = color (3,) * shade (h, w)."""
    for i in range(shade.shape[0]):
        for j in range(shade.shape[1]):
            for k in range(3):
                out[i, j, k] = color[k] * shade[i, j]


@compiled("s3~ s3~ s2~ s3!")
def lay(under: Any, over: Any, mask: Any, out: Any) -> None:
    """Out (h, w, 3) = under + (over - under) * mask (h, w)."""
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            share = mask[i, j]
            for k in range(3):
                out[i, j, k] = under[i, j, k] + (over[i, j, k] - under[i, j, k]) * share


@compiled("s3~ s1 s2~ s3!")
def lay_color(under: Any, color: Any, mask: Any, out: Any) -> None:
    """Out (h, w, 3) = under + (color (3,) - under) * mask (h, w)."""
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            share = mask[i, j]
            for k in range(3):
                out[i, j, k] = under[i, j, k] + (color[k] - under[i, j, k]) * share


@compiled("f1 u1! | s1 u1!")
def round_off(values: Any, out: Any) -> None:
    """Out = values rounded to 8 bits, clipped to 0..255."""
    for i in range(values.size):
        out[i] = np.uint8(min(max(values[i], 0.0), 255.0) + 0.5)


@compiled("f3 u2!")
def fill_triangles(corners: Any, out: Any) -> None:
    """Rasterize triangles (n, 3, 2) in px: set the pixels of out (h, w) whose centre is inside one or on its border."""
    h, w = out.shape
    for k in range(corners.shape[0]):
        ax, ay = corners[k, 0, 0], corners[k, 0, 1]
        bx, by = corners[k, 1, 0], corners[k, 1, 1]
        cx, cy = corners[k, 2, 0], corners[k, 2, 1]
        left, right = max(0.0, np.ceil(min(ax, bx, cx))), min(w - 1.0, np.floor(max(ax, bx, cx)))
        top, bottom = max(0.0, np.ceil(min(ay, by, cy))), min(h - 1.0, np.floor(max(ay, by, cy)))
        if not (left <= right and top <= bottom):
            continue
        for v in range(int(top), int(bottom) + 1):
            for u in range(int(left), int(right) + 1):
                first = (bx - ax) * (v - ay) - (by - ay) * (u - ax)
                second = (cx - bx) * (v - by) - (cy - by) * (u - bx)
                third = (ax - cx) * (v - cy) - (ay - cy) * (u - cx)
                if (first >= 0 and second >= 0 and third >= 0) or (first <= 0 and second <= 0 and third <= 0):
                    out[v, u] = 1
