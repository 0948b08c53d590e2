"""Effects of the camera's processing: colours of a colour filter array, and sharpening."""

from dataclasses import dataclass, replace
from typing import Annotated, Any, ClassVar, Literal

import cv2
import numpy as np
from annotated_types import Interval
from numpy.typing import NDArray

from uavbench.scenes.rendering.camera_simulator import CameraSimulator, on_codes
from uavbench.scenes.rendering.radiance import Radiance
from uavbench.trajectories.errors import refuse_idle

BLUE, GREEN, RED = range(3)
"""Channels of an image."""
CROSS = np.array([[0, 1, 0], [1, 4, 1], [0, 1, 0]], dtype=np.float32) / np.float32(4)
SQUARE = np.array([[1, 2, 1], [2, 4, 2], [1, 2, 1]], dtype=np.float32) / np.float32(4)
"""Bilinear interpolation of green, and of red or blue, whose other pixels are 0."""
GREEN_THERE = np.array(
    [[0, 0, -1, 0, 0], [0, 0, 2, 0, 0], [-1, 2, 4, 2, -1], [0, 0, 2, 0, 0], [0, 0, -1, 0, 0]], dtype=np.float32
)
BESIDE = np.array(
    [[0, 0, 0.5, 0, 0], [0, -1, 0, -1, 0], [-1, 4, 5, 4, -1], [0, -1, 0, -1, 0], [0, 0, 0.5, 0, 0]], dtype=np.float32
)
ACROSS = np.array(
    [[0, 0, -1.5, 0, 0], [0, 2, 0, 2, 0], [-1.5, 0, 6, 0, -1.5], [0, 2, 0, 2, 0], [0, 0, -1.5, 0, 0]], dtype=np.float32
)
"""Eight times the coefficients of Malvar, He & Cutler 2004, figure 2, for a mosaic: green where red or blue is
measured; red or blue where green is measured, between two of that colour on the row; red where blue is measured, and
blue where red is."""


@dataclass(frozen=True)
class ColourFilter:
    """Colour filter array (Bayer 1976, US 3,971,065): a pixel measures one colour; two are interpolated (demosaicing).

    pattern names the colours of the first two pixels of the first row, then of the second. demosaicing is bilinear, or
    gradient-corrected: the linear 5x5 filters of Malvar, He & Cutler 2004, "High-quality linear interpolation for
    demosaicing of Bayer-patterned color images". Pixels saturate at 1 before. Colours are those of a white-balanced
    camera without crosstalk between its filters.
    """

    pattern: Literal["RGGB", "BGGR", "GRBG", "GBRG"] = "RGGB"
    demosaicing: Literal["bilinear", "gradient-corrected"] = "bilinear"
    only_one: ClassVar[bool] = True

    def measured(self, height: int, width: int) -> NDArray[np.bool_]:
        """Whether each channel (h, w, 3) BGR of a pixel is measured: one of the three is."""
        colours = np.array(["BGR".index(colour) for colour in self.pattern]).reshape(2, 2)
        rows, columns = np.arange(height)[:, None] % 2, np.arange(width)[None] % 2
        return np.asarray(colours[rows, columns][..., None] == np.arange(3))

    def start(self, source: CameraSimulator, rng: np.random.Generator) -> CameraSimulator:
        """CameraSimulator whose pixels measure one colour each; the generator is not used."""
        measured = self.measured(source.camera.height, source.camera.width)
        interpolated = _bilinear if self.demosaicing == "bilinear" else _gradient_corrected

        def image(stamp_ns: int) -> Radiance | None:
            light = source.image(stamp_ns)
            if light is None:
                return None
            kept = np.where(measured, np.minimum(light, np.float32(1)), np.float32(0))
            return np.where(measured, kept, interpolated(kept, measured))

        return replace(source, image=image)


def _filtered(image: NDArray[np.float32], kernel: NDArray[np.floating[Any]]) -> NDArray[np.float32]:
    """The image under a kernel; mirrored about its outermost pixels, beyond which the mosaic so goes on."""
    return np.asarray(cv2.filter2D(image, cv2.CV_32F, kernel, borderType=cv2.BORDER_REFLECT_101))


def _bilinear(kept: Radiance, measured: NDArray[np.bool_]) -> Radiance:
    """Mean (h, w, 3) of the nearest pixels that measure a colour; kept is 0 where a colour is not measured."""
    kernels = {BLUE: SQUARE, GREEN: CROSS, RED: SQUARE}
    planes = [_filtered(np.ascontiguousarray(kept[..., channel]), kernel) for channel, kernel in kernels.items()]
    return np.stack(planes, axis=-1)


def _gradient_corrected(kept: Radiance, measured: NDArray[np.bool_]) -> Radiance:
    """Colours (h, w, 3) of a mosaic by Malvar, He & Cutler 2004; kept is 0 where a colour is not measured."""
    mosaic = kept.sum(axis=2)
    on_row, on_column, across = (_filtered(mosaic, kernel / 8) for kernel in (BESIDE, BESIDE.T, ACROSS))
    out = np.empty_like(kept)
    out[..., GREEN] = _filtered(mosaic, GREEN_THERE / 8)
    for channel, other in ((RED, BLUE), (BLUE, RED)):
        rows = measured[..., channel].any(axis=1, keepdims=True)
        out[..., channel] = np.where(measured[..., other], across, np.where(rows, on_row, on_column))
    return out


@dataclass(frozen=True)
class Sharpening:
    """Unsharp masking of a camera's processing: 8-bit codes plus `amount` times their difference from a blurred image.

    radius_px is the standard deviation of the Gaussian blur. Each colour is sharpened for itself, as in Gonzalez &
    Woods, Digital Image Processing, section on unsharp masking; codes are rounded and clipped.
    """

    amount: Annotated[float, Interval(ge=0, le=3)] = 0.8
    radius_px: Annotated[float, Interval(ge=0.3, le=3)] = 1.0

    def __post_init__(self) -> None:
        refuse_idle(self, {"radius_px": ("amount",)})

    def start(self, source: CameraSimulator, rng: np.random.Generator) -> CameraSimulator:
        """CameraSimulator whose images are sharpened; the generator is not used."""
        return on_codes(source, self._sharpened) if self.amount else source

    def _sharpened(self, codes: NDArray[np.uint8]) -> NDArray[np.uint8]:
        fine = codes.astype(np.float32)
        blurred = cv2.GaussianBlur(fine, (0, 0), self.radius_px, borderType=cv2.BORDER_REPLICATE)
        sharp = fine + np.float32(self.amount) * (fine - blurred)
        return np.clip(np.rint(sharp), 0, 255).astype(np.uint8)
