"""Compiled pose search: how well do the edges seen from a pose lie on the edge pixels of a small image."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.tracker.geometry_kernels import RigidMotion, camera_centre, se3_exp_left
from uavbench.tracker.order_kernels import falling
from uavbench.tracker.robust.config.relocalization import PoseSearchConfig
from uavbench.tracker.robust.kernel_values import kernel_type
from uavbench.trajectories.kernels.argument_types import named_tuple
from uavbench.trajectories.kernels.compiled import compiled
from uavbench.trajectories.pose import Array

ORIENTATIONS = 8
"""Edge pixels are kept apart by their direction, in so many bins of half a turn."""
DIAGONAL = 2.4
"""Ratio of a gradient's components above which it lies along an axis of the pixels: tan(67.5 degrees)."""
SEARCH = kernel_type(PoseSearchConfig)

Indices = NDArray[np.int64]


class EdgePoints(NamedTuple):
    """Points (n, 3) on the model's edges, unit direction (n, 3) of each edge, the faces (n, 2) beside it (-1: none),
    and the planes (f, 4) of all faces: outward normal n and offset d, n . p = d on the face.
    """

    points: Array
    direction: Array
    faces: Indices
    planes: Array


class SmallCamera(NamedTuple):
    """Pinhole camera of the small image: f (4,) fx fy cx cy in its px, size_px (2,), near the least depth."""

    f: Array
    size_px: Array
    near: float


class ImagePoints(NamedTuple):
    """Pixels (n, 2) and orientation bins (n,) of edge points; the first `filled` are set."""

    pixels: Array
    bins: Indices
    filled: int


class PoseScores(NamedTuple):
    """Best score (h,) of each pose over all shifts, -1 where it was not scored, and the row (h,) of that shift."""

    scores: Array
    shifts: Indices


class NearGuess(NamedTuple):
    """A guess R (3, 3), t (3,), the points (n, 3) that it sees with their edges' direction (n, 3), and their mean,
    focus (3,), in the camera.
    """

    R: Array
    t: Array
    points: Array
    direction: Array
    focus: Array


class NearChanges(NamedTuple):
    """Changes (k, 6) of a guess as `turned_about` takes them, and their scores (k,)."""

    changes: Array
    scores: Array


EDGE_POINTS = named_tuple(EdgePoints, "f2! f2! i2! f2!")
SMALL_CAMERA = named_tuple(SmallCamera, "f1! f1! f0")
NEAR_GUESS = named_tuple(NearGuess, "f2! f1! f2! f2! f1!")


@compiled("u3 f0")
def edge_channels(image: NDArray[np.uint8], least: float) -> NDArray[np.uint8]:
    """Maxima of the colour gradient by direction (ORIENTATIONS, h, w): 0 on an edge pixel, 1 elsewhere.

    An edge pixel enters its own bin and the neighbour that it is nearer to.
    """
    h, w = image.shape[0], image.shape[1]
    out = np.ones((ORIENTATIONS, h, w), np.uint8)
    gx, gy, power = np.zeros((h, w)), np.zeros((h, w)), np.zeros((h, w))
    for i in range(1, h - 1):
        for j in range(1, w - 1):
            for c in range(image.shape[2]):
                x = float(image[i, j + 1, c]) - float(image[i, j - 1, c])
                y = float(image[i + 1, j, c]) - float(image[i - 1, j, c])
                p = x * x + y * y
                if p > power[i, j]:
                    power[i, j], gx[i, j], gy[i, j] = p, x, y
    for i in range(1, h - 1):
        for j in range(1, w - 1):
            p = power[i, j]
            if p < least * least:
                continue
            if abs(gx[i, j]) > DIAGONAL * abs(gy[i, j]):
                di, dj = 0, 1
            elif abs(gy[i, j]) > DIAGONAL * abs(gx[i, j]):
                di, dj = 1, 0
            elif gx[i, j] * gy[i, j] > 0:
                di, dj = 1, 1
            else:
                di, dj = 1, -1
            if p < power[i + di, j + dj] or p <= power[i - di, j - dj]:
                continue
            turn = math.atan2(gy[i, j], gx[i, j]) / math.pi * ORIENTATIONS
            bin_ = math.floor(turn) % ORIENTATIONS
            out[bin_, i, j] = 0
            near = bin_ + (1 if turn - math.floor(turn) > 0.5 else -1)
            out[near % ORIENTATIONS, i, j] = 0
    return out


@compiled("points f2 f1 camera", inner=True, points=EDGE_POINTS, camera=SMALL_CAMERA)
def seen_points(edges: EdgePoints, R: Array, t: Array, camera: SmallCamera) -> ImagePoints:
    """The edge points that a pose shows in the small image.

    A point shows when a face beside its edge is turned to the camera. Points outside the image are kept within a third
    of its width, so that a shift may bring them in.
    """
    points, direction, faces, planes = edges.points, edges.direction, edges.faces, edges.planes
    f, size = camera.f, camera.size_px
    eye = camera_centre(R, t)
    pixel, bins = np.empty((len(points), 2)), np.empty(len(points), np.int64)
    n = 0
    c, d = np.empty(3), np.empty(3)
    for k in range(len(points)):
        shows = False
        for s in range(2):
            q = faces[k, s]
            if q >= 0 and planes[q, 0] * eye[0] + planes[q, 1] * eye[1] + planes[q, 2] * eye[2] > planes[q, 3]:
                shows = True
        if not shows:
            continue
        for i in range(3):
            c[i] = R[i, 0] * points[k, 0] + R[i, 1] * points[k, 1] + R[i, 2] * points[k, 2] + t[i]
            d[i] = R[i, 0] * direction[k, 0] + R[i, 1] * direction[k, 1] + R[i, 2] * direction[k, 2]
        if c[2] <= camera.near:
            continue
        u, v = f[0] * c[0] / c[2] + f[2], f[1] * c[1] / c[2] + f[3]
        reach = size[0] / 3
        if not (-reach < u < size[0] + reach and -reach < v < size[1] + reach):
            continue
        du, dv = f[0] * (d[0] - c[0] / c[2] * d[2]), f[1] * (d[1] - c[1] / c[2] * d[2])
        turn = math.atan2(du, -dv) / math.pi * ORIENTATIONS  # of the normal
        pixel[n, 0], pixel[n, 1] = u, v
        bins[n] = math.floor(turn) % ORIENTATIONS
        n += 1
    return ImagePoints(pixel, bins, n)


@compiled("points f3 f2 camera s3 f2 search", points=EDGE_POINTS, camera=SMALL_CAMERA, search=SEARCH)
def score_poses(
    edges: EdgePoints,
    rotations: Array,
    translations: Array,
    camera: SmallCamera,
    distance: NDArray[np.float32],
    shifts: Array,
    config: PoseSearchConfig,
) -> PoseScores:
    """Scores of poses (h, 3, 3) and (h, 3), with the best of shifts (s, 2) in px of the small image.

    The score is the mean over the edge points of 1 - distance, with distance (ORIENTATIONS, h, w) to the nearest edge
    pixel of that direction, cut at 1; a point out of the image counts `outside_score`. Poses worse by
    `hopeless_score` than the best so far may score less than they would.
    """
    h, w = distance.shape[1], distance.shape[2]
    top = 0.0
    scores = np.full(len(rotations), -1.0)
    best = np.zeros(len(rotations), np.int64)
    for k in range(len(rotations)):
        seen = seen_points(edges, rotations[k], translations[k], camera)
        pixel, bins, n = seen.pixels, seen.bins, seen.filled
        if n < config.min_points:
            continue
        for s in range(len(shifts)):
            total = 0.0
            needed = max(scores[k], top - config.hopeless_score) * n
            for p in range(n):
                j, i = int(pixel[p, 0] + shifts[s, 0] + 0.5), int(pixel[p, 1] + shifts[s, 1] + 0.5)
                total += 1.0 - distance[bins[p], i, j] if 0 <= i < h and 0 <= j < w else config.outside_score
                if total + (n - 1 - p) < needed:
                    break
            if total > scores[k] * n:
                scores[k] = total / n
                best[k] = s
                top = max(top, scores[k])
    return PoseScores(scores, best)


@compiled("f2 f1 f1 f1")
def turned_about(R: Array, t: Array, focus: Array, a: Array) -> RigidMotion:
    """Pose (R, t) changed by a (6,).

    The object turns by a[:3] about the focus (3,) in the camera, its range grows by the part a[3], and the image moves
    by the angles a[4] to the right and a[5] down.
    """
    still, shift = np.zeros(6), np.zeros(6)
    for i in range(3):
        still[3 + i] = a[i]
    shift[3], shift[4] = -a[5], a[4]
    turned = se3_exp_left(R, t - focus, still)
    for i in range(3):
        turned.t[i] += (1.0 + a[3]) * focus[i]
    return se3_exp_left(turned.R, turned.t, shift)


@compiled("guess f1 camera s3 f0", inner=True, guess=NEAR_GUESS, camera=SMALL_CAMERA)
def chamfer(
    guess: NearGuess, change: Array, camera: SmallCamera, distance: NDArray[np.float32], outside: float
) -> float:
    """Score of a guess with a change (6,): mean over its points of 1 - distance to the nearest edge pixel of their
    direction; `outside` out of view.
    """
    points, direction, f = guess.points, guess.direction, camera.f
    pose = turned_about(guess.R, guess.t, guess.focus, change)
    R, t = pose.R, pose.t
    h, w = distance.shape[1], distance.shape[2]
    total = 0.0
    for k in range(len(points)):
        x, y, z = t[0], t[1], t[2]
        dx, dy, dz = 0.0, 0.0, 0.0
        for i in range(3):
            x += R[0, i] * points[k, i]
            y += R[1, i] * points[k, i]
            z += R[2, i] * points[k, i]
            dx += R[0, i] * direction[k, i]
            dy += R[1, i] * direction[k, i]
            dz += R[2, i] * direction[k, i]
        value = outside
        if z > camera.near:
            a, b = x / z, y / z
            u, v = f[0] * a + f[2], f[1] * b + f[3]
            if -0.5 <= u < w - 0.5 and -0.5 <= v < h - 0.5:
                turn = math.atan2(f[0] * (dx - a * dz), -f[1] * (dy - b * dz)) / math.pi * ORIENTATIONS
                value = 1.0 - distance[math.floor(turn) % ORIENTATIONS, int(v + 0.5), int(u + 0.5)]
        total += value
    return total / max(1, len(points))


@compiled("guess camera s3 f2 f1 i0 search", guess=NEAR_GUESS, camera=SMALL_CAMERA, search=SEARCH)
def search_about(
    guess: NearGuess,
    camera: SmallCamera,
    distance: NDArray[np.float32],
    changes: Array,
    steps: Array,
    most: int,
    config: PoseSearchConfig,
) -> NearChanges:
    """At most `most` of the changes (m, 6) of a guess that score best, improved by a pattern search from `steps` (6,)
    down (Hooke & Jeeves 1961).
    """
    first = np.empty(len(changes))
    for k in range(len(changes)):
        first[k] = chamfer(guess, changes[k], camera, distance, config.outside_score)
    order = falling(first)
    out, scores = np.zeros((most, 6)), np.full(most, -1.0)
    n = 0
    for k in order:
        if n == most:
            break
        near = False
        for j in range(n):
            away = 0.0
            for i in range(6):
                away = max(away, abs(out[j, i] - changes[k, i]) / steps[i])
            near |= away < 1.0
        if near:
            continue
        a, best = changes[k].copy(), first[k]
        step = steps.copy()
        for _ in range(config.pattern_levels):
            for _ in range(config.pattern_sweeps):
                moved = False
                for i in range(6):
                    for sign in (-1.0, 1.0):
                        a[i] += sign * step[i]
                        value = chamfer(guess, a, camera, distance, config.outside_score)
                        if value > best:
                            best, moved = value, True
                            break
                        a[i] -= sign * step[i]
                if not moved:
                    break
            step *= 0.5
        scores[n] = best
        for i in range(6):
            out[n, i] = a[i]
        n += 1
    return NearChanges(out[:n].copy(), scores[:n].copy())
