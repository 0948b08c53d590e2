"""A fast ray caster for textured boxes on a textured floor, to test trackers without the renderer."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from uavbench.scenes.camera import Camera
from uavbench.scenes.structure import Structure
from uavbench.trajectories.kernels.argument_types import named_tuple
from uavbench.trajectories.kernels.compiled import compiled
from uavbench.trajectories.pose import Array, Pose

CAMERA = Camera.from_field_of_view(640, 480, 65.0)
ROWS = 16
"""Of the image, drawn at once: what is computed for them stays in the cache."""
WIDTH = 1024
"""In which places of a texture are looked up: cv2.remap takes no more than 32767 rows."""
SKY = (180.0,) * 4
"""Colour beyond the floor."""
Places = NDArray[np.float32]
OUTSIDE = np.float32(-9.0)
"""Of a place outside of each texture."""
FARTHEST = 50.0
"""To which the floor is seen, in units of the rays."""
FLOOR_M, FACE_M = 1.5, 0.5
"""Sides of a texture on the floor and on a face."""
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


def waves(rng: np.random.Generator, size: int = 512, scale: int = 8) -> list[Array]:
    """Five octaves of grey noise (n, n), the finest first, for a texture (size, size)."""
    sides = [max(2, size // (scale * 2**octave) + 2) for octave in range(5)]
    return [rng.normal(size=(n, n)) for n in sides]


def texture(octaves: list[Array], colour: Any, contrast: float, size: int = 512) -> Any:
    """Texture (size, size, 3) float32 of octaves, sigma `contrast` in grey levels, around a BGR colour."""
    out = np.zeros((size, size))
    for octave, wave in enumerate(octaves):
        out += cv2.resize(wave, (size, size), interpolation=cv2.INTER_CUBIC) / (octave + 1)
    out *= contrast / out.std()
    return cv2.merge([np.clip(level + out, 0, 255).astype(np.float32) for level in colour])


class Part(NamedTuple):
    """A face: the axes along its texture's sides and across it, where it is along the latter, corners of its box."""

    axes: NDArray[np.int64]
    at: float
    low: Array
    high: Array


class Rays(NamedTuple):
    """Directions (3, h, w) from an eye (3,) in m, for rows of the finer image from `top`."""

    directions: Array
    eye: Array
    top: int


class Met(NamedTuple):
    """What rays meet: how far away (n,), and where on the floor's texture (2, h, w); which ones met a face, and where.

    A place on the floor's texture is OUTSIDE where none is seen.
    """

    depth: Array
    below: Places
    which: NDArray[np.int64]
    places: Places


TUPLES = {
    "Rays": named_tuple(Rays, "f3! f1! i0"),
    "Part": named_tuple(Part, "i1! f0 f1! f1!"),
    "Met": named_tuple(Met, "f1! s3! i1! s3!"),
}


@compiled("Rays i0 Met", allocates=False, **TUPLES)
def meet_floor(rays: Rays, texels: int, met: Met) -> int:
    """How many rays meet the floor; sets how far away all do, or inf, and where."""
    over, along, up = rays.directions[0].reshape(-1), rays.directions[1].reshape(-1), rays.directions[2].reshape(-1)
    eye, depth, x, y = rays.eye, met.depth, met.below[0].reshape(-1), met.below[1].reshape(-1)
    count = 0
    for k in range(len(depth)):
        t = -eye[2] / (1e-12 if up[k] == 0.0 else up[k])
        hit = (t > 0.0) & (t < FARTHEST)
        u, v = (eye[0] + t * over[k]) / FLOOR_M, (eye[1] + t * along[k]) / FLOOR_M
        depth[k] = t if hit else np.inf
        x[k] = np.float32((u - math.floor(u)) * texels) if hit else OUTSIDE
        y[k] = np.float32((v - math.floor(v)) * texels) if hit else OUTSIDE
        count += hit
    return count


@compiled("Rays Part i1 i0 Met", allocates=False, **TUPLES)
def meet_face(rays: Rays, part: Part, window: NDArray[np.int64], texels: int, met: Met) -> int:
    """How many rays meet a face before all else; sets which ones, and where, and how far away.

    window: first row of the finer image, last, first column and last in which any may.
    """
    u, v, n = part.axes[0], part.axes[1], part.axes[2]
    low, high, eye, depth, below = part.low, part.high, rays.eye, met.depth, met.below[0].reshape(-1)
    x, y = met.places[0].reshape(-1), met.places[1].reshape(-1)
    count, height, width = 0, rays.directions.shape[1], rays.directions.shape[2]
    for row in range(max(window[0] - rays.top, 0), min(window[1] - rays.top, height)):
        for column in range(max(window[2], 0), min(window[3], width)):
            across = rays.directions[n, row, column]
            t = (part.at - eye[n]) / (1e-12 if across == 0.0 else across)
            k = row * width + column
            pu = eye[u] + t * rays.directions[u, row, column]
            pv = eye[v] + t * rays.directions[v, row, column]
            within = (pu >= low[u]) & (pu <= high[u]) & (pv >= low[v]) & (pv <= high[v])
            if (t > 0.0) & (t < depth[k]) & within:
                pu, pv = (pu - low[u]) / FACE_M, (pv - low[v]) / FACE_M
                depth[k], below[k], met.which[count] = t, OUTSIDE, k
                x[count] = np.float32((pu - math.floor(pu)) * texels)
                y[count] = np.float32((pv - math.floor(pv)) * texels)
                count += 1
    return count


@dataclass
class Face:
    """A side of a box, seen from one side only, whose texture is made when it is first seen."""

    side: int
    part: Part
    octaves: list[Array]
    colour: Array

    @cached_property
    def texture(self) -> Any:
        """Texture (n, n, 4), BGR and a channel that is not used."""
        return _with_fourth(texture(self.octaves, self.colour, 7))


@dataclass
class Scene:
    """Axis-aligned boxes, given by corners (8, 3) in m, on a floor; each face has its own texture and brightness."""

    boxes: list[Array]
    seed: int = 0

    def __post_init__(self) -> None:
        rng = np.random.default_rng(self.seed)
        self.floor = texture(waves(rng, scale=16), (95.0, 105.0, 110.0), 14)
        self.faces = []
        for corners in self.boxes:
            low, high = corners.min(axis=0), corners.max(axis=0)
            for axis in range(3):
                for side, at in ((-1, low), (1, high)):
                    if axis == 2 and side == -1:
                        continue
                    shade = {0: 0.75, 1: 0.9, 2: 1.15}[axis] * (1.0 if side > 0 else 0.85)
                    axes = np.array([*(a for a in range(3) if a != axis), axis])
                    colour = np.array((90, 130, 165)) * shade
                    self.faces.append(Face(side, Part(axes, float(at[axis]), low, high), waves(rng), colour))

    def render(
        self,
        cam_from_world: Pose,
        camera: Camera = CAMERA,
        noise_rng: np.random.Generator | None = None,
        supersample: int = 2,
    ) -> NDArray[np.uint8]:
        """BGR image (h, w, 3) uint8, with shot and read noise when a generator is given."""
        rays, turned = _rays(camera, supersample), cam_from_world.rotation.T
        eye, floor = np.array(cam_from_world.inverse().translation), _with_fourth(self.floor)
        towards = [face for face in self.faces if face.side * (eye[face.part.axes[2]] - face.part.at) > 0]
        faces = [(face, _window(face, cam_from_world, camera, supersample)) for face in towards]
        image = np.empty((camera.height, camera.width, 3), np.uint8)
        width = camera.width * supersample
        for first in range(0, camera.height, ROWS):
            part = image[first : first + ROWS]
            top, height = first * supersample, len(part) * supersample
            d = (turned @ rays[:, top * width : (top + height) * width]).reshape(3, height, width)
            full = cv2.cvtColor(_seen(Rays(d, eye, top), floor, faces), cv2.COLOR_BGRA2BGR)
            small = cv2.resize(full, (camera.width, len(part)), interpolation=cv2.INTER_AREA)
            part[:] = _exposed(small, noise_rng)
        return image


def _with_fourth(tex: NDArray[np.float32]) -> Any:
    """A texture with a fourth channel, which is not used: cv2.remap takes half as long for four as for three."""
    return cv2.cvtColor(tex, cv2.COLOR_BGR2BGRA)


def _exposed(small: Any, noise_rng: np.random.Generator | None) -> Any:
    """Grey levels, 0 to 255, to be cut to whole numbers, of float32 ones: with noise where a generator is given."""
    if noise_rng is None:
        return np.clip(small + np.float32(0.5), 0, 255)
    sigma = small * np.float32(0.06)
    sigma += np.float32(4.0)
    noisy = noise_rng.standard_normal(size=small.shape)
    noisy *= np.sqrt(sigma, out=sigma)
    noisy += small
    noisy += 0.5
    return np.clip(noisy, 0, 255, out=noisy)


def _seen(rays: Rays, floor: Any, faces: list[tuple[Face, NDArray[np.int64]]]) -> Any:
    """Colours (h, w, 4) that rays see of the floor and of faces, each in its window."""
    shape, n = rays.directions.shape[1:], rays.directions[0].size
    places = np.zeros((2, -(-n // WIDTH), WIDTH), np.float32)
    met = Met(np.empty(n), np.empty((2, *shape), np.float32), np.empty(n, np.int64), places)
    texels, on_faces = len(floor) - 1, []
    on_floor = meet_floor(rays, texels, met)
    for face, window in faces:
        if window[0] < rays.top + shape[0] and rays.top < window[1]:
            count = meet_face(rays, face.part, window, texels, met)
            if count:
                x, y = places[:, : -(-count // WIDTH)]
                colours = _whole(cv2.remap(face.texture, x, y, cv2.INTER_LINEAR))
                on_faces.append((met.which[:count].copy(), colours[:count]))
    if on_floor:
        x, y = met.below
        full = cv2.remap(floor, x, y, cv2.INTER_LINEAR, borderValue=SKY)
    else:
        full = np.full((*shape, 4), SKY, np.float32)
    for these, colours in on_faces:
        _whole(full)[these] = colours
    return full


def _whole(colours: Any) -> Any:
    """Colours (..., 4) as a vector of complex numbers, of the same four floats each, which NumPy moves as one."""
    return colours.reshape(-1).view(np.complex128)


@lru_cache(maxsize=32)
def _rays(camera: Camera, supersample: int) -> Array:
    """Rays (3, n) in the camera frame, z = 1, row by row through supersample² points of each pixel."""
    s = supersample
    x = (np.arange(camera.width * s) - (s - 1) / 2) / s
    y = (np.arange(camera.height * s) - (s - 1) / 2) / s
    return np.ascontiguousarray(camera.rays(np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)).T)


def _window(face: Face, cam_from_world: Pose, camera: Camera, supersample: int) -> NDArray[np.int64]:
    """First row, last, first column and last of the finer image that a face can be seen in.

    All of them where it is not before the camera.
    """
    (u, v, _), at, low, high = face.part
    corners = np.full((4, 3), at)
    corners[:, u], corners[:, v] = [low[u], low[u], high[u], high[u]], [low[v], high[v], low[v], high[v]]
    points = cam_from_world.transform(corners)
    if camera.distortion_model != "none" or points[:, 2].min() < 0.05:
        return np.array([0, camera.height * supersample, 0, camera.width * supersample])
    pixels = camera.project(points)
    first = np.floor((pixels.min(axis=0) - 1) * supersample)
    last = np.ceil((pixels.max(axis=0) + 2) * supersample)
    return np.array([first[1], last[1], first[0], last[0]]).astype(np.int64)


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
