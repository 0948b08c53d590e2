"""Effects of the video link: compression, analog radio transmission, dropped and duplicated frames."""

from dataclasses import dataclass, replace
from typing import Annotated

import cv2
import numpy as np
from annotated_types import Interval
from numpy.typing import NDArray

from uavbench.scenes.rendering.camera_simulator import CameraSimulator, on_codes, sample
from uavbench.scenes.rendering.radiance import Radiance, decode, encode
from uavbench.trajectories.errors import refuse_idle

Codes = NDArray[np.uint8]


@dataclass(frozen=True)
class Jpeg:
    """JPEG compression of every frame, with OpenCV's quality of 1..100."""

    quality: Annotated[int, Interval(ge=1, le=100)] = 75

    def start(self, source: CameraSimulator, rng: np.random.Generator) -> CameraSimulator:
        """CameraSimulator whose images are encoded and decoded again; the generator is not used."""

        def compressed(codes: Codes) -> Codes:
            data = cv2.imencode(".jpg", codes, [cv2.IMWRITE_JPEG_QUALITY, self.quality])[1]
            return np.asarray(cv2.imdecode(data, cv2.IMREAD_COLOR), dtype=np.uint8)

        return on_codes(source, compressed)


@dataclass(frozen=True)
class AnalogLink:
    """Analog FPV video transmission in standard definition.

    jitter_px is the standard deviation of the start of each scan line; bursts_per_frame the mean number of noise bands
    of about burst_rows rows, dropouts_per_frame that of bands lost to noise; snow is the standard deviation of the
    noise everywhere, in grey levels; interlaced takes every other line from a field 1/60 s earlier; sharpness_px is the
    standard deviation of the Gaussian band limit along the lines.
    """

    jitter_px: Annotated[float, Interval(ge=0, le=50)] = 0.35
    bursts_per_frame: Annotated[float, Interval(ge=0, le=50)] = 0.4
    burst_rows: Annotated[float, Interval(ge=1, le=500)] = 10.0
    dropouts_per_frame: Annotated[float, Interval(ge=0, le=50)] = 0.04
    snow: Annotated[float, Interval(ge=0, le=128)] = 3.0
    sharpness_px: Annotated[float, Interval(ge=0, le=20)] = 0.7
    interlaced: bool = True

    def __post_init__(self) -> None:
        refuse_idle(self, {"burst_rows": ("bursts_per_frame", "dropouts_per_frame")})

    def start(self, source: CameraSimulator, rng: np.random.Generator) -> CameraSimulator:
        """CameraSimulator whose images pass the analog link."""

        def image(stamp_ns: int) -> Radiance | None:
            before = source.image(stamp_ns - round(1e9 / 60)) if self.interlaced else None
            now = source.image(stamp_ns)
            if now is None:
                return None
            if before is not None:
                now = now.copy()
                now[1::2] = before[1::2]
            return decode(self._transmitted(encode(now), rng))

        return replace(source, image=image)

    def _transmitted(self, codes: Codes, rng: np.random.Generator) -> Codes:
        h, w = codes.shape[:2]
        picture = codes.astype(np.float32)
        if self.sharpness_px > 0:
            picture = np.asarray(cv2.GaussianBlur(picture, (0, 0), self.sharpness_px, sigmaY=1e-3), dtype=np.float32)
        level = np.full(h, self.snow, dtype=np.float32)
        for _ in range(rng.poisson(self.bursts_per_frame)):
            level[_band(h, self.burst_rows, rng)] += float(rng.uniform(20, 60))
        lost = np.zeros(h, dtype=bool)
        for _ in range(rng.poisson(self.dropouts_per_frame)):
            lost[_band(h, 2 * self.burst_rows, rng)] = True
        shift = np.asarray(self.jitter_px * rng.standard_normal(h), dtype=np.float32)
        place = np.stack(np.meshgrid(np.arange(w, dtype=np.float32), np.arange(h, dtype=np.float32)), axis=-1)
        place[..., 0] += shift[:, None]
        picture = sample(picture, place)
        snow = rng.standard_normal((h, w, 1), dtype=np.float32)
        picture = picture + level[:, None, None] * snow
        picture[lost] = 90 + 60 * snow[lost]
        return np.clip(np.rint(picture), 0, 255).astype(np.uint8)


def _band(height: int, rows: float, rng: np.random.Generator) -> slice:
    start = int(rng.integers(height))
    return slice(start, start + 1 + int(rng.exponential(rows)))


@dataclass(frozen=True)
class Drops:
    """Dropped frames with probability `lost`; with probability `repeated` a frame is replaced by the one before.

    ValueError when both together exceed 1.
    """

    lost: Annotated[float, Interval(ge=0, lt=1)] = 0.02
    repeated: Annotated[float, Interval(ge=0, lt=1)] = 0.02

    def __post_init__(self) -> None:
        if self.lost + self.repeated > 1 + 1e-9:
            raise ValueError(
                f"lost {self.lost:g} and repeated {self.repeated:g} are together more than all frames; lower one"
            )

    def start(self, source: CameraSimulator, rng: np.random.Generator) -> CameraSimulator:
        """CameraSimulator that drops and duplicates frames; the first frame always arrives."""
        previous: list[Radiance] = []

        def image(stamp_ns: int) -> Radiance | None:
            draw = float(rng.random())
            fresh = source.image(stamp_ns)
            if previous and draw < self.lost:
                return None
            if previous and draw < self.lost + self.repeated:
                return previous[0]
            if fresh is not None:
                previous[:] = [fresh]
            return fresh

        return replace(source, image=image)
