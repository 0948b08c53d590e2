"""Search of the poses around a guess for those whose visible edges agree with the image.

The camera is moved around the part of the structure that it looks at: in azimuth, elevation, range and roll; for each
such pose all shifts in the image are tried, on a small image whose edge pixels are kept apart by direction (oriented
chamfer matching: Shotton, Blake & Cipolla 2008).
"""

from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from uavbench.scenes.camera import Camera
from uavbench.tracker.protocol import Image
from uavbench.tracker.robust.config.relocalization import PoseSearchConfig
from uavbench.tracker.robust.edge_fit import SeenEdges
from uavbench.tracker.robust.edges.edge_graph import EdgeMap
from uavbench.tracker.robust.kernel_values import kernel_values
from uavbench.tracker.robust.relocalization.pose_search_kernels import (
    EdgePoints,
    NearGuess,
    SmallCamera,
    edge_channels,
    score_poses,
    search_about,
    turned_about,
)
from uavbench.trajectories.pose import Array, Pose, rotation_exp

SMALL_WIDTH = 160
"""Width of the small image, px."""


class ScoredPose(NamedTuple):
    """A pose and its score in [0, 1]."""

    score: float
    pose: Pose


class UndistortionMaps(NamedTuple):
    """For each pixel of an undistorted image (h, w) the x and y of it in the distorted one."""

    x: NDArray[np.float32]
    y: NDArray[np.float32]


@dataclass(frozen=True)
class SearchRange:
    """How far from the guess to search: offsets in azimuth, elevation and roll (rad), ratios of range, px of shift."""

    azimuth_rad: tuple[float, ...]
    elevation_rad: tuple[float, ...]
    roll_rad: tuple[float, ...]
    range_ratio: tuple[float, ...]
    shift_x: float
    shift_y: float


def grid(half: float, step: float) -> tuple[float, ...]:
    """Values from -half to half, no farther apart than step."""
    n = int(np.ceil(half / step))
    return tuple(float(v) for v in np.linspace(-half, half, 2 * n + 1)) if n else (0.0,)


class PoseSearch:
    """Edge points of a structure and the small camera, ready to search images."""

    def __init__(self, edges: EdgeMap, camera: Camera, near: float, config: PoseSearchConfig) -> None:
        self.config, self.values = config, kernel_values(config)
        count = config.edge_points
        lengths = np.linalg.norm(edges.ends[:, 1] - edges.ends[:, 0], axis=1)
        spread_out = np.argsort(np.arange(count) * 0.6180339887498949 % 1.0)  # any first few lie all over
        at = (spread_out + 0.5) / count * lengths.sum()
        edge = np.minimum(np.searchsorted(np.cumsum(lengths), at), len(lengths) - 1)
        part = (at - (np.cumsum(lengths) - lengths)[edge]) / lengths[edge]
        along = edges.ends[edge, 1] - edges.ends[edge, 0]
        points = np.ascontiguousarray(edges.ends[edge, 0] + part[:, None] * along)
        direction = np.ascontiguousarray(along / lengths[edge, None])
        self.edges = EdgePoints(points, direction, np.ascontiguousarray(edges.faces[edge]), edges.planes)
        self.scale = max(1.0, camera.width / SMALL_WIDTH)
        self.f = np.array([camera.fx, camera.fy, camera.cx + 0.5, camera.cy + 0.5]) / self.scale
        self.f[2:] -= 0.5
        self.size = (round(camera.width / self.scale), round(camera.height / self.scale))
        self.camera = SmallCamera(self.f, np.array(self.size, dtype=np.float64), near)
        self.maps = _undistortion_maps(camera, self.f, self.size, self.scale)

    def search_range(self, view_rad: float, roll_rad: float, range_part: float, shift_part: float) -> SearchRange:
        """Range of half widths: change of viewing direction, roll, range as a part, shift as a part of the width."""
        c = self.config
        ratios = tuple(float(np.exp(v)) for v in grid(float(np.log1p(range_part)), c.range_step_log))
        return SearchRange(
            grid(view_rad, c.view_step_rad),
            grid(view_rad / 2, c.view_step_rad),
            grid(roll_rad, c.roll_step_rad),
            ratios,
            shift_part * SMALL_WIDTH,
            shift_part * SMALL_WIDTH * 0.75,
        )

    def edge_distance(self, image: Image) -> NDArray[np.float32]:
        """Distance (ORIENTATIONS, h, w) to the nearest edge pixel of each direction, as a part of the truncation."""
        small = cv2.resize(image, self.size, interpolation=cv2.INTER_AREA)
        if self.maps is not None:
            small = cv2.remap(small, self.maps.x, self.maps.y, cv2.INTER_LINEAR)
        small = small[..., None] if small.ndim == 2 else small
        channels = edge_channels(np.ascontiguousarray(small, dtype=np.uint8), self.config.min_gradient_grey)
        far = [cv2.distanceTransform(channel, cv2.DIST_L2, 3) for channel in channels]
        return np.asarray(np.minimum(np.array(far) / self.config.truncation_px, 1.0), dtype=np.float32)

    def best_poses(self, image: Image, guesses: list[Pose], around: SearchRange, most: int) -> list[ScoredPose]:
        """The best poses around the guesses with their scores in [0, 1], best first."""
        poses = [pose for guess in guesses for pose in self._around(guess, around)]
        if not poses:
            return []
        step = self.config.shift_step_px
        shifts = np.array(list(product(grid(around.shift_x, step), grid(around.shift_y, step))), dtype=np.float64)
        scores, best = score_poses(
            self.edges,
            np.array([pose.rotation for pose in poses]),
            np.array([pose.translation for pose in poses]),
            self.camera,
            self.edge_distance(image),
            shifts,
            self.values,
        )
        order = np.argsort(-scores, kind="stable")[:most]
        return [ScoredPose(float(scores[k]), self._shifted(poses[k], shifts[best[k]])) for k in order if scores[k] > 0]

    def near_poses(
        self, image: Image, guess: Pose, seen: SeenEdges, reach_rad: float, shift_rad: float, most: int
    ) -> list[ScoredPose]:
        """The best poses within reach_rad, that part of the range and shift_rad of a guess that sees these edges."""
        c = self.config
        if len(seen.points) < c.min_points:
            return []
        focus = guess.transform(seen.points).mean(axis=0)
        shift = grid(shift_rad, c.near_shift_px / self.f[0])
        turn, ratio = grid(reach_rad, c.near_turn_rad), grid(reach_rad, c.near_turn_rad)
        changes = np.array(list(product((0.0,), (0.0,), turn, ratio, shift, shift)))
        steps = np.array([c.near_turn_rad] * 4 + [c.near_shift_px / self.f[0]] * 2)
        around = NearGuess(np.array(guess.rotation), np.array(guess.translation), seen.points, seen.direction, focus)
        distance = self.edge_distance(image)
        found = search_about(around, self.camera, distance, changes, steps, most // 2, self.values)
        views = product((-c.near_view_rad, c.near_view_rad), repeat=2)
        beside = np.array([[a, b, 0, 0, 0, 0] for a, b in ((0, 0), *views)])
        again = (found.changes[:, None] + beside).reshape(-1, 6)
        found = search_about(around, self.camera, distance, again, steps, most, self.values)
        order = np.argsort(-found.scores, kind="stable")
        poses = (Pose(*turned_about(around.R, around.t, focus, found.changes[k])) for k in order)
        return [ScoredPose(float(found.scores[k]), pose) for k, pose in zip(order, poses, strict=True)]

    def _around(self, guess: Pose, around: SearchRange) -> list[Pose]:
        """Poses on the grid about what the guess looks at."""
        points, near = self.edges.points, self.camera.near
        cam = guess.transform(points)
        u = self.f[0] * cam[:, 0] / cam[:, 2] + self.f[2]
        v = self.f[1] * cam[:, 1] / cam[:, 2] + self.f[3]
        inside = (cam[:, 2] > near) & (u > 0) & (u < self.size[0]) & (v > 0) & (v < self.size[1])
        if np.count_nonzero(inside) < self.config.min_points:
            inside = cam[:, 2] > near
        if not inside.any():
            return []
        focus = points[inside].mean(axis=0)
        eye = guess.inverse().translation
        sight = (focus - eye) / np.linalg.norm(focus - eye)
        side = np.cross(sight, [0.0, 0.0, 1.0])
        norm = float(np.linalg.norm(side))
        side = side / norm if norm > 1e-3 else guess.rotation[0]
        out = []
        for azimuth, elevation in product(around.azimuth_rad, around.elevation_rad):
            orbit = rotation_exp(np.array([0.0, 0.0, azimuth])) @ rotation_exp(side * elevation)
            for roll, ratio in product(around.roll_rad, around.range_ratio):
                turn = orbit @ rotation_exp(sight * roll)
                new_eye = focus + ratio * (orbit @ (eye - focus))
                R = guess.rotation @ turn.T
                out.append(Pose(R, -R @ new_eye))
        return out

    def _shifted(self, pose: Pose, shift: Array) -> Pose:
        """The pose turned so that the middle of the image moves by a shift of the small image."""
        fx, fy = self.f[0], self.f[1]
        return Pose.exp([0, 0, 0, -np.arctan(shift[1] / fy), np.arctan(shift[0] / fx), 0]) @ pose


def _undistortion_maps(camera: Camera, f: Array, size: tuple[int, int], scale: float) -> UndistortionMaps | None:
    """Maps that take the distortion out of a small image; None for a camera without distortion."""
    if camera.distortion_model == "none":
        return None
    x, y = np.meshgrid((np.arange(size[0]) - f[2]) / f[0], (np.arange(size[1]) - f[3]) / f[1])
    pixels = camera.project(np.column_stack([x.ravel(), y.ravel(), np.ones(x.size)]))
    small = ((pixels + 0.5) / scale - 0.5).astype(np.float32).reshape(size[1], size[0], 2)
    return UndistortionMaps(np.ascontiguousarray(small[..., 0]), np.ascontiguousarray(small[..., 1]))
