"""Seeded noise images that tile: the grain of every painted surface."""

import cv2
import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.float32]


def tiling(shape: tuple[int, int], size_px: float | tuple[float, float], rng: np.random.Generator) -> Image:
    """Smooth noise (h, w) of zero mean and unit deviation that tiles; features of size_px (along y, along x)."""
    sy, sx = (size_px, size_px) if isinstance(size_px, int | float) else size_px
    h, w = shape
    spectrum = np.fft.rfft2(rng.standard_normal(shape, dtype=np.float32))
    fy, fx = np.fft.fftfreq(h)[:, None], np.fft.rfftfreq(w)[None]
    spectrum *= np.exp(-2 * np.square(np.pi) * (np.square(fy * sy / 2) + np.square(fx * sx / 2)))
    spectrum[0, 0] = 0
    noise = np.fft.irfft2(spectrum, s=shape)
    return (noise / max(float(noise.std()), 1e-12)).astype(np.float32)


def fractal(
    shape: tuple[int, int],
    largest_px: float,
    rng: np.random.Generator,
    octaves: int = 5,
    gain: float = 0.6,
    stretch: tuple[float, float] = (1.0, 1.0),
) -> Image:
    """Sum of tiling noises, each octave half the size and `gain` the height of the one before; unit deviation."""
    total = np.zeros(shape, dtype=np.float32)
    for octave in range(octaves):
        size = largest_px / 2**octave
        total += gain**octave * tiling(shape, (size * stretch[0], size * stretch[1]), rng)
    return total / max(float(total.std()), 1e-12)


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
