"""Checks of the images of users' effects: they are linear light in the camera's size, and the same in each run.

No file tells this later.
"""

from collections.abc import Callable
from copy import copy, deepcopy
from dataclasses import dataclass, field, fields, replace
from functools import partial
from typing import Any

import numpy as np

from uavbench.scenes.rendering.camera_simulator import CameraSimulator, View
from uavbench.scenes.rendering.radiance import Radiance
from uavbench.trajectories.errors import UserError

MOST_MEDIAN = 16.0
"""Largest median of a frame in parts of white: four stops beyond it; grey levels of 0 to 255 have more."""
OF_THE_GROUND_TRUTH = ("camera", "pinhole", "lens", "cam_from_world")
"""Parts of a simulator from which the ground truth and the calibration follow, whatever an effect does."""
COMPARED = ("camera", "pinhole")
"""Those of them that are compared by their values."""
OF_THE_SEED = (
    "take all random numbers from the `rng` that start is given, and nothing from the clock or an earlier call"
)
LEAST_MEDIAN = -0.1
"""Smallest one: noise about black, or a black level that is taken off, leaves a dark frame slightly below 0."""


Answer = Radiance | View | None


@dataclass(eq=False)
class Seen:
    """Images that users' effects gave for one frame, with the names of the effects, in order."""

    images: list[tuple[str, Radiance | None]] = field(default_factory=list)

    def add(self, name: str, image: Radiance | None) -> None:
        """Keep a copy of an image of the effect of a name."""
        self.images.append((name, None if image is None else image.copy()))


class Recorded:
    """A camera under users' effects: what it answers for a frame is kept, and given to those effects a second time.

    So a second pass renders nothing, and draws no random numbers of effects of ours.
    """

    def __init__(self, camera: CameraSimulator, effects: str) -> None:
        self._camera, self._effects, self._answers = camera, effects, dict[tuple[int | str, ...], list[Answer]]()

    def first(self) -> CameraSimulator:
        """The camera, whose answers are kept."""
        return self._asked(self._answer)

    def again(self) -> CameraSimulator:
        """A camera that gives the answers kept; UserError for a question that was not asked the first time."""
        return self._asked(self._kept)

    def forget(self) -> None:
        """Drop the answers of a frame."""
        self._answers.clear()

    def _asked(self, answer: Callable[..., Any]) -> CameraSimulator:
        render, expose, image = (partial(answer, name) for name in ("render", "expose", "image"))
        return replace(self._camera, render=render, expose=expose, image=image)

    def _answer(self, name: str, *times_ns: int) -> Answer:
        found: Answer = getattr(self._camera, name)(*times_ns)
        copied = found.copy() if isinstance(found, np.ndarray) else found  # an effect may write to its image
        self._answers.setdefault((name, *times_ns), []).append(copied)
        return found

    def _kept(self, name: str, *times_ns: int) -> Answer:
        kept = self._answers.get((name, *times_ns))
        if not kept:
            asked = " to ".join(f"{time_ns / 1e9:.3f}" for time_ns in times_ns)
            raise UserError(f"effect {self._effects}: it asks for another {name} each time, {asked} s; {OF_THE_SEED}")
        return kept.pop(0)


def same_twice(
    camera: CameraSimulator, effects: str, start: Callable[[CameraSimulator, Seen], CameraSimulator]
) -> CameraSimulator:
    """The simulator that `start` makes of a camera by a user's effects, each frame of which is made a second time.

    effects: their names, for messages.

    UserError naming the effect whose images then differ: its frames would be others in every run of one seed.
    """
    one, other, recorded = Seen(), Seen(), Recorded(camera, effects)
    source, again = start(recorded.first(), one), start(recorded.again(), other)

    def image(stamp_ns: int) -> Radiance | None:
        found = source.image(stamp_ns)
        again.image(stamp_ns)
        _compare(one, other, stamp_ns)
        recorded.forget()
        return found

    render = camera.render if isinstance(source.render, partial) else source.render
    return replace(source, image=image, render=render)


def _compare(one: Seen, other: Seen, stamp_ns: int) -> None:
    for (name, image), (_, second) in zip(one.images, other.images, strict=False):
        if not (image is second is None or (image is not None and second is not None and _same(image, second))):
            raise UserError(f"effect {name}: at {stamp_ns / 1e9:.3f} s it gives another image each time; {OF_THE_SEED}")
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


def name_of(effect: object) -> str:
    """The name of a user's effect in a suite."""
    return f"{type(effect).__module__}:{type(effect).__name__}"


def checked(effect: object, source: CameraSimulator, camera: CameraSimulator, seen: Seen) -> CameraSimulator:
    """The simulator `source` that an effect made of `camera`; seen: gets its images.

    UserError for something else, for one of another camera or path than those of the ground truth, and for an image
    that cannot be one of a camera.
    """
    name = name_of(effect)
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
