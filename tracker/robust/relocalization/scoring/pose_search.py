"""Pose search: poses around a guess whose visible edges match the image.

The camera is moved around the part of the structure that it looks at, to other viewing directions, rolls and ranges;
for each such pose all image shifts are tried, on a small image with edge pixels binned by direction (oriented chamfer
matching: Shotton, Blake & Cipolla 2008).
"""

import math
from collections.abc import Callable
from functools import cache
from itertools import product
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from uavbench.scenes.camera import Camera
from uavbench.tracker.geometry_kernels import RigidMotion
from uavbench.tracker.protocol import Image
from uavbench.tracker.robust.config import RobustConfig
from uavbench.tracker.robust.config.relocalization import SMALL_WIDTH
from uavbench.tracker.robust.edges.columns import EDGE
from uavbench.tracker.robust.edges.edge_graph import EdgeMap
from uavbench.tracker.robust.edges.sampling_kernels import sample_edges
from uavbench.tracker.robust.relocalization.scoring.edge_pixel_kernels import edge_channels, truncate
from uavbench.tracker.robust.relocalization.scoring.pose_search_kernels import (
    FAR,
    MIN_POINTS,
    OUTSIDE_SCORE,
    PATTERN_LEVELS,
    PATTERN_SWEEPS,
    PROJECTION_EVALUATIONS,
    REFINEMENTS,
    Limits,
    SeenEdges,
    SmallCamera,
    Target,
    refine_pose,
    score_changes,
    turned_about,
)
from uavbench.tracker.robust.view import AT_ONCE, NOTHING_MASKED, View
from uavbench.tracker.robust.work import coarse_sampling_evaluations, sampling_evaluations
from uavbench.trajectories.pose import Array

BESIDE = 1 / 3
"""Margin, as a fraction of the image width, in which edges count as visible, since a shift may bring them in."""
EDGE_POINTS = 140
"""Number of points on the model's edges by which a pose is scored."""
SPACING_PX = 1.0
"""Least distance of these points: a pixel of the small image."""
EDGE_SIGMAS = 4.0
"""Least gradient of an edge pixel over two px, in standard deviations of the largest accepted noise."""
CANDIDATES = 8
"""Poses kept per viewing direction, and poses refined in total: limits their time."""
GOLDEN = 0.6180339887498949
"""Golden-ratio constant, whose multiples modulo 1 are evenly distributed for any number of them."""
ROBERTS = 1.0 / 1.1127756842787055 ** np.arange(1, 7)
"""Steps of a quasi-random sequence in six dimensions (Roberts 2018)."""
Indices = NDArray[np.int64]
STILL = np.zeros((1, 6))
ANY_WORK = 2**62
"""A number of evaluations that is no limit."""


class Detail(NamedTuple):
    """How closely poses are looked at: width of the image, px, and the number of points by which each is scored.

    sampling: evaluations of finding the visible edge points among so many edges near the view.
    """

    width_px: int
    points: int
    sampling: Callable[[int], int]


FINE = Detail(SMALL_WIDTH, EDGE_POINTS, sampling_evaluations)
COARSE = Detail(SMALL_WIDTH // 2, 40, coarse_sampling_evaluations)
"""Detail that tells views of a structure apart at a small part of the work; more points find no more of them."""


class Candidate(NamedTuple):
    """A pose with its score, at most 1, the edges visible at it, and the cost of its shift in the score."""

    score: float
    pose: RigidMotion
    seen: SeenEdges
    cost: float = 0.0


class Block(NamedTuple):
    """Poses that are scored together: one viewing direction, rotated from the guess's by azimuth and elevation (rad).

    changes (k, 2) roll (rad) and range (part) from there; shifts (s, 2) in px of the small image.
    """

    azimuth_rad: float
    elevation_rad: float
    changes: Array
    shifts: Indices

    def after(self, first: int) -> "Block":
        """The block without so many of its changes, the first ones."""
        return self._replace(changes=self.changes[first:])


class Reach(NamedTuple):
    """Extent of a block: in roll (rad), range (relative), shifts (fractions of the image size); factor on its steps."""

    roll_rad: float
    range_part: float
    shift_part: float
    step_factor: float = 1.0


class Scored(NamedTuple):
    """Candidates, best first, the evaluations spent, and the number of poses scored."""

    candidates: list[Candidate]
    evaluations: int
    poses: int


class UndistortionMaps(NamedTuple):
    """Coordinates x and y (h, w) in the distorted image of each pixel of the undistorted one."""

    x: NDArray[np.float32]
    y: NDArray[np.float32]


def grid(half: float, step: float) -> tuple[float, ...]:
    """Evenly spaced values from -half to half, at most `step` apart."""
    n = int(np.ceil(half / step - 1e-9))  # tolerance for round-off of exact multiples
    return tuple(float(v) for v in np.linspace(-half, half, 2 * n + 1)) if n else (0.0,)


@cache
def spread_over(count: int) -> Indices:
    """An order of so many points along a line in which any leading subset is spread over all of it."""
    order = np.argsort(np.arange(count) * GOLDEN % 1.0)
    order.flags.writeable = False
    return order


def whole(shifts: list[tuple[float, ...]]) -> Indices:
    """Shifts (s, 2) rounded to whole px."""
    return np.round(shifts).astype(np.int64)


class PoseSearch:
    """Pose search with a structure's edges and the small camera, in some detail."""

    def __init__(
        self, edges: EdgeMap, camera: Camera, near: float, config: RobustConfig, detail: Detail = FINE
    ) -> None:
        self.config, self.edges, self.sigma_cost = config.relocalization.search, edges, config.relocalization.sigma_cost
        self.clear_score = float(config.relocalization.lead)
        self.points, self.cost_of_edges = detail.points, detail.sampling
        self.least_gradient = EDGE_SIGMAS * config.preprocessing.max_noise_grey
        self.scale = max(1.0, camera.width / detail.width_px)
        self.step_part = self.config.step_part * SMALL_WIDTH / detail.width_px
        self.f = np.array([camera.fx, camera.fy, camera.cx + 0.5, camera.cy + 0.5]) / self.scale
        self.f[2:] -= 0.5
        self.size = (round(camera.width / self.scale), round(camera.height / self.scale))
        self.camera = SmallCamera(self.f, np.array(self.size, dtype=np.float64), near)
        step_px = float(self.config.truncation_px)
        self.around = whole(list(product((0.0, -step_px, step_px), repeat=2)))
        self.maps = _undistortion_maps(camera, self.f, self.size, self.scale)
        self.masked = self._masked(camera)
        self.view = _wide_view(self.camera)

    @property
    def sampling(self) -> int:
        """Evaluations of finding the visible edge points of a pose, as far from the structure as the last one."""
        return self.cost_of_edges(self.edges.looked_at)

    @property
    def turn_rad(self) -> float:
        """Rotation from a pose at which better ones are searched: half a step of viewing directions.

        Measured on rendered boxes: wrong fits are mostly turned by some 0.1 rad, where their outline is the right one.
        """
        return 0.5 * self.config.view_step_rad

    @property
    def half_px(self) -> float:
        """Half length of search lines at its poses, px of the whole image: how far an edge point that counts may be."""
        return float(self.config.truncation_px * self.scale)

    @property
    def steps(self) -> Array:
        """Steps (6,) of a pose's changes, as `turned_about` takes them; half a step of shifts."""
        c = self.config
        return np.array([self.step_part] * 4 + [c.truncation_px / self.f[0] / 2] * 2)

    def nearby(self, pose: RigidMotion, focus: Array, k: int) -> RigidMotion:
        """The k-th quasi-random pose about a pose, turned about a point (3,) of the camera frame by half a step of
        viewing directions and less, and changed by a step of roll, range and shifts and less.
        """
        reach = self.steps
        reach[:2] = self.turn_rad
        return turned_about(pose.R, pose.t, focus, (k * ROBERTS % 1.0 * 2 - 1) * reach)

    def block(self, azimuth_rad: float, elevation_rad: float, reach: Reach) -> Block:
        """Block of a viewing direction, rotated from the guess's."""
        c, longer = self.config, reach.step_factor
        logs = grid(float(np.log1p(reach.range_part)), longer * self.step_part)
        across, down = reach.shift_part * self.size[0], reach.shift_part * self.size[1]
        shifts = whole(list(product(grid(across, c.truncation_px), grid(down, c.truncation_px))))
        nearest_first = np.argsort(np.linalg.norm(shifts, axis=1), kind="stable")
        changes = np.array(list(product(grid(reach.roll_rad, longer * self.step_part), map(np.expm1, logs))))
        likeliest_first = np.argsort(np.linalg.norm(changes, axis=1), kind="stable")
        return Block(azimuth_rad, elevation_rad, changes[likeliest_first], shifts[nearest_first])

    def target(self, image: Image, sigma_px: float) -> Target:
        """The edge pixels of an image by direction, with the cost of a shift whose standard deviation is sigma_px."""
        small = self.small(image)
        channels = edge_channels(small[..., None] if small.ndim == 2 else small, self.least_gradient)
        most, far = np.float32(self.config.truncation_px), np.float32(FAR)
        if self.masked is not None:
            channels[:, self.masked] = 1
        for channel in channels:
            truncate(cv2.distanceTransform(channel, cv2.DIST_L2, 3), most, far, channel)
        if self.masked is not None:
            channels[:, self.masked] = FAR - math.floor(OUTSIDE_SCORE * FAR)
        return Target(channels, self.sigma_cost / sigma_px**2)

    def small(self, image: Image) -> Image:
        """A small image of the pinhole camera from an image."""
        small = cv2.resize(image, self.size, interpolation=cv2.INTER_AREA)
        if self.maps is not None:
            small = cv2.remap(small, self.maps.x, self.maps.y, cv2.INTER_LINEAR)
        return np.ascontiguousarray(small, dtype=np.uint8)

    def _masked(self, camera: Camera) -> NDArray[np.bool_] | None:
        """Pixels (h, w) of the small image that are masked or beside one that is, None where none are."""
        if not camera.masked:
            return None
        masked = self.small(np.where(camera.unmasked, np.uint8(0), np.uint8(255)))
        return np.asarray(cv2.dilate(masked, np.ones((3, 3), np.uint8)) > 0)

    def best_of(self, target: Target, guess: RigidMotion, block: Block, most: int) -> Scored:
        """The best poses of a block around a guess, within `most` evaluations."""
        seen = self.seen(guess)
        if not (block.azimuth_rad or block.elevation_rad):
            return self.best_there(target, guess, seen, block, most)
        return self.best_beside(target, Candidate(0.0, guess, seen), block, most)

    def best_beside(self, target: Target, candidate: Candidate, block: Block, most: int) -> Scored:
        """The same from another viewing direction, around the centre of the edges visible for a candidate."""
        guess = self.turned(candidate, block)
        found = self.best_there(target, guess, self.seen(guess), block, most)
        return found._replace(evaluations=found.evaluations + self.sampling)

    def best_there(self, target: Target, pose: RigidMotion, seen: SeenEdges, block: Block, most: int) -> Scored:
        """The best poses of a block, displaced along the line of sight of a pose at which these edges are visible."""
        if len(seen.points) < MIN_POINTS:
            return Scored([], self.sampling, len(block.changes))
        sight = pose.R @ seen.focus + pose.t
        changes = np.zeros((len(block.changes), 6))
        changes[:, :3] = block.changes[:, :1] * (sight / np.linalg.norm(sight))
        changes[:, 3] = block.changes[:, 1]
        found = self.scored(target, pose, seen, changes, block.shifts, most - 2 * self.sampling)
        return found._replace(evaluations=found.evaluations + self.sampling)

    def again(self, target: Target, candidate: Candidate) -> Scored:
        """A candidate scored in another image, shifted by no more than a step."""
        found = self.scored(target._replace(shift_cost=0.0), candidate.pose, candidate.seen, STILL, self.around)
        cost = candidate.cost
        candidates = [each._replace(score=each.score - cost, cost=cost) for each in found.candidates]
        return found._replace(candidates=candidates)

    @property
    def most_again(self) -> int:
        """Most evaluations of scoring a pose in another image."""
        return 2 * self.points * (PROJECTION_EVALUATIONS + len(self.around) + REFINEMENTS)

    def most_of(self, block: Block) -> int:
        """Most evaluations of a block."""
        one = 2 * self.points * (PROJECTION_EVALUATIONS + len(block.shifts) + REFINEMENTS)
        return len(block.changes) * one + 2 * self.sampling

    def refined(self, target: Target, candidate: Candidate) -> Scored:
        """A candidate refined to the nearest local maximum of its score."""
        pose, seen = candidate.pose, candidate.seen
        found = refine_pose(seen, pose.R, pose.t, self.steps, self.camera, target)
        pose = turned_about(pose.R, pose.t, pose.R @ seen.focus + pose.t, found.change)
        refined = Candidate(found.score - candidate.cost, pose, seen, candidate.cost)
        return Scored([refined], found.evaluations, 1)

    def most_refining(self, points: int) -> int:
        """Most evaluations that refining a candidate of so many points takes."""
        return (1 + 12 * PATTERN_LEVELS * PATTERN_SWEEPS) * points * (PROJECTION_EVALUATIONS + 1)

    def scored(
        self, target: Target, pose: RigidMotion, seen: SeenEdges, changes: Array, shifts: Indices, most: int = 10**12
    ) -> Scored:
        """The best changes (k, 6) of a pose, each at the best of shifts (s, 2), within `most` evaluations."""
        found = score_changes(seen, pose, changes, shifts, self.camera, target, Limits(most, self.clear_score))
        focus = pose.R @ seen.focus + pose.t
        changes = changes.copy()
        changes[:, 4:] += np.arctan(found.shifts / self.f[:2])
        best = np.argsort(-found.scores, kind="stable")[:CANDIDATES]
        best = best[found.scores[best] > 0]
        poses = (turned_about(pose.R, pose.t, focus, changes[k]) for k in best)
        cost = target.shift_cost * np.square(found.shifts).sum(axis=1)
        candidates = [
            Candidate(float(found.scores[k]), at, seen, float(cost[k])) for k, at in zip(best, poses, strict=True)
        ]
        return Scored(candidates, found.evaluations, found.poses)

    def seen(self, pose: RigidMotion) -> SeenEdges:
        """Points on the edges visible at a pose, in the image and its margin; any leading subset covers all of them."""
        points = sample_edges(self.edges, self.view.to(pose.R, pose.t), SPACING_PX, self.points)
        spread_out = spread_over(len(points.points))
        places = points.points[spread_out]
        focus = places.mean(axis=0) if len(places) else np.zeros(3)
        return SeenEdges(places, self.edges.directions(points.keys[spread_out, EDGE]), focus)

    def turned(self, candidate: Candidate, block: Block) -> RigidMotion:
        """The pose of a candidate, rotated around the centre of its visible edges to a block's viewing direction."""
        pose, seen = candidate.pose, candidate.seen
        if not len(seen.points):
            return pose
        change = np.zeros(6)
        change[:3] = block.azimuth_rad * pose.R[:, 2] + [block.elevation_rad, 0.0, 0.0]
        return turned_about(pose.R, pose.t, pose.R @ seen.focus + pose.t, change)


def _wide_view(camera: SmallCamera) -> View:
    """View of the small camera including the margin around its image."""
    border = np.floor(BESIDE * camera.size_px[0])
    size = camera.size_px + 2 * border
    lens = np.zeros(11)
    lens[:2], lens[2:4] = camera.f[:2], camera.f[2:] + border
    bounds = np.array([-0.5, -0.5, size[0] - 0.5, size[1] - 0.5])
    return View(np.eye(3), np.zeros(3), lens, size, bounds, camera.near, NOTHING_MASKED, AT_ONCE)


def _undistortion_maps(camera: Camera, f: Array, size: tuple[int, int], scale: float) -> UndistortionMaps | None:
    """Maps that take the distortion out of a small image; None for a camera without distortion."""
    if camera.distortion_model == "none":
        return None
    x, y = np.meshgrid((np.arange(size[0]) - f[2]) / f[0], (np.arange(size[1]) - f[3]) / f[1])
    pixels = camera.project(np.column_stack([x.ravel(), y.ravel(), np.ones(x.size)]))
    small = ((pixels + 0.5) / scale - 0.5).astype(np.float32).reshape(size[1], size[0], 2)
    return UndistortionMaps(np.ascontiguousarray(small[..., 0]), np.ascontiguousarray(small[..., 1]))
