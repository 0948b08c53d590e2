"""Compiled alignment of a pose to an image by the grey values that the surface of the structure had in another one.

Direct alignment (Lucas & Kanade 1981), with a gain and an offset of the light between the images (Bartoli 2008), of the
six unknowns of a pose: the model tells where in the image each point of the surface is.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.tracker.geometry_kernels import RigidMotion, camera_centre, solve6
from uavbench.tracker.robust.relocalization.scoring.pose_search_kernels import (
    FARTHEST_PX,
    RIGID_MOTION,
    SMALL_CAMERA,
    SmallCamera,
    focus_at,
    turned_about,
)
from uavbench.trajectories.kernels.argument_types import named_tuple
from uavbench.trajectories.kernels.compiled import compiled, inlined
from uavbench.trajectories.pose import Array

LEAST_POINTS = 16
"""Points of a surface in view that tell a pose: more than two for each unknown of it."""
FLAT_COSINE = 0.2
"""Cosine of the angle to the line of sight above which a face is looked at: at 78 degrees a pixel shows five of it."""
DAMPING = 1e-3
"""Information of no change by a step of the search, as a part of what a point tells."""
MOST_STEPS, LEAST_STEPS = 2.0, 0.02
"""Longest change of an iteration, in steps of the search, and the one below which a pose is aligned: 10 and 0.1 px."""
SCANNED_POINTS = 80
"""About as many points of a surface are looked up for each shift of the image."""
LEAST_VARIANCE = 1e-9
"""Variance of grey values that is more than round-off."""

Indices = NDArray[np.int64]


class Surface(NamedTuple):
    """Points (n, 3) of a structure's surface as one image showed them.

    normals (n, 3), unit, toward the camera; faces (n,) that they are on; grey (2, n), blurred much and little;
    focus (3,) the mean of the points; R, t the pose of the camera.
    """

    points: Array
    normals: Array
    faces: Indices
    grey: Array
    focus: Array
    R: Array
    t: Array


class AlignedPose(NamedTuple):
    """A pose, and the correlation there of the grey values of so many points in view, -1 of fewer than can tell.

    looked_up: points looked up in all iterations.
    """

    pose: RigidMotion
    correlation: float
    points: int
    looked_up: int


class ShiftedPoses(NamedTuple):
    """Correlation (k,) of the grey values at poses with their best shifts (k, 2), px, and the part (k,) of the surface
    that is in view there; looked_up: points looked up.
    """

    correlation: Array
    part: Array
    shifts: Indices
    looked_up: int


class Compared(NamedTuple):
    """Grey values of the points in view, `filled` of them: seen (n,) in the image, known (n,), and the change (n, 6) of
    those seen per unit of a change of the pose.
    """

    seen: Array
    known: Array
    slopes: Array
    filled: int


class Likeness(NamedTuple):
    """Means of the grey values seen and known, the gain between them, and their correlation."""

    seen_mean: float
    known_mean: float
    gain: float
    correlation: float


SURFACE = named_tuple(Surface, "f2! f2! i1! f2! f1! f2! f1!")
COMPARED = named_tuple(Compared, "f1! f1! f2! i0")
LIKENESS = named_tuple(Likeness, "f0 f0 f0 f0")


@inlined(allocates=False)
def is_looked_at(surface: Surface, p: int, pose: RigidMotion, eye: Array, camera: SmallCamera, at: Array) -> bool:
    """Whether a point is on a face that is looked at from a pose; writes its x, y, z there and its pixel, at (5,)."""
    R, f = pose.R, camera.f
    facing, square = 0.0, 0.0
    for i in range(3):
        at[i] = pose.t[i]
        for j in range(3):
            at[i] += R[i, j] * surface.points[p, j]
        toward = eye[i] - surface.points[p, i]
        facing += toward * surface.normals[p, i]
        square += toward * toward
    if at[2] <= camera.near or facing < FLAT_COSINE * math.sqrt(square):
        return False
    at[3], at[4] = f[0] * at[0] / at[2] + f[2], f[1] * at[1] / at[2] + f[3]
    is_near: bool = abs(at[3]) < FARTHEST_PX and abs(at[4]) < FARTHEST_PX
    return is_near


@inlined(allocates=False)
def between_pixels(image: Array, u: float, v: float) -> float:
    """Grey value at (u, v) of an image (h, w), bilinear."""
    i, j = int(v), int(u)
    a, b = u - j, v - i
    above = (1.0 - a) * image[i, j] + a * image[i, j + 1]
    below = (1.0 - a) * image[i + 1, j] + a * image[i + 1, j + 1]
    value: float = (1.0 - b) * above + b * below
    return value


@compiled("surface i0 pose f1 camera f2", inner=True, surface=SURFACE, pose=RIGID_MOTION, camera=SMALL_CAMERA)
def compared_at(
    surface: Surface, level: int, pose: RigidMotion, focus: Array, camera: SmallCamera, image: Array
) -> Compared:
    """What an image (h, w), nan where it is masked, shows of a surface at a pose; focus (3,) in the camera frame."""
    n, f, eye, at = len(surface.points), camera.f, camera_centre(pose.R, pose.t), np.empty(5)
    seen, known, slopes = np.empty(n), np.empty(n), np.empty((n, 6))
    right_end, lower_end, k = image.shape[1] - 2.0, image.shape[0] - 2.0, 0
    for p in range(n):
        if not is_looked_at(surface, p, pose, eye, camera, at):
            continue
        x, y, z, u, v = at[0], at[1], at[2], at[3], at[4]
        if not (1.0 <= u < right_end and 1.0 <= v < lower_end):
            continue
        right = 0.5 * (between_pixels(image, u + 1.0, v) - between_pixels(image, u - 1.0, v)) * f[0] / z
        down = 0.5 * (between_pixels(image, u, v + 1.0) - between_pixels(image, u, v - 1.0)) * f[1] / z
        if math.isnan(right) or math.isnan(down):
            continue
        along = -(right * x + down * y) / z
        a, b, c = x - focus[0], y - focus[1], z - focus[2]
        seen[k], known[k] = between_pixels(image, u, v), surface.grey[level, p]
        slopes[k, 0], slopes[k, 1], slopes[k, 2] = along * b - down * c, right * c - along * a, down * a - right * b
        slopes[k, 3] = right * focus[0] + down * focus[1] + along * focus[2]
        slopes[k, 4], slopes[k, 5] = right * z - along * x, down * z - along * y
        k += 1
    return Compared(seen, known, slopes, k)


@compiled("f1 f1 i0", inner=True, allocates=False)
def likeness(seen: Array, known: Array, n: int) -> Likeness:
    """How the first n grey values seen and known are related."""
    a, b, aa, bb, ab = 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(n):
        a += seen[k]
        b += known[k]
        aa += seen[k] * seen[k]
        bb += known[k] * known[k]
        ab += seen[k] * known[k]
    a, b = a / n, b / n
    variance, known_variance = max(aa / n - a * a, LEAST_VARIANCE), max(bb / n - b * b, LEAST_VARIANCE)
    correlation = (ab / n - a * b) / math.sqrt(variance * known_variance)
    return Likeness(a, b, math.sqrt(known_variance / variance), correlation)


@inlined(allocates=False)
def rest_of(found: Compared, alike: Likeness, k: int) -> float:
    """Difference of a grey value seen, in the light of those known, from the one known."""
    rest: float = alike.gain * (found.seen[k] - alike.seen_mean) - (found.known[k] - alike.known_mean)
    return rest


@compiled("found alike f1 f1!", inner=True, found=COMPARED, alike=LIKENESS)
def changed_by(found: Compared, alike: Likeness, steps: Array, change: Array) -> bool:
    """Write the change (6,) of a pose that brings the grey values seen to those known; False if it is next to none.

    Weights are Cauchy's, with the root mean square difference: other things may stand before the surface.
    """
    n, square, total = found.filled, 0.0, 0.0
    for k in range(n):
        square += rest_of(found, alike, k) ** 2
    square = max(square / n, LEAST_VARIANCE)
    mean, H, h = np.zeros(6), np.zeros((6, 6)), np.zeros(6)
    for k in range(n):
        weight = 1.0 / (1.0 + rest_of(found, alike, k) ** 2 / square)
        total += weight
        for i in range(6):
            mean[i] += weight * found.slopes[k, i]
    for k in range(n):
        rest = rest_of(found, alike, k)
        weight = alike.gain / (1.0 + rest * rest / square)
        for i in range(6):
            slope = found.slopes[k, i] - mean[i] / total
            h[i] -= weight * slope * rest
            for j in range(i + 1):
                H[i, j] += weight * slope * alike.gain * (found.slopes[k, j] - mean[j] / total)
    for i in range(6):
        H[i, i] += DAMPING * n * square / (steps[i] * steps[i])
    if not solve6(H, h, change):
        return False
    longest = 0.0
    for i in range(6):
        longest = max(longest, abs(change[i]) / steps[i])
    for i in range(6):
        change[i] *= min(1.0, MOST_STEPS / max(longest, LEAST_STEPS))
    return longest > LEAST_STEPS


@compiled("surface i0 pose i0 f1 camera f2", surface=SURFACE, pose=RIGID_MOTION, camera=SMALL_CAMERA)
def aligned_pose(
    surface: Surface,
    level: int,
    pose: RigidMotion,
    iterations: int,
    steps: Array,
    camera: SmallCamera,
    image: Array,
) -> AlignedPose:
    """The pose near another at which an image (h, w) looks most like a surface, by Gauss-Newton.

    level: 0 for an image that is blurred much, 1 for one that is blurred little; steps (6,): of the search, for changes
    as `turned_about` takes them.
    """
    here, change = RigidMotion(pose.R.copy(), pose.t.copy()), np.zeros(6)
    best, correlation, points, looked_up = here, -1.0, 0, 0
    for iteration in range(iterations + 1):
        focus = focus_at(surface.focus, here.R, here.t)
        found = compared_at(surface, level, here, focus, camera, image)
        looked_up += len(surface.points)
        if found.filled < LEAST_POINTS:
            break
        alike = likeness(found.seen, found.known, found.filled)
        if alike.correlation > correlation:
            best, correlation, points = here, alike.correlation, found.filled
        if iteration == iterations or not changed_by(found, alike, steps, change):
            break
        here = turned_about(here.R, here.t, focus, change)
    return AlignedPose(best, correlation, points, looked_up)


@compiled("surface f3 f2 i2 camera f2", surface=SURFACE, camera=SMALL_CAMERA)
def best_shifts(
    surface: Surface, R: Array, t: Array, shifts: Indices, camera: SmallCamera, image: Array
) -> ShiftedPoses:
    """How alike an image (h, w) that is blurred much looks from poses R (k, 3, 3), t (k, 3), each with the best
    of shifts (s, 2) of the image, px.
    """
    n, at, looked_up = len(surface.points), np.empty(5), 0
    every = max(1, n // SCANNED_POINTS)
    correlation, part, best = np.full(len(R), -1.0), np.zeros(len(R)), np.zeros((len(R), 2), np.int64)
    rows, columns, of = np.empty(n, np.int64), np.empty(n, np.int64), np.empty(n)
    seen, known = np.empty(n), np.empty(n)
    for k in range(len(R)):
        pose, m = RigidMotion(R[k], t[k]), 0
        eye = camera_centre(pose.R, pose.t)
        for p in range(0, n, every):
            if is_looked_at(surface, p, pose, eye, camera, at):
                rows[m], columns[m], of[m] = math.floor(at[4] + 0.5), math.floor(at[3] + 0.5), surface.grey[0, p]
                m += 1
        looked_up += m * len(shifts)
        for s in range(len(shifts)):
            inside = 0
            for p in range(m):
                i, j = rows[p] + shifts[s, 1], columns[p] + shifts[s, 0]
                if 0 <= i < image.shape[0] and 0 <= j < image.shape[1] and not math.isnan(image[i, j]):
                    seen[inside], known[inside] = image[i, j], of[p]
                    inside += 1
            if inside < LEAST_POINTS:
                continue
            alike, share = likeness(seen, known, inside).correlation, inside * every / n
            if alike > 0.0 and share * alike * alike > part[k] * correlation[k] ** 2:
                correlation[k], part[k], best[k, 0], best[k, 1] = alike, share, shifts[s, 0], shifts[s, 1]
    return ShiftedPoses(correlation, part, best, looked_up)
