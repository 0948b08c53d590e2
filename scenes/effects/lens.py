"""Effects of the lens: lateral chromatic aberration and vignetting."""

from dataclasses import dataclass, replace
from typing import Annotated, ClassVar

import numpy as np
from annotated_types import Interval
from numpy.typing import NDArray

from uavbench.scenes.camera import Camera
from uavbench.scenes.rendering.camera_simulator import CameraSimulator, pixel_grid
from uavbench.scenes.rendering.radiance import Radiance

BLUE, RED = 0, 2
STRETCHED = 4
"""Pixels of the pinhole that a pixel at the border of a lens may cover: those of a fisheye at 60 degrees."""


@dataclass(frozen=True)
class LateralColour:
    """Lateral chromatic aberration of the lens: its magnification differs between red, green and blue light.

    red_px and blue_px are the displacements of the red and the blue image outwards from the green one, at the corner
    farthest from the principal point, and in proportion to the distance from it (the first term of the model of Kang
    2007, "Automatic removal of chromatic aberration from a single image"). A few tenths of a pixel are typical of small
    lenses. Ground truth is that of green.
    """

    red_px: Annotated[float, Interval(ge=-5, le=5)] = 0.3
    blue_px: Annotated[float, Interval(ge=-5, le=5)] = -0.2
    only_one: ClassVar[bool] = True

    @property
    def margin_px(self) -> int:
        """Pixels that are rendered beyond each side of the image, for what is displaced inwards."""
        inwards = max(-self.red_px, -self.blue_px, 0.0)
        return int(np.ceil(STRETCHED * inwards)) + 1 if inwards else 0

    def at_resolution(self, times: float) -> "LateralColour":
        """The same lens before a sensor with `times` as many pixels along a side."""
        return replace(self, red_px=times * self.red_px, blue_px=times * self.blue_px)

    def start(self, source: CameraSimulator, rng: np.random.Generator) -> CameraSimulator:
        """CameraSimulator whose red and blue images are magnified; the generator is not used."""
        camera = source.camera
        scales = {RED: _scale(camera, self.red_px), BLUE: _scale(camera, self.blue_px)}
        beyond = max(_beyond(camera, scale) for scale in scales.values())
        wide = source.wider(beyond) if beyond else source
        inside = slice(beyond, beyond + camera.height), slice(beyond, beyond + camera.width)

        def image(stamp_ns: int) -> Radiance | None:
            seen = wide.image(stamp_ns)
            if seen is None:
                return None
            out = seen[inside].copy()
            for channel, scale in scales.items():
                out[..., channel] = _magnified(seen[..., channel], camera, scale, beyond)
            return out

        return replace(source, image=image)


def _scale(camera: Camera, outwards_px: float) -> float:
    """Magnification about the principal point that displaces the farthest corner by so many px."""
    across, down = (max(centre, side - 1 - centre) for centre, side in _axes(camera))
    return 1 + outwards_px / float(np.hypot(across, down))


def _beyond(camera: Camera, scale: float) -> int:
    """Pixels beyond the sides of an image that its magnification shows."""
    farthest = max(max(centre, side - 1 - centre) for centre, side in _axes(camera))
    return int(np.ceil(max(farthest * (1 / scale - 1), 0.0)))


def _axes(camera: Camera) -> list[tuple[float, int]]:
    return [(camera.cx, camera.width), (camera.cy, camera.height)]


def _magnified(seen: NDArray[np.float32], camera: Camera, scale: float, beyond: int) -> NDArray[np.float32]:
    """One colour (h, w) of an image (h + 2 beyond, w + 2 beyond), magnified about the principal point.

    Interpolated linearly at exact places; those of cv2.remap are multiples of 1/32 px.
    """
    for axis, (centre, side) in enumerate(reversed(_axes(camera))):
        place = centre + (np.arange(side) - centre) / scale + beyond
        first = np.clip(np.floor(place).astype(int), 0, seen.shape[axis] - 2)
        share = (place - first).astype(np.float32)
        share = share[:, None] if axis == 0 else share
        low, high = (np.take(seen, first + k, axis=axis) for k in (0, 1))
        seen = low + share * (high - low)
    return seen


@dataclass(frozen=True)
class Vignetting:
    """Vignetting by the cos^4 law of the angle of incidence; strength 0 is none, 1 the full law."""

    strength: Annotated[float, Interval(ge=0, le=1)] = 1.0

    def start(self, source: CameraSimulator, rng: np.random.Generator) -> CameraSimulator:
        """CameraSimulator whose irradiance falls off with the angle of incidence; the generator is not used."""
        camera = source.camera
        rays = camera.rays(pixel_grid(camera.width, camera.height).reshape(-1, 2).astype(np.float64))
        slant = np.square(rays[:, :2]).sum(axis=1)
        share = 1 - self.strength * (1 - 1 / np.square(1 + slant))
        falloff = share.reshape(camera.height, camera.width, 1).astype(np.float32)

        def image(stamp_ns: int) -> Radiance | None:
            even = source.image(stamp_ns)
            return None if even is None else even * falloff

        return replace(source, image=image)
