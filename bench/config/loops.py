"""The tables `[loop]` and `[loops.NAME]` of a suite: shared keys, and their validation against the sequences."""

from collections.abc import Sequence
from typing import Any

from uavbench.bench.closed_loop.checks import check_loop
from uavbench.bench.closed_loop.spec import LoopSpec
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
