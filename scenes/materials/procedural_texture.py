"""Seeded, tileable noise images, and operations on images, for procedural materials."""

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from uavbench.scenes.rendering import pixel_kernels as kernels

Image = NDArray[np.float32]
BLUR_REACH = 4.5
"""Standard deviations of a blur beyond which no pixel counts: OpenCV's kernel ends at 4 of them, rounded up."""


class Octave(NamedTuple):
    """One octave of noise: its amplitude, and the size of its features upwards and across, px."""

    amplitude: float
    high_px: float
    wide_px: float


CUT_OFF = 1.05
"""Cycles per feature size above which the power spectrum is below 2e-5 of its maximum."""


def tiling(shape: tuple[int, int], size_px: float | tuple[float, float], rng: np.random.Generator) -> Image:
    """Tileable smooth noise (h, w) of zero mean and unit standard deviation.

    size_px is the feature size, isotropic or (along y, along x).
    """
    sizes = (float(size_px), float(size_px)) if isinstance(size_px, int | float) else size_px
    return layered(shape, [Octave(1.0, *sizes)], rng)


def fractal(
    shape: tuple[int, int],
    largest_px: float,
    rng: np.random.Generator,
    octaves: int = 5,
    gain: float = 0.6,
) -> Image:
    """Tileable fractal noise (h, w) of zero mean and unit standard deviation.

    The first octave has features of largest_px; each further one has half the feature size and `gain` times the
    amplitude of the one before.
    """
    sizes = [largest_px / 2**octave for octave in range(octaves)]
    return layered(shape, [Octave(gain**k, size, size) for k, size in enumerate(sizes)], rng)


def layered(shape: tuple[int, int], octaves: Sequence[Octave], rng: np.random.Generator) -> Image:
    """Tileable Gaussian noise (h, w) whose power spectrum is the sum of its octaves, of zero mean and unit deviation.

    Features of half the height of the tile, or more, are streaks from its lower to its upper side. Synthesized in the
    frequency domain, up to the cut-off of the finest octave.
    """
    (h, w), (_, finest_y, finest_x) = shape, octaves[-1]
    rows, columns = (min(n // 2, int(np.ceil(CUT_OFF * n / size))) for n, size in ((h, finest_y), (w, finest_x)))
    ky = np.concatenate([np.arange(rows + 1), np.arange(-rows, 0)]) if rows else np.zeros(1, dtype=np.int64)
    kx = np.arange(columns + 1)
    power = np.zeros((len(ky), len(kx)), dtype=np.float32)
    for height, sy, sx in octaves:
        one = np.multiply.outer(
            *(np.exp(-np.square(np.pi * k / n * s)).astype(np.float32) for k, n, s in ((ky, h, sy), (kx, w, sx)))
        )
        one[0, 0] = 0
        power += np.float32(height**2 / max(float(one.sum()), 1e-12)) * one
    half = rng.standard_normal((len(ky), len(kx), 2), dtype=np.float32).view(np.complex64)[..., 0] * np.sqrt(power)
    half[:, 0] *= np.float32(np.sqrt(2))  # the inverse transform keeps the real part of this column only
    spectrum = np.zeros((h, len(kx)), dtype=np.complex64)
    spectrum[ky] = half
    import scipy.fft  # lazy: it takes 1/8 s, and every command imports this module

    noise: Image = scipy.fft.irfft(scipy.fft.ifft(spectrum, axis=0, overwrite_x=True), n=w, axis=1)
    noise *= np.float32(1 / max(float(cv2.meanStdDev(noise)[1].item()), 1e-12))
    return noise


def paint(color: tuple[float, float, float], shade: Image) -> Image:
    """Image (h, w, 3): an sRGB colour (0..255) times a shade (h, w)."""
    out = np.empty((*shade.shape, 3), dtype=np.float32)
    kernels.tint(np.asarray(color, dtype=np.float32), np.ascontiguousarray(shade, dtype=np.float32), out)
    return out


def blend(under: Image, over: Image | tuple[float, float, float], mask: Image) -> Image:
    """Alpha blending (h, w, 3) of `over`, an image or a colour, onto `under` with the mask (h, w) in 0..1."""
    layer, share = np.asarray(over, dtype=np.float32), np.asarray(mask, dtype=np.float32)
    out = np.empty(under.shape, dtype=np.float32)
    if layer.ndim == 1:
        kernels.lay_color(under, layer, np.broadcast_to(share, under.shape[:2]), out)
    else:
        kernels.lay(under, layer, np.broadcast_to(share, under.shape[:2]), out)
    return out


def blurred(image: Image, sigma_px: float) -> Image:
    """The image after a Gaussian blur of standard deviation sigma_px."""
    return np.asarray(cv2.GaussianBlur(image, (0, 0), sigma_px), dtype=np.float32)


def blurred_tile(tile: Image, sigma_px: float) -> Image:
    """The tile after a Gaussian blur of standard deviation sigma_px, which goes on beyond its sides: it has no seam."""
    margin = int(np.ceil(BLUR_REACH * sigma_px))
    wide = cv2.copyMakeBorder(tile, margin, margin, margin, margin, cv2.BORDER_WRAP)
    return np.ascontiguousarray(blurred(np.asarray(wide), sigma_px)[margin:-margin, margin:-margin])


def finish(image: Image) -> NDArray[np.uint8]:
    """The image rounded and clipped to 8 bits."""
    out = np.empty(image.shape, dtype=np.uint8)
    kernels.round_off(np.ascontiguousarray(image).reshape(-1), out.reshape(-1))
    return out
