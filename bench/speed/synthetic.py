"""A fast ray caster for textured boxes on a textured floor, to test trackers without the renderer."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from uavbench.scenes.camera import Camera
from uavbench.scenes.structure import Structure
from uavbench.trajectories.pose import Array, Pose

CAMERA = Camera.from_field_of_view(640, 480, 65.0)
ROWS = 32
"""Of the finer image, whose floor is drawn at once."""
BOX_TRIANGLES = np.array(
    [
        [0, 2, 1], [1, 2, 3], [4, 5, 6], [5, 7, 6], [0, 1, 4], [1, 5, 4],
        [2, 6, 3], [3, 6, 7], [0, 4, 2], [2, 4, 6], [1, 3, 5], [3, 7, 5],
    ]
)  # fmt: skip


def box_corners(size: Sequence[float] = (0.4, 0.3, 0.3), centre: Sequence[float] = (0.0, 0.0)) -> Array:
    """Corners (8, 3) of a box on the ground, m."""
    x, y, z = size
    return np.array(
        [[centre[0] + (i - 0.5) * x, centre[1] + (j - 0.5) * y, k * z] for k in (0, 1) for j in (0, 1) for i in (0, 1)]
    )


def box(size: Sequence[float] = (0.4, 0.3, 0.3)) -> Structure:
    """A box of a size in m on the ground, centred at the origin."""
    return Structure.from_mesh(box_corners(size), BOX_TRIANGLES)


def look_at(eye: Array, target: Sequence[float] | Array, roll: float = 0.0) -> Pose:
    """cam_from_world of a camera at `eye` that looks at `target`, both (3,) in m, with a roll in rad about its axis."""
    z = np.asarray(target, float) - eye
    z /= np.linalg.norm(z)
    x = np.cross(z, [0, 0, 1.0])
    x /= np.linalg.norm(x)
    y = np.cross(z, x)
    c, s = np.cos(roll), np.sin(roll)
    R = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) @ np.array([x, y, z])
    return Pose(R, -R @ np.asarray(eye, float))


def orbit(n: int, *, rate_hz: float = 15.0, range_m: float = 1.1, speed_m_s: float = 0.25, seed: int = 0) -> list[Pose]:
    """cam_from_world of n frames on a smooth orbit, as if flown by hand: range, height and aim vary slowly."""
    rng = np.random.default_rng(seed)
    phase = rng.uniform(0, 2 * np.pi, 8)
    t = np.arange(n) / rate_hz

    def wave(i: int, period: float) -> Array:
        return np.asarray(np.sin(2 * np.pi * t / period + phase[i]))

    angle = phase[7] + t * speed_m_s / range_m + 0.08 * wave(0, 3.1)
    radius = range_m * (1 + 0.12 * wave(1, 5.3))
    height = 0.55 + 0.15 * wave(2, 6.7) + 0.03 * wave(3, 1.3)
    eyes = np.stack([radius * np.cos(angle), radius * np.sin(angle), height], axis=1)
    aims = np.stack([0.05 * wave(4, 2.3), 0.05 * wave(5, 1.9), 0.15 + 0.04 * wave(6, 1.7)], axis=1)
    return [look_at(e, a, r) for e, a, r in zip(eyes, aims, 0.05 * wave(0, 2.7), strict=True)]


def texture(
    rng: np.random.Generator, colour: Any, contrast: float, size: int = 512, scale: int = 8
) -> NDArray[np.float32]:
    """Texture (size, size, 3) of five octaves of grey noise, sigma `contrast` in grey levels, around a BGR colour."""
    out = np.zeros((size, size))
    for octave in range(5):
        n = max(2, size // (scale * 2**octave) + 2)
        out += cv2.resize(rng.normal(size=(n, n)), (size, size), interpolation=cv2.INTER_CUBIC) / (octave + 1)
    out *= contrast / out.std()
    return np.clip(np.asarray(colour)[None, None] + out[..., None], 0, 255).astype(np.float32)


@dataclass
class Scene:
    """Axis-aligned boxes, given by corners (8, 3) in m, on a floor; each face has its own texture and brightness."""

    boxes: list[Array]
    seed: int = 0

    def __post_init__(self) -> None:
        rng = np.random.default_rng(self.seed)
        self.floor = texture(rng, (95, 105, 110), 14, scale=16)
        self.faces = []
        for corners in self.boxes:
            low, high = corners.min(axis=0), corners.max(axis=0)
            for axis in range(3):
                for side, at in ((-1, low), (1, high)):
                    if axis == 2 and side == -1:
                        continue
                    u, v = (a for a in range(3) if a != axis)
                    shade = {0: 0.75, 1: 0.9, 2: 1.15}[axis] * (1.0 if side > 0 else 0.85)
                    tex = texture(rng, np.array((90, 130, 165)) * shade, 7)
                    self.faces.append((axis, side, at[axis], u, v, low, high, tex))

    def render(
        self,
        cam_from_world: Pose,
        camera: Camera = CAMERA,
        noise_rng: np.random.Generator | None = None,
        supersample: int = 2,
    ) -> NDArray[np.uint8]:
        """BGR image (h, w, 3) uint8, with shot and read noise when a generator is given."""
        height, width = camera.height * supersample, camera.width * supersample
        d = (cam_from_world.rotation.T @ _rays(camera, supersample)).reshape(3, height, width)
        o = cam_from_world.inverse().translation
        full, depth = self._floor_seen(o, d)
        for face in self.faces:
            axis, side, at, u, v, low, high, tex = face
            if side * (o[axis] - at) <= 0:
                continue
            window = _window(face, cam_from_world, camera, supersample)
            du, dv, dn = (d[k][window] for k in (u, v, axis))
            t = (at - o[axis]) / np.where(dn == 0, 1e-12, dn)
            pu, pv = o[u] + t * du, o[v] + t * dv
            near = depth[window]
            hit = (t > 0) & (t < near) & (pu >= low[u]) & (pu <= high[u]) & (pv >= low[v]) & (pv <= high[v])
            if not hit.any():
                continue
            full[window][hit] = _sample(tex, *((p[hit] - least) / 0.5 for p, least in ((pu, low[u]), (pv, low[v]))))
            near[hit] = t[hit]
        small = cv2.resize(full, (camera.width, camera.height), interpolation=cv2.INTER_AREA)
        if noise_rng is not None:
            small = small + noise_rng.normal(size=small.shape) * np.sqrt(4.0 + 0.06 * small)
        return np.asarray(np.clip(small + 0.5, 0, 255), dtype=np.uint8)

    def _floor_seen(self, o: Array, d: Array) -> tuple[NDArray[np.float32], Array]:
        """Colour (h, w, 3) and depth (h, w) of the floor, infinite above the horizon; ROWS at a time, in the cache."""
        full, depth = np.full((*d.shape[1:], 3), 180.0, np.float32), np.full(d.shape[1:], np.inf)
        for first in range(0, len(depth), ROWS):
            rows = slice(first, first + ROWS)
            t = -o[2] / np.where(d[2, rows] == 0, 1e-12, d[2, rows])
            hit = (t > 0) & (t < 50)
            if hit.any():
                seen = _sample(self.floor, *((o[k] + t * d[k, rows]).ravel() / 1.5 for k in (0, 1)))
                np.copyto(full[rows], seen.reshape(*t.shape, 3), where=hit[..., None])
                np.copyto(depth[rows], t, where=hit)
        return full, depth


@lru_cache(maxsize=1)
def _rays(camera: Camera, supersample: int) -> Array:
    """Rays (3, n) in the camera frame, z = 1, row by row through supersample² points of each pixel."""
    s = supersample
    x = (np.arange(camera.width * s) - (s - 1) / 2) / s
    y = (np.arange(camera.height * s) - (s - 1) / 2) / s
    return np.ascontiguousarray(camera.rays(np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)).T)


def _window(face: Any, cam_from_world: Pose, camera: Camera, supersample: int) -> tuple[slice, slice]:
    """Rows and columns of the finer image that a face can be seen in: all of them where it is not before the camera."""
    _, _, at, u, v, low, high, _ = face
    corners = np.full((4, 3), float(at))
    corners[:, u], corners[:, v] = [low[u], low[u], high[u], high[u]], [low[v], high[v], low[v], high[v]]
    points = cam_from_world.transform(corners)
    if camera.distortion_model != "none" or points[:, 2].min() < 0.05:
        return slice(None), slice(None)
    pixels = camera.project(points)
    first = np.maximum(np.floor((pixels.min(axis=0) - 1) * supersample), 0).astype(int)
    last = np.maximum(np.ceil((pixels.max(axis=0) + 2) * supersample), 0).astype(int)
    return slice(first[1], last[1]), slice(first[0], last[0])


def _sample(tex: NDArray[np.float32], u: Array, v: Array) -> Any:
    """Colours (n, 3) of a texture that is repeated, at coordinates (n,) in its sizes."""
    n, width = len(u), 1024  # cv2.remap takes no more than 32767 rows
    x, y = (((at - np.floor(at)) * (len(tex) - 1)).astype(np.float32) for at in (u, v))
    if n % width:
        x, y = (np.resize(at, -(-n // width) * width) for at in (x, y))
    return cv2.remap(tex, x.reshape(-1, width), y.reshape(-1, width), cv2.INTER_LINEAR).reshape(-1, 3)[:n]


class PoseError(NamedTuple):
    """Distance between two camera centres in m, rotation angle between two cameras in rad."""

    distance_m: float
    angle_rad: float


def pose_error(estimate: Pose, ground_truth: Pose) -> PoseError:
    """Error of an estimated cam_from_world against the true one."""
    difference = estimate @ ground_truth.inverse()
    centre = np.linalg.norm(estimate.inverse().translation - ground_truth.inverse().translation)
    return PoseError(float(centre), float(np.linalg.norm(difference.log()[3:])))


class SyntheticFlight(NamedTuple):
    """cam_from_world of each frame, and the BGR frames (h, w, 3)."""

    poses: list[Pose]
    images: list[NDArray[np.uint8]]


def flown(frames: int, seed: int) -> SyntheticFlight:
    """A flight around a box at 15 Hz, its frames with shot noise."""
    poses = orbit(frames, seed=seed)
    scene = Scene([box_corners()], seed=seed)
    rng = np.random.default_rng(seed)
    return SyntheticFlight(poses, [scene.render(pose, noise_rng=rng) for pose in poses])
