"""The light that the codes of an image stand for."""

import numpy as np

from uavbench.scenes.camera import Camera
from uavbench.trajectories.pose import Array

CODES = np.arange(256) / 255


def light_of_codes(camera: Camera) -> Array:
    """Linear intensity (256,) of the codes of a camera, 0 to 1: what its pixels integrate."""
    if isinstance(camera.response, str):
        return CODES.copy() if camera.response == "linear" else srgb_light(CODES)
    return np.asarray(CODES ** float(camera.response))


def srgb_light(codes: Array) -> Array:
    """Linear intensity (n,) of sRGB codes (n,) in 0 to 1 (IEC 61966-2-1)."""
    return np.where(codes <= 0.04045, codes / 12.92, ((codes + 0.055) / 1.055) ** 2.4)
