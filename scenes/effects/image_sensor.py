"""Effects of the image sensor: fixed and auto exposure, noise and quantization."""

from dataclasses import dataclass, replace
from functools import cache
from typing import Annotated, ClassVar

import numpy as np
from annotated_types import Ge, Gt, Interval
from numpy.typing import NDArray

from uavbench.scenes.rendering.camera_simulator import CameraSimulator, Coded, Rendered
from uavbench.scenes.rendering.pixel_kernels import add_noise, code_noisy
from uavbench.scenes.rendering.radiance import CODES, Radiance


@cache
def quantiles() -> NDArray[np.float32]:
    """Quantiles (65536,) of the standard normal distribution, indexed by 16 random bits."""
    from scipy.special import ndtri  # lazy: it takes 0.2 s, and every command imports this module

    found: NDArray[np.float32] = ndtri((np.arange(65536) + 0.5) / 65536).astype(np.float32)
    return found


@dataclass(frozen=True)
class FixedExposure:
    """Fixed exposure: irradiance times 2 ** stops, by aperture, shutter or gain; what then exceeds 1 blows out."""

    stops: Annotated[float, Interval(ge=-8, le=8)] = 0.0
    only_one: ClassVar[bool] = True
    sets: ClassVar[str] = "exposure"

    def start(self, source: CameraSimulator, rng: np.random.Generator) -> CameraSimulator:
        """CameraSimulator with so many stops more irradiance; the generator is not used."""
        gain = np.float32(2**self.stops)

        def image(stamp_ns: int) -> Radiance | None:
            seen = source.image(stamp_ns)
            return None if seen is None else seen * gain

        return replace(source, image=image)


@dataclass(frozen=True)
class AutoExposure:
    """Auto exposure: a first-order control of the mean irradiance towards `target` (1: saturation).

    The gain of a frame follows from the frames before: its logarithm approaches that of the target gain with the time
    constant lag_s; the target gain is limited to 1 / reach .. reach. The first frame has its target gain.
    """

    target: Annotated[float, Gt(0), Interval(lt=1)] = 0.18
    lag_s: Annotated[float, Ge(0)] = 0.4
    reach: Annotated[float, Interval(ge=1, le=1000)] = 8.0
    sets: ClassVar[str] = "exposure"

    def start(self, source: CameraSimulator, rng: np.random.Generator) -> CameraSimulator:
        """CameraSimulator with auto exposure; the generator is not used."""
        state: dict[str, float] = {}

        def image(stamp_ns: int) -> Radiance | None:
            seen = source.image(stamp_ns)
            if seen is None:
                return None
            target_gain = float(np.clip(self.target / max(float(seen.mean()), 1e-6), 1 / self.reach, self.reach))
            gain = state.get("gain", target_gain)
            passed_s = max(stamp_ns - state.get("stamp_ns", stamp_ns), 0) * 1e-9  # a field may precede the last frame
            follow = 1 - np.exp(-passed_s / self.lag_s) if self.lag_s > 0 else 1.0
            gain *= (state.get("target_gain", target_gain) / gain) ** follow
            state.update(gain=gain, target_gain=target_gain, stamp_ns=stamp_ns)
            return seen * np.float32(gain)

        return replace(source, image=image)


@dataclass(frozen=True)
class Noise:
    """Shot and read noise (EMVA 1288): the variance in electrons is signal + read_noise_e ** 2.

    full_well_e electrons saturate a pixel. Typical for the small sensors of micro air vehicles are a full well of 5000
    to 10000 electrons and a read noise of 5 to 10. Shot noise is normal, the limit of the Poisson distribution.
    """

    full_well_e: Annotated[float, Gt(0)] = 6000.0
    read_noise_e: Annotated[float, Ge(0)] = 8.0

    def start(self, source: CameraSimulator, rng: np.random.Generator) -> CameraSimulator:
        """CameraSimulator with noise that is independent between pixels, channels and frames."""
        clear = source.image
        gain, floor = 1 / self.full_well_e, (self.read_noise_e / self.full_well_e) ** 2

        def image(stamp_ns: int) -> Radiance | None:
            light = clear(stamp_ns)
            key = np.uint64(rng.integers(0, 2**64, dtype=np.uint64))
            if light is None:
                return None
            clean = np.ascontiguousarray(light, dtype=np.float32)
            out = np.empty_like(clean)
            add_noise(clean.reshape(-1), gain, floor, key, quantiles(), out.reshape(-1))
            return out

        if not isinstance(clear, Rendered):
            return replace(source, image=image)
        rendered = clear.roots

        def codes(stamp_ns: int) -> NDArray[np.uint8]:
            roots = np.ascontiguousarray(rendered(stamp_ns))
            key = np.uint64(rng.integers(0, 2**64, dtype=np.uint64))
            out = np.empty_like(roots)
            code_noisy(roots.reshape(-1), gain, floor, key, quantiles(), CODES, out.reshape(-1))
            return out

        return replace(source, image=Coded(image, codes))


@dataclass(frozen=True)
class Quantization:
    """Analog-to-digital conversion to 2 ** bits levels of linear irradiance."""

    bits: Annotated[int, Interval(ge=1, le=16)] = 10

    def start(self, source: CameraSimulator, rng: np.random.Generator) -> CameraSimulator:
        """CameraSimulator with quantized images, clipped to 0..1; the generator is not used."""
        top = np.float32(2**self.bits - 1)

        def image(stamp_ns: int) -> Radiance | None:
            fine = source.image(stamp_ns)
            return None if fine is None else np.asarray(np.rint(np.clip(fine, 0, 1) * top) / top, dtype=np.float32)

        return replace(source, image=image)
