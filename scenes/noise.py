"""Seeded noise images that tile: the grain of every painted surface."""

import cv2
import numpy as np
import scipy.fft
from numpy.typing import NDArray

Image = NDArray[np.float32]


def tiling(shape: tuple[int, int], size_px: float | tuple[float, float], rng: np.random.Generator) -> Image:
    """Smooth noise (h, w) of zero mean and unit deviation that tiles; features of size_px (along y, along x)."""
    sizes = (float(size_px), float(size_px)) if isinstance(size_px, int | float) else size_px
    return _shaped(shape, [(1.0, *sizes)], rng)


def fractal(
    shape: tuple[int, int],
    largest_px: float,
    rng: np.random.Generator,
    octaves: int = 5,
    gain: float = 0.6,
) -> Image:
    """Noise of several octaves, each half the size and `gain` the height of the one before; unit deviation, tiles."""
    sizes = [largest_px / 2**octave for octave in range(octaves)]
    return _shaped(shape, [(gain**k, size, size) for k, size in enumerate(sizes)], rng)


def _shaped(shape: tuple[int, int], octaves: list[tuple[float, float, float]], rng: np.random.Generator) -> Image:
    """Gaussian noise whose power is the sum of that of its octaves (height, size along y, along x)."""
    h, w = shape
    fy, fx = np.fft.fftfreq(h).astype(np.float32)[:, None], np.fft.rfftfreq(w).astype(np.float32)[None]
    power = np.zeros((h, w // 2 + 1), dtype=np.float32)
    for height, sy, sx in octaves:
        one = np.exp(-4 * np.square(np.pi) * np.square(fy * sy / 2)) * np.exp(
            -4 * np.square(np.pi) * np.square(fx * sx / 2)
        )
        one[0, 0] = 0
        power += (height**2 / max(float(one.mean()), 1e-12)) * one
    spectrum = scipy.fft.rfft2(rng.standard_normal(shape, dtype=np.float32)) * np.sqrt(power)
    noise = scipy.fft.irfft2(spectrum, s=shape)
    return np.asarray(noise / max(float(noise.std()), 1e-12), dtype=np.float32)


def paint(color: tuple[float, float, float], shade: Image) -> Image:
    """Image (h, w, 3): an sRGB colour (0..255) times a shade (h, w)."""
    return np.asarray(color, dtype=np.float32) * shade[..., None]


def blend(under: Image, over: Image | tuple[float, float, float], mask: Image) -> Image:
    """`over` laid on `under` where the mask (h, w) is 1."""
    layer = np.asarray(over, dtype=np.float32)
    return under + (layer - under) * mask[..., None]


def blurred(image: Image, sigma_px: float) -> Image:
    """Gaussian blur."""
    return np.asarray(cv2.GaussianBlur(image, (0, 0), sigma_px), dtype=np.float32)


def finish(image: Image) -> NDArray[np.uint8]:
    """The image as 8 bits."""
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)
