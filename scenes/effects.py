"""Every effect, in the order of nature: shutter, then sensor, then link."""

from scenes.exposure import MotionBlur
from scenes.sensor import Noise, Quantization

EFFECTS: dict[str, type] = {
    "motion-blur": MotionBlur,
    "noise": Noise,
    "quantization": Quantization,
}
