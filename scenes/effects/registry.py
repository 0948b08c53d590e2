"""Registry of effects by kind, in physical order: shutter, lens, sensor, processing, link."""

from uavbench.scenes.effects.exposure import MotionBlur, RollingShutter
from uavbench.scenes.effects.image_sensor import AutoExposure, FixedExposure, Noise, Quantization
from uavbench.scenes.effects.lens import LateralColour, Vignetting
from uavbench.scenes.effects.link import AnalogLink, Drops, Jpeg
from uavbench.scenes.effects.processing import ColourFilter, Sharpening

EFFECTS: dict[str, type] = {
    "rolling-shutter": RollingShutter,
    "motion-blur": MotionBlur,
    "lateral-colour": LateralColour,
    "vignetting": Vignetting,
    "exposure": FixedExposure,
    "auto-exposure": AutoExposure,
    "noise": Noise,
    "quantization": Quantization,
    "colour-filter": ColourFilter,
    "sharpening": Sharpening,
    "jpeg": Jpeg,
    "analog-link": AnalogLink,
    "drops": Drops,
}
