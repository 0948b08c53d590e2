"""The tables `[loop]` and `[loops.NAME]` of a suite: shared keys, and their validation against the sequences."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields
from typing import Any

from uavbench.bench.closed_loop.checks import check_loop
from uavbench.bench.closed_loop.spec import CAMERA, FilterSpec, LoopSpec
from uavbench.scenes.spec import SequenceSpec
from uavbench.tracker.images.recorded_sequence import RecordingSpec
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.sensors.gnss import Gnss


def with_shared_loop(data: dict[str, Any]) -> dict[str, Any]:
    """The tables of a file, with the keys of `[loop]` as defaults of each `[loops.NAME]`."""
    shared, loops = data.get("loop", {}), data.get("loops")
    if not isinstance(loops, dict) or not isinstance(shared, dict):
        return data
    return {**data, "loops": {name: _with_shared(shared, table) for name, table in loops.items()}}


def _with_shared(shared: Any, own: Any) -> Any:
    """A value with missing keys filled in from the shared one; tables of different `kind` are not merged."""
    if not (isinstance(shared, dict) and isinstance(own, dict)) or own.get("kind") not in (None, shared.get("kind")):
        return own
    return {**shared, **{key: _with_shared(shared.get(key), value) for key, value in own.items()}}


def idle_keys(data: dict[str, Any], loops: Mapping[str, LoopSpec | None]) -> list[str]:
    """An error line for each key of the tables of a file that has no effect in the loops that it is given for.

    A key of `[loop]` beside `[loops.NAME]` is given for all of them, and has one if it has one in any.
    """
    known = {name: loop for name, loop in loops.items() if loop is not None}
    named = [(f"loops.{name}", data["loops"][name], [loop]) for name, loop in known.items() if name]
    shared = [("loop", data["loop"], list(known.values()))] if "loop" in data else []
    return [
        f"{at}.{key}: has no effect: {why}; leave it out"
        for at, table, given in [*shared, *named]
        for key, why, has_effect in IDLE
        if _holds(table, key) and given and not any(has_effect(loop) for loop in given)
    ]


def _holds(table: Any, key: str) -> bool:
    """Whether a table has a key, as `filter.gate`."""
    for part in key.split("."):
        if not isinstance(table, dict) or part not in table:
            return False
        table = table[part]
    return True


def _filters(loop: LoopSpec) -> bool:
    return loop.estimator == "filter"


def _weighs_camera(loop: LoopSpec) -> bool:
    return _filters(loop) and (loop.sensors is None or CAMERA in loop.sensors)


IDLE: tuple[tuple[str, str, Callable[[LoopSpec], bool]], ...] = (
    ("prior", "no estimator is the filter, whose prediction it would be", _filters),
    *(
        (f"filter.{each.name}", "the filter gets no poses of the tracker (`sensors` without `camera`)", _weighs_camera)
        if each.name.startswith(("camera_", "unclaimed_"))
        else (f"filter.{each.name}", "no estimator is the filter", _filters)
        for each in fields(FilterSpec)
    ),
    (
        "gnss_outages_s",
        "`sensors` names no GNSS that could be lost",
        lambda loop: loop.sensors is None or any(name.startswith("gnss") for name in loop.sensors),
    ),
)
"""Keys of a loop, why they may have no effect, and whether they have one."""


def without_loop(suite: str) -> UserError:
    """UserError for flying a suite that has no `[loop]`."""
    return UserError(
        f"suite {suite} has no table [loop], which closed-loop flights need: add one, which may be empty, or fly "
        "fly-box, fly-bridge or fly-facade"
    )


def loop_mistakes(name: str, loop: LoopSpec, sequences: Sequence[SequenceSpec | RecordingSpec | None]) -> list[str]:
    """An error line for each reason why a loop cannot fly the sequences."""
    mistakes: list[str] = []
    key = f"loops.{name}" if name else "loop"
    for spec in sequences:
        try:
            if isinstance(spec, SequenceSpec):
                check_loop(loop, spec)
            elif spec is not None:
                mistakes.append(f"{key}: `recordings` are real images and cannot be flown; give `sequences`")
        except UserError as error:
            mistakes.append(f"{key}: {error}")
    flown = [spec for spec in sequences if isinstance(spec, SequenceSpec)]
    if loop.gnss_outages_s and flown and not any(isinstance(s, Gnss) for spec in flown for s in spec.sensors):
        why = "no sequence has GNSS that could be lost; add `gnss` to its `sensors`, or leave this key out"
        mistakes.append(f"{key}.gnss_outages_s: {why}")
    return mistakes
