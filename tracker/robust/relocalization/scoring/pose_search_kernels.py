"""Compiled pose search: agreement of the edges visible at a pose with the edge pixels of a small image."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.tracker.geometry_kernels import RigidMotion, se3_exp_left
from uavbench.tracker.robust.relocalization.scoring.edge_pixel_kernels import ORIENTATIONS
from uavbench.trajectories.kernels.argument_types import named_tuple
from uavbench.trajectories.kernels.compiled import compiled
from uavbench.trajectories.pose import Array

FAR = 255
"""Distance value of a missed edge point; distances are stored as integer fractions of it, so that sums are exact."""
MIN_POINTS = 12
"""Least number of points in view for a search: two for each unknown of a pose."""
PATTERN_LEVELS, PATTERN_SWEEPS = 3, 2
"""Number of step halvings of a pattern search, and most sweeps with each step."""
PROJECTION_EVALUATIONS = 10
"""Cost of projecting an edge point, in evaluations (see `BudgetConfig`). Measured on the same core."""
REFINED_PX = np.array([2, 1])
"""Steps of the refinement around the best shift, px of the small image."""
REFINEMENTS = 9 * len(REFINED_PX)
"""Number of shifts tried in the refinement."""
OUTSIDE_SCORE = 0.3
"""Score of a point outside the image, about that of a random point in an image, since it is uninformative.

Measured on 15 short flights with track losses and wrong initial poses: half and twice this value give equal poses.
"""
TANGENTS = np.tan(np.arange(1, ORIENTATIONS // 2) * math.pi / ORIENTATIONS)
"""Of the angles between the direction bins of the first quarter of a turn."""
FARTHEST_PX = 1e4
"""Largest pixel coordinate; points beyond are dropped: no shift brings them in, and coordinates must fit integers."""

Indices = NDArray[np.int64]
Distance = NDArray[np.uint8]


class SmallCamera(NamedTuple):
    """Pinhole camera of the small image: f (4,) fx fy cx cy in its px, size_px (2,), near the least depth."""

    f: Array
    size_px: Array
    near: float


class Target(NamedTuple):
    """Target of the matching: distance (ORIENTATIONS, h, w) to the nearest edge pixel of each direction, at most FAR;
    cost of a shift in the score, per squared px.
    """

    distance: Distance
    shift_cost: float


class SeenEdges(NamedTuple):
    """Points (n, 3) on the visible edges, the unit direction (n, 3) of their edges, and their mean, focus (3,)."""

    points: Array
    direction: Array
    focus: Array


class ImagePoints(NamedTuple):
    """Orientation bin, row and column (n, 3) of edge points in the small image or its margin; the first `filled` are
    valid.
    """

    places: Indices
    filled: int


class Agreement(NamedTuple):
    """Sum of FAR less the distances of edge points to the nearest edge pixel, and the number of points looked up."""

    total: int
    looked_up: int


class RefinedPose(NamedTuple):
    """Change (6,) of a pose, its score, and the evaluations spent."""

    change: Array
    score: float
    evaluations: int


class PoseScores(NamedTuple):
    """Score (k,) of each pose with the best shift (k, 2) in px of the small image, and the evaluations spent.

    poses: how many of them were scored, the first ones; the others score 0.
    """

    scores: Array
    shifts: Indices
    evaluations: int
    poses: int


class Limits(NamedTuple):
    """Limits of scoring: most evaluations, and the lead over another score that makes one clear."""

    evaluations: int
    clear_score: float


LIMITS = named_tuple(Limits, "i0 f0")
SMALL_CAMERA = named_tuple(SmallCamera, "f1! f1! f0")
TARGET = named_tuple(Target, "u3! f0")
SEEN_EDGES = named_tuple(SeenEdges, "f2! f2! f1!")
IMAGE_POINTS = named_tuple(ImagePoints, "i2! i0")
RIGID_MOTION = named_tuple(RigidMotion, "f2! f1!")


@compiled("f2 f1 f1 f1")
def turned_about(R: Array, t: Array, focus: Array, a: Array) -> RigidMotion:
    """Pose (R, t) changed by a (6,).

    The object rotates by a[:3] around the focus (3,) in the camera frame, its range grows by the fraction a[3], and the
    image shifts by the angles a[4] to the right and a[5] down.
    """
    still, shift = np.zeros(6), np.zeros(6)
    for i in range(3):
        still[3 + i] = a[i]
    shift[3], shift[4] = -a[5], a[4]
    turned = se3_exp_left(R, t - focus, still)
    for i in range(3):
        turned.t[i] += (1.0 + a[3]) * focus[i]
    return se3_exp_left(turned.R, turned.t, shift)


@compiled("f2 f1 f1 f1 f1!", inner=True, allocates=False)
def project_to(R: Array, t: Array, f: Array, point: Array, px: Array) -> None:
    """Write the pixel px (2,) of a point (3,) at a pose (R, t)."""
    z = R[2, 0] * point[0] + R[2, 1] * point[1] + R[2, 2] * point[2] + t[2]
    for i in range(2):
        px[i] = (R[i, 0] * point[0] + R[i, 1] * point[1] + R[i, 2] * point[2] + t[i]) / z * f[i] + f[2 + i]


@compiled("f2 pose f3 f2 camera f0", pose=RIGID_MOTION, camera=SMALL_CAMERA)
def seen_alike(
    points: Array, pose: RigidMotion, R: Array, t: Array, camera: SmallCamera, step_px: float
) -> NDArray[np.bool_]:
    """Mask (k,) of the poses R (k, 3, 3), t (k, 3) at which no point (n, 3) is a step or more from where a pose has it,
    in each coordinate.
    """
    alike, there, at = np.ones(len(R), np.bool_), np.empty(2), np.empty(2)
    for p in range(len(points)):
        project_to(pose.R, pose.t, camera.f, points[p], there)
        for k in range(len(R)):
            project_to(R[k], t[k], camera.f, points[p], at)
            alike[k] &= abs(at[0] - there[0]) < step_px and abs(at[1] - there[1]) < step_px
    return alike


@compiled("f1 f2 f1", inner=True)
def focus_at(focus: Array, R: Array, t: Array) -> Array:
    """A point (3,) of the world in the frame of a camera at (R, t)."""
    there = t.copy()
    for i in range(3):
        for j in range(3):
            there[i] += R[i, j] * focus[j]
    return there


@compiled("f0 f0", inner=True, allocates=False)
def orientation(x: float, y: float) -> int:
    """Bin of the direction of a line along (x, y), of ORIENTATIONS over half a turn from the x axis on."""
    if y < 0.0 or (y == 0.0 and x < 0.0):
        x, y = -x, -y
    quarter = 0
    if x <= 0.0:
        x, y, quarter = y, -x, ORIENTATIONS // 2
    for tangent in TANGENTS:
        quarter += int(y >= tangent * x)
    return quarter


@compiled("seen f2 f1 camera", inner=True, seen=SEEN_EDGES, camera=SMALL_CAMERA)
def image_points(seen: SeenEdges, R: Array, t: Array, camera: SmallCamera) -> ImagePoints:
    """Edge points in front of the camera, in the small image or its margin."""
    points, direction, f = seen.points, seen.direction, camera.f
    places = np.empty((len(points), 3), np.int64)
    n = 0
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
        if z <= camera.near:
            continue
        a, b = x / z, y / z
        u, v = f[0] * a + f[2], f[1] * b + f[3]
        if abs(u) > FARTHEST_PX or abs(v) > FARTHEST_PX:
            continue
        places[n, 0] = orientation(-f[1] * (dy - b * dz), f[0] * (dx - a * dz))  # of the normal
        places[n, 1], places[n, 2] = math.floor(v + 0.5), math.floor(u + 0.5)
        n += 1
    return ImagePoints(places, n)


@compiled("points u3 i0 i0 i0 i0", inner=True, allocates=False, points=IMAGE_POINTS)
def agreement(points: ImagePoints, distance: Distance, right: int, down: int, outside: int, needed: int) -> Agreement:
    """Agreement of points, shifted in px, with edge pixels; aborted when it cannot exceed `needed`.

    A point outside the image contributes `outside`.
    """
    places, n = points.places, points.filled
    h, w = distance.shape[1], distance.shape[2]
    total = 0
    for p in range(n):
        i, j = places[p, 1] + down, places[p, 2] + right
        total += FAR - int(distance[places[p, 0], i, j]) if 0 <= i < h and 0 <= j < w else outside
        if total + (n - 1 - p) * FAR <= needed:
            return Agreement(total, p + 1)
    return Agreement(total, n)


@compiled(
    "seen pose f2 i2 camera target limits",
    limits=LIMITS,
    seen=SEEN_EDGES,
    pose=RIGID_MOTION,
    camera=SMALL_CAMERA,
    target=TARGET,
)
def score_changes(
    seen: SeenEdges,
    pose: RigidMotion,
    changes: Array,
    shifts: Indices,
    camera: SmallCamera,
    target: Target,
    limits: Limits,
) -> PoseScores:
    """Scores of a pose with changes (k, 6) as `turned_about` takes them, with the best of shifts (s, 2) in px.

    The score is the mean over the edge points of 1 - distance / FAR, with distance (ORIENTATIONS, h, w) to the nearest
    edge pixel of that direction, less the cost of the shift; a point outside the image scores OUTSIDE_SCORE. The best
    shift is refined. Changes that are worse than the best previous one by the clear score are given 0.
    """
    most_of_one = len(seen.points) * (PROJECTION_EVALUATIONS + len(shifts) + REFINEMENTS)
    focus, distance = focus_at(seen.focus, pose.R, pose.t), target.distance
    scores, best, evaluations = np.zeros(len(changes)), np.zeros((len(changes), 2), np.int64), 0
    outside, hopeful, poses = math.floor(OUTSIDE_SCORE * FAR), 0.0, 0
    for k in range(len(changes)):
        if evaluations + most_of_one > limits.evaluations:
            break
        poses += 1
        changed = turned_about(pose.R, pose.t, focus, changes[k])
        points = image_points(seen, changed.R, changed.t, camera)
        evaluations += len(seen.points) * PROJECTION_EVALUATIONS
        if points.filled < MIN_POINTS:
            continue
        hopeless = max(0, math.floor((hopeful - limits.clear_score) * FAR * points.filled))
        top = hopeless
        for s in range(len(shifts)):
            right, down = shifts[s, 0], shifts[s, 1]
            cost = math.floor(target.shift_cost * (right * right + down * down) * FAR * points.filled)
            found = agreement(points, distance, right, down, outside, top + cost)
            evaluations += found.looked_up
            if found.total - cost > top:
                top, best[k, 0], best[k, 1] = found.total - cost, right, down
        if top == hopeless:
            continue
        for step in REFINED_PX:
            middle_x, middle_y = best[k, 0], best[k, 1]
            for side in range(9):
                right, down = middle_x + (side % 3 - 1) * step, middle_y + (side // 3 - 1) * step
                cost = math.floor(target.shift_cost * (right * right + down * down) * FAR * points.filled)
                found = agreement(points, distance, right, down, outside, top + cost)
                evaluations += found.looked_up
                if found.total - cost > top:
                    top, best[k, 0], best[k, 1] = found.total - cost, right, down
        scores[k] = top / (FAR * points.filled)
        hopeful = max(hopeful, scores[k])
    return PoseScores(scores, best, evaluations, poses)


@compiled("seen f2 f1 f1 camera target", inner=True, seen=SEEN_EDGES, camera=SMALL_CAMERA, target=TARGET)
def score_change(
    seen: SeenEdges,
    R: Array,
    t: Array,
    change: Array,
    camera: SmallCamera,
    target: Target,
) -> float:
    """Score of a pose (R, t) with a change (6,), whose cost is that of a shift by the same angles."""
    pose = turned_about(R, t, focus_at(seen.focus, R, t), change)
    points = image_points(seen, pose.R, pose.t, camera)
    outside = math.floor(OUTSIDE_SCORE * FAR)
    total = agreement(points, target.distance, 0, 0, outside, 0).total
    square = 0.0
    for i in range(6):
        square += change[i] * change[i]
    cost = target.shift_cost * camera.f[0] * camera.f[0] * square
    score: float = total / (FAR * max(points.filled, MIN_POINTS)) - cost
    return score


@compiled("seen f2 f1 f1 camera target", seen=SEEN_EDGES, camera=SMALL_CAMERA, target=TARGET)
def refine_pose(
    seen: SeenEdges,
    R: Array,
    t: Array,
    steps: Array,
    camera: SmallCamera,
    target: Target,
) -> RefinedPose:
    """The change of a pose with the best score, by a pattern search (Hooke & Jeeves 1961) with initial `steps` (6,)."""
    change, step, tried = np.zeros(6), steps.copy(), 1
    best = score_change(seen, R, t, change, camera, target)
    for _ in range(PATTERN_LEVELS):
        for _ in range(PATTERN_SWEEPS):
            moved = False
            for i in range(6):
                for sign in (-1.0, 1.0):
                    change[i] += sign * step[i]
                    score = score_change(seen, R, t, change, camera, target)
                    tried += 1
                    if score > best:
                        best, moved = score, True
                        break
                    change[i] -= sign * step[i]
            if not moved:
                break
        step *= 0.5
    return RefinedPose(change, best, tried * len(seen.points) * (PROJECTION_EVALUATIONS + 1))
