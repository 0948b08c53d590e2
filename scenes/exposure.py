"""Effects of the shutter: how long it is open."""

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from annotated_types import Gt, Interval

from scenes.light import Radiance
from scenes.source import Source


@dataclass(frozen=True)
class MotionBlur:
    """The light of a frame is gathered over its exposure, whose middle is the frame's stamp."""

    exposure_ms: Annotated[float, Gt(0), Interval(le=1000)] = 8.0

    def start(self, source: Source, rng: np.random.Generator) -> Source:
        """Source whose images are gathered over the exposure."""
        half_ns = round(self.exposure_ms * 5e5)

        def image(stamp_ns: int) -> Radiance:
            return source.expose(stamp_ns - half_ns, stamp_ns + half_ns)

        return replace(source, image=image)
