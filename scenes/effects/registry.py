"""Registry of effects by kind, in physical order: shutter, lens, sensor, link."""

from uavbench.scenes.effects.exposure import MotionBlur, RollingShutter
from uavbench.scenes.effects.image_sensor import AutoExposure, Noise, Quantization, Vignetting
from uavbench.scenes.effects.link import AnalogLink, Drops, Jpeg

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
