"""Every effect, in the order of nature: shutter, lens, sensor, link."""

from scenes.exposure import MotionBlur, RollingShutter
from scenes.link import AnalogLink, Drops, Jpeg
from scenes.sensor import AutoExposure, Noise, Quantization, Vignetting

EFFECTS: dict[str, type] = {
    "rolling-shutter": RollingShutter,
    "motion-blur": MotionBlur,
    "vignetting": Vignetting,
    "auto-exposure": AutoExposure,
    "noise": Noise,
    "quantization": Quantization,
    "jpeg": Jpeg,
    "analog-link": AnalogLink,
    "drops": Drops,
}
