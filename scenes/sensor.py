"""Effects of the sensor: noise and its steps."""

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from annotated_types import Ge, Gt, Interval
from scipy.special import ndtri

from scenes.kernels import add_noise
from scenes.light import Radiance
from scenes.source import Source

QUANTILES = ndtri((np.arange(65536) + 0.5) / 65536).astype(np.float32)
"""Normal quantiles: 16 random bits choose one."""


@dataclass(frozen=True)
class Noise:
    """Shot and read noise (EMVA 1288): the variance in electrons is signal + read_noise_e ** 2.

    full_well_e electrons saturate a pixel; small sensors of micro-drones hold 5000 to 10000 and read with 5 to 10.
    Shot noise is drawn from the normal distribution that the Poisson distribution tends to.
    """

    full_well_e: Annotated[float, Gt(0)] = 6000.0
    read_noise_e: Annotated[float, Ge(0)] = 8.0

    def start(self, source: Source, rng: np.random.Generator) -> Source:
        """Source whose images have independent noise in every pixel, channel and frame."""

        def image(stamp_ns: int) -> Radiance | None:
            clean = source.image(stamp_ns)
            key = np.uint64(rng.integers(0, 2**64, dtype=np.uint64))
            if clean is None:
                return None
            out = np.empty_like(clean)
            floor = (self.read_noise_e / self.full_well_e) ** 2
            add_noise(clean.reshape(-1), 1 / self.full_well_e, floor, key, QUANTILES, out.reshape(-1))
            return out

        return replace(source, image=image)


@dataclass(frozen=True)
class Quantization:
    """The converter knows 2 ** bits levels of linear light."""

    bits: Annotated[int, Interval(ge=1, le=16)] = 10

    def start(self, source: Source, rng: np.random.Generator) -> Source:
        """Source whose images have only these levels."""
        top = np.float32(2**self.bits - 1)

        def image(stamp_ns: int) -> Radiance | None:
            fine = source.image(stamp_ns)
            return None if fine is None else np.rint(np.clip(fine, 0, 1) * top) / top

        return replace(source, image=image)
