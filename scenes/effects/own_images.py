"""Checks of the images of users' effects: they are linear light in the camera's size, and the same in each run.

No file tells this later.
"""

from collections.abc import Callable
from copy import copy, deepcopy
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np

from uavbench.scenes.rendering.camera_simulator import CameraSimulator
from uavbench.scenes.rendering.radiance import Radiance
from uavbench.trajectories.errors import UserError

FRAMES_MADE_TWICE = 3
"""First frames that are made a second time: an effect that keeps state shows it from the second one on."""
MOST_MEDIAN = 16.0
"""Largest median of a frame in parts of white: four stops beyond it; grey levels of 0 to 255 have more."""
OF_THE_GROUND_TRUTH = ("camera", "pinhole", "lens", "cam_from_world")
"""Parts of a simulator from which the ground truth and the calibration follow, whatever an effect does."""
COMPARED = ("camera", "pinhole")
"""Those of them that are compared by their values."""
LEAST_MEDIAN = -0.1
"""Smallest one: noise about black, or a black level that is taken off, leaves a dark frame slightly below 0."""


@dataclass(eq=False)
class Seen:
    """Images that users' effects gave for one frame, with the names of the effects, in order; kept only while asked."""

    asked: bool = True
    images: list[tuple[str, Radiance | None]] = field(default_factory=list)

    def add(self, name: str, image: Radiance | None) -> None:
        """Keep a copy of an image of the effect of a name."""
        if self.asked:
            self.images.append((name, None if image is None else image.copy()))


def same_twice(start: Callable[[Seen], CameraSimulator]) -> CameraSimulator:
    """The simulator that `start` makes of a user's effects, whose first frames are made a second time, apart.

    UserError naming the effect whose images then differ: its frames would be others in every run of one seed.
    """
    one, other = Seen(), Seen()
    source, again = start(one), start(other)
    left = FRAMES_MADE_TWICE

    def image(stamp_ns: int) -> Radiance | None:
        nonlocal left
        found = source.image(stamp_ns)
        if left:
            again.image(stamp_ns)
            _compare(one, other, stamp_ns)
            left -= 1
            one.asked = left > 0
        return found

    return replace(source, image=image)


def _compare(one: Seen, other: Seen, stamp_ns: int) -> None:
    for (name, image), (_, second) in zip(one.images, other.images, strict=False):
        if not (image is second is None or (image is not None and second is not None and _same(image, second))):
            raise UserError(
                f"effect {name}: at {stamp_ns / 1e9:.3f} s it gives another image each time; take all random numbers "
                "from the `rng` that start is given, and nothing from the clock or an earlier call"
            )
    one.images.clear()
    other.images.clear()


def _same(image: Radiance, second: Radiance) -> bool:
    return image.dtype == second.dtype and np.array_equal(image, second)


def own_copy(effect: Any) -> Any:
    """The effect with parameters of its own: what a start writes to them reaches no other camera and no other run."""
    own = copy(effect)
    for each in fields(effect):
        if each.init:
            object.__setattr__(own, each.name, deepcopy(getattr(effect, each.name)))
    return own


def checked(effect: object, source: CameraSimulator, camera: CameraSimulator, seen: Seen) -> CameraSimulator:
    """The simulator `source` that an effect made of `camera`; seen: gets its images.

    UserError for something else, for one of another camera or path than those of the ground truth, and for an image
    that cannot be one of a camera.
    """
    name = f"{type(effect).__module__}:{type(effect).__name__}"
    if not isinstance(source, CameraSimulator):
        raise UserError(f"effect {name}: start gives a {type(source).__name__}; it takes a CameraSimulator")
    for part in OF_THE_GROUND_TRUTH:
        given, known = getattr(source, part), getattr(camera, part)
        if given is not known and (part not in COMPARED or given != known):
            raise UserError(
                f"effect {name}: start gives a CameraSimulator of another {part}, and ground truth and camera.toml are "
                "those of the suite; replace its `image`, and set camera, mount and path in the suite"
            )
    shape = (camera.camera.height, camera.camera.width, 3)

    def image(stamp_ns: int) -> Radiance | None:
        found = source.image(stamp_ns)
        if found is not None and (why := _no_light(found, shape)):
            raise UserError(
                f"effect {name}: at {stamp_ns / 1e9:.3f} s its image {why}; an effect takes and gives linear light in "
                "floats, 1 is white, or None for a lost frame"
            )
        seen.add(name, found)
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
