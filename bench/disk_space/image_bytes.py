"""Bytes per pixel of PNG images that a camera, a JPEG or an analog link have changed, over those of clean images.

Measured on 4 frames each of two boxes indoors, a building and a bridge outdoors at 640x480, of two of them at 320x240,
with 25 chains of effects, and of one box and building with 21 chains of a camera's processing and exposure; told from
clean and noisy frames, bytes are within 8 % of those taken, of frames that 3 stops blow out within 30 %.
"""

import math
from collections.abc import Iterable

import numpy as np

from uavbench.scenes.effects.image_sensor import AutoExposure, FixedExposure, Noise
from uavbench.scenes.effects.link import AnalogLink, Jpeg
from uavbench.scenes.effects.processing import ColourFilter, Sharpening

GREY = 0.2
"""Irradiance of a pixel at which noise is taken, 1: saturation; of a mean scene without auto exposure."""
CODES_PER_IRRADIANCE = 255 * 1.055 / 2.4
"""Slope of the sRGB curve in grey levels (IEC 61966-2-1), times irradiance^(1 - 1/2.4)."""
NOISE_LEVELS = (0.06, 0.64, 1.70, 3.65, 7.08, 128.0)
NOISE_BYTES = (0.0, 0.88, 1.24, 1.587, 1.945, 3.0)
"""Bytes per pixel of noise alone, over its standard deviation in grey levels; 3 is that of an image without order."""
POWER = 3.0
"""Bytes of texture and of noise add up as sums of this power: noise hides what it is stronger than."""
EXPOSED = 0.957
"""Bytes of an image under auto exposure over those without, whose scenes are brighter."""
STOPS, STOP_TEXTURE = (-8.0, -2.0, 0.0, 1.5, 3.0, 6.0), (0.2, 0.8, 1.0, 1.11, 0.36, 0.05)
STOP_NOISE = (1.0, 1.0, 1.0, 0.93, 0.27, 0.02)
"""Bytes of texture and of noise over those of exposures at 0 stops: what blows out has none."""
FILTERED_TEXTURE = {"bilinear": 0.943, "gradient-corrected": 1.1}
FILTERED_NOISE = {"bilinear": 0.39, "gradient-corrected": 0.66}
"""Bytes of texture, and standard deviation of noise that takes as many bytes, after a colour filter, over before."""
SHARPENED, SHARPENED_COMPRESSED = 0.42, 0.16
"""Share of texture's bytes that sharpening adds, over the logarithm of what it multiplies the deviation of noise by."""
CLEAN, COMPRESSED = (0.5, 0.966, 1.034, 1.183, 1.316), (0.3, 0.752, 0.937, 1.13, 1.295)
"""Bytes per pixel of an image, and of the same after a JPEG of quality 75: smooth surfaces lose most."""
STEPS, STEP_BYTES = (0.02, 0.1, 0.5, 1.25, 5.0), (0.12, 0.08, 0.0, -0.115, -0.3)
"""Quantization steps of a JPEG over those of quality 50, and bytes per pixel more than at quality 75."""
OVER_STEP, SURVIVING = (0.3, 1.36, 3.4, 14.2, 17.0, 64.0), (0.1, 0.242, 0.375, 0.686, 0.714, 1.0)
"""Standard deviation of noise in grey levels over the step, and the share of its bytes that a JPEG leaves."""
BAND_LIMITED, NOISE_BAND_LIMITED = 0.935, 0.75
"""Bytes of an image after the band limit of an analog link, and standard deviation of noise after it, over before."""


def image_bytes(clean: float, noisy: float, effects: Iterable[object]) -> float:
    """Bytes per pixel of images with effects; clean: of those without, noisy: of those with noise of its defaults."""
    by_kind = {type(effect): effect for effect in effects}
    exposure, noise, jpeg, link = (by_kind.get(kind) for kind in (AutoExposure, Noise, Jpeg, AnalogLink))
    fixed, mosaic, sharpening = (by_kind.get(kind) for kind in (FixedExposure, ColourFilter, Sharpening))
    own = max(noisy**POWER - clean**POWER, 0.0) ** (1 / POWER) / _of_noise(_grey_levels(Noise(), GREY))
    texture, level, left = clean, 0.0, 1.0
    if isinstance(exposure, AutoExposure):
        texture *= EXPOSED
    stops = fixed.stops if isinstance(fixed, FixedExposure) else 0.0
    texture *= float(np.interp(stops, STOPS, STOP_TEXTURE))
    if isinstance(noise, Noise):
        level = _grey_levels(noise, min(GREY * 2**stops, 1.0))
        own *= float(np.interp(stops, STOPS, STOP_NOISE))
    if isinstance(mosaic, ColourFilter):
        texture *= FILTERED_TEXTURE[mosaic.demosaicing]
        level *= FILTERED_NOISE[mosaic.demosaicing]
    if isinstance(sharpening, Sharpening):
        louder = _sharpened_noise(sharpening)
        added = SHARPENED_COMPRESSED if isinstance(jpeg, Jpeg) else SHARPENED
        texture, level = (1 + added * math.log(louder)) * texture, louder * level
    if isinstance(jpeg, Jpeg):
        step = (200 - 2 * jpeg.quality) / 100 if jpeg.quality >= 50 else 50 / jpeg.quality  # IJG's scale of its tables
        texture = max(_over(texture, CLEAN, COMPRESSED) + _over_log(max(step, 0.01), STEPS, STEP_BYTES), 0.02)
        left = _over_log(level / max(step, 0.01), OVER_STEP, SURVIVING)
    if isinstance(link, AnalogLink):
        texture *= BAND_LIMITED if link.sharpness_px > 0 else 1.0
        level, left = math.hypot(link.snow, NOISE_BAND_LIMITED * left * level), 1.0
    grain = own * left * _of_noise(level)
    return float((texture**POWER + grain**POWER) ** (1 / POWER))


def _grey_levels(noise: Noise, irradiance: float) -> float:
    """Standard deviation of the noise of a pixel in grey levels."""
    electrons = math.sqrt(irradiance * noise.full_well_e + noise.read_noise_e**2)
    return float(CODES_PER_IRRADIANCE * irradiance ** (1 / 2.4 - 1) * electrons / noise.full_well_e)


def _sharpened_noise(sharpening: Sharpening) -> float:
    """Standard deviation of independent noise after sharpening, over before."""
    along = np.exp(-np.square(np.arange(-12, 13) / sharpening.radius_px) / 2)
    blur = np.outer(along, along) / along.sum() ** 2
    kernel = -sharpening.amount * blur
    kernel[12, 12] += 1 + sharpening.amount
    return float(np.sqrt(np.square(kernel).sum()))


def _of_noise(level: float) -> float:
    return _over_log(level, NOISE_LEVELS, NOISE_BYTES)


def _over_log(x: float, at: tuple[float, ...], values: tuple[float, ...]) -> float:
    return float(np.interp(math.log2(max(x, 1e-9)), np.log2(at), values))


def _over(x: float, at: tuple[float, ...], values: tuple[float, ...]) -> float:
    """Interpolated; beyond the last point parallel to the diagonal."""
    return float(np.interp(x, at, values)) + max(x - at[-1], 0.0)
