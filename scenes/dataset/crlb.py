"""Cramer-Rao bound of the camera's pose from one image, frame by frame.

The irradiance of pixel i is y_i = f_i(xi) + n_i, with n_i independent, normal, and of variance s_i^2 by the sensor's
photon-transfer curve and quantization. For the twist xi of `cam_from_world_true = exp(xi) cam_from_world` an
unbiased estimate from this image alone has a covariance of at least (J^T S^-1 J)^-1, J = df/dxi (Kay 1993, eq. 3.31
without the term for the change of the variance). J is computed by central differences of noise-free renders, along six
independent directions in which the image moves equally far: along the axes of the twist, aliasing would be taken for
information on directions that hardly move the image, such as a rotation that compensates a translation.

Only pixels that show the structure or its outline are used, since the rest of the world is not in the model. The
appearance of the structure is assumed known: an edge-based tracker stays above the bound, and one that uses several
frames may go below it. Effects of the link and sharpening are left out, since they add no information, and so is
aliasing: J is that of the irradiance of a pixel, from renders at FINER times the resolution where there is no lens
blur.

    crlb.csv    frame, and the covariance's upper triangle by rows, translation first
"""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Self

import cv2
import numpy as np
from numpy.typing import NDArray

from uavbench.scenes.camera import Camera
from uavbench.scenes.dataset.ground_truth_files import BOUND_COLUMNS, UPPER
from uavbench.scenes.effects.exposure import MotionBlur, RollingShutter
from uavbench.scenes.effects.image_sensor import AutoExposure, FixedExposure, Noise, Quantization
from uavbench.scenes.effects.lens import LateralColour, Vignetting
from uavbench.scenes.effects.processing import ColourFilter
from uavbench.scenes.rendering.camera_simulator import CameraSimulator, View, ideal_camera, render_camera, sample
from uavbench.scenes.rendering.radiance import LIGHT, Radiance, decode, encode
from uavbench.scenes.rendering.renderer import Renderer
from uavbench.scenes.spec import EffectSpec
from uavbench.trajectories.files.writing import write_text
from uavbench.trajectories.pose import Array, Pose

FINER = 2
"""Rendered pixels along a pixel's side; coarser sampling would alias edges, which would be taken for information."""
STEP_PX = 0.15
"""Step of the central differences: rms image motion of the structure, px. It understates a step edge by 1/10."""
MOST_PX = 10.0
"""Largest image motion by a single component of a twist, px, within which components cancel linearly."""
FLOW_EVERY = 4
"""Spacing of the pixels whose motion is evaluated."""
OUTLINE_PX = 2
"""Margin around the structure's pixels that belongs to its outline, px."""
SINGULAR = 1e-12
"""Ratio of smallest to largest eigenvalue of the information below which the pose counts as unobservable."""
LIGHT_STEP = np.gradient(LIGHT.astype(np.float64))
"""Quantization step of a finished image, as irradiance."""


class FrameBounds:
    """Computes the bound of any frame of a sequence from renders of its own; a context manager that owns a renderer."""

    def __init__(
        self,
        scene_renderer: Callable[[int, int], Renderer],
        camera: Camera,
        cam_from_world: Callable[[int], Pose],
        effects: tuple[EffectSpec, ...],
        blur_px: float = 0.0,
    ) -> None:
        self._times = 1 if blur_px else FINER
        self._camera, self._path, self._effects = finer(camera, self._times), cam_from_world, effects
        self._blur_px = blur_px
        margin_px = max((getattr(e, "margin_px", 0) for e in effects), default=0)
        self._pinhole, self._lens = render_camera(self._camera, margin_px)
        self._renderer = scene_renderer(self._pinhole.width, self._pinhole.height)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, value: BaseException | None, at: TracebackType | None) -> None:
        self._renderer.close()

    def covariance(self, image: NDArray[np.uint8], stamp_ns: int) -> Array | None:
        """Bound (6, 6) of a frame by its image and stamp, m and rad; None where the pose is unobservable."""
        clean = self._light(np.zeros(6), stamp_ns)
        source = self._source(np.zeros(6))
        view = source.render(stamp_ns)
        shown = _structure(source, view.instances, self._times)
        if not shown.any():
            return None
        steps = directions(view, self._pinhole, STEP_PX * self._times)
        if steps is None:
            return None
        gain = _gain(clean, image) if any(isinstance(e, AutoExposure) for e in self._effects) else 1.0
        weight = shown[..., None] / light_variance(gain * clean, self._effects)
        along = bound(information(jacobian(lambda xi: gain * self._light(xi, stamp_ns), steps), weight))
        return None if along is None else np.asarray(steps.T @ along @ steps)

    def _light(self, twist: Array, stamp_ns: int) -> Radiance:
        """Irradiance of each pixel of the camera moved by a twist."""
        light = self._source(twist).image(stamp_ns)
        assert light is not None
        return _averaged(light, self._times)

    def _source(self, twist: Array) -> CameraSimulator:
        """Simulator of the camera moved by a twist; one for each twist, since simulators cache views."""
        moved = Pose.exp(twist)
        source = ideal_camera(
            self._renderer,
            self._camera,
            self._pinhole,
            self._lens,
            lambda stamp_ns: moved @ self._path(stamp_ns),
            self._blur_px,
        )
        for kind in (RollingShutter, MotionBlur, LateralColour, Vignetting, FixedExposure):
            for effect in self._effects:
                if type(effect) is kind:
                    fine = effect.at_resolution(self._times) if isinstance(effect, LateralColour) else effect
                    source = fine.start(source, np.random.default_rng(0))
        return source


def finer(camera: Camera, times: int) -> Camera:
    """The camera with times x times pixels in place of each."""
    cx, cy = (times * (c + 0.5) - 0.5 for c in (camera.cx, camera.cy))
    width, height = times * camera.width, times * camera.height
    return replace(camera, width=width, height=height, fx=times * camera.fx, fy=times * camera.fy, cx=cx, cy=cy)


def directions(view: View, pinhole: Camera, rms_px: float) -> Array | None:
    """Six independent twists (6, 6), by rows, each of which moves the visible structure by rms_px in the image.

    A twist that would exceed MOST_PX in one component is shorter. None where no direction is observable.
    """
    row, column = (FLOW_EVERY * k for k in np.nonzero(view.instances[::FLOW_EVERY, ::FLOW_EVERY] == 1))
    if len(row) < 6:
        row, column = np.nonzero(view.instances == 1)
    z = view.depth[row, column].astype(np.float64)
    x, y = (column - pinhole.cx) / pinhole.fx, (row - pinhole.cy) / pinhole.fy
    zero, one = np.zeros_like(z), np.ones_like(z)
    du = pinhole.fx * np.column_stack([one / z, zero, -x / z, -x * y, one + x * x, -y])
    dv = pinhole.fy * np.column_stack([zero, one / z, -y / z, -one - y * y, x * y, x])
    flow = np.concatenate([du, dv]) / np.sqrt(len(z))
    scale = np.linalg.norm(flow, axis=0)
    _, motion, axes = np.linalg.svd(flow / np.maximum(scale, 1e-300), full_matrices=False)
    if len(motion) < 6 or not motion[-1] > SINGULAR * motion[0]:
        return None
    return np.asarray(np.minimum(rms_px / motion, MOST_PX)[:, None] * axes / scale)


def light_variance(clean: Radiance, effects: tuple[EffectSpec, ...]) -> Array:
    """Variance (h, w, 3) of the measured radiance: EMVA 1288 noise and rounding; infinite where none is measured.

    That is where a pixel saturates, and in the colours that its colour filter blocks: those are interpolated from
    measured ones, which they add nothing to.
    """
    light = np.clip(clean.astype(np.float64), 0.0, 1.0)
    variance = np.square(LIGHT_STEP)[encode(clean)] / 12
    for effect in effects:
        if isinstance(effect, Noise):
            variance += light / effect.full_well_e + (effect.read_noise_e / effect.full_well_e) ** 2
        if isinstance(effect, Quantization):
            variance += 1 / (2**effect.bits - 1) ** 2 / 12
        if isinstance(effect, ColourFilter):
            variance[~effect.measured(*clean.shape[:2])] = np.inf
    variance[clean >= 1.0] = np.inf
    return variance


def jacobian(light: Callable[[Array], Radiance], steps: Array) -> list[Radiance]:
    """Change of an image (h, w, 3) with each step (k, 6) of a twist, by central differences."""
    return [(light(step) - light(-step)) / np.float32(2) for step in steps]


def information(J: list[Radiance], weight: Array) -> Array:
    """Fisher information (k, k) of an image with derivatives J, each pixel weighted by its inverse variance."""
    seen = weight > 0
    columns = np.array([derivative[seen] for derivative in J], dtype=np.float64)
    return np.asarray((columns * weight[seen]) @ columns.T)


def bound(information: Array) -> Array | None:
    """Inverse of a Fisher information in m and rad; None where it is singular."""
    scale = np.sqrt(np.diag(information))
    if not (scale > 0).all():
        return None
    values, vectors = np.linalg.eigh(information / np.outer(scale, scale))
    if values[0] <= SINGULAR * values[-1]:
        return None
    return np.asarray((vectors / values) @ vectors.T / np.outer(scale, scale))


def write_bounds(folder: Path, bounds: dict[int, Array]) -> None:
    """Write `crlb.csv`, a row for each frame that has a bound."""
    rows = [",".join(map(repr, [frame, *P[UPPER].tolist()])) for frame, P in bounds.items()]
    write_text(folder / "crlb.csv", "\n".join([",".join(["frame", *BOUND_COLUMNS]), *rows]) + "\n")


def _structure(source: CameraSimulator, instances: NDArray[np.uint8], times: int) -> NDArray[np.bool_]:
    """Pixels (h, w) of the camera that show the structure or its outline."""
    shown = (instances == 1).astype(np.float32)
    if source.lens is not None:
        shown = sample(shown, source.lens)
    around = np.ones((2 * OUTLINE_PX + 1, 2 * OUTLINE_PX + 1), dtype=np.uint8)
    return np.asarray(cv2.dilate((_averaged(shown, times) > 0).astype(np.uint8), around) > 0)


def _averaged(fine: NDArray[np.float32], times: int) -> NDArray[np.float32]:
    """Mean of the times x times fine pixels in each pixel."""
    size = fine.shape[1] // times, fine.shape[0] // times
    return np.asarray(cv2.resize(fine, size, interpolation=cv2.INTER_AREA), dtype=np.float32)


def _gain(clean: Radiance, image: NDArray[np.uint8]) -> np.float32:
    """Exposure gain of a delivered image against the scene's irradiance, by least squares over unsaturated pixels."""
    light = decode(image)
    good = light < LIGHT[250]
    return np.float32(np.dot(light[good], clean[good]) / max(float(np.dot(clean[good], clean[good])), 1e-12))
