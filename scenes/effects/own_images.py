"""Checks of the images of users' effects: they are linear light in the camera's size, which no file tells later."""

from dataclasses import replace
from typing import Any

import numpy as np

from uavbench.scenes.rendering.camera_simulator import CameraSimulator
from uavbench.scenes.rendering.radiance import Radiance
from uavbench.trajectories.errors import UserError

MOST_MEDIAN = 16.0
"""Largest median of a frame in parts of white: four stops beyond it; grey levels of 0 to 255 have more."""
LEAST_MEDIAN = -0.1
"""Smallest one: noise about black, or a black level that is taken off, leaves a dark frame slightly below 0."""


def checked(effect: object, source: CameraSimulator, camera: CameraSimulator) -> CameraSimulator:
    """The simulator `source` that an effect made of `camera`.

    UserError for something else, and for an image that cannot be one of a camera.
    """
    name = f"{type(effect).__module__}:{type(effect).__name__}"
    if not isinstance(source, CameraSimulator):
        raise UserError(f"effect {name}: start gives a {type(source).__name__}; it takes a CameraSimulator")
    shape = (camera.camera.height, camera.camera.width, 3)

    def image(stamp_ns: int) -> Radiance | None:
        found = source.image(stamp_ns)
        if found is not None and (why := _no_light(found, shape)):
            raise UserError(
                f"effect {name}: at {stamp_ns / 1e9:.3f} s its image {why}; an effect takes and gives linear light in "
                "floats, 1 is white, or None for a lost frame"
            )
        return found

    return replace(source, image=image)


def _no_light(found: Any, shape: tuple[int, ...]) -> str:
    """Why an image is none of linear light; "" if it may be."""
    if not isinstance(found, np.ndarray) or not np.issubdtype(found.dtype, np.floating):
        return (
            f"is {f'of {found.dtype}' if isinstance(found, np.ndarray) else f'a {type(found).__name__}'}, not of floats"
        )
    if found.shape != shape:
        return f"has the shape {found.shape}, not {shape}"
    if not np.isfinite(found).all():
        return "holds numbers that are not finite"
    median = float(np.median(found))
    if not LEAST_MEDIAN <= median <= MOST_MEDIAN:
        return f"has the median {median:.3g}" + (", as if it were in grey levels" if median > 0 else ", below black")
    return ""
