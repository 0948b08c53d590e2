"""The tables `[loop]` and `[loops.NAME]` of a suite: what they share, and what is wrong with them."""

from collections.abc import Sequence
from typing import Any

from uavbench.bench.closed_loop.checks import check_loop
from uavbench.bench.closed_loop.spec import LoopSpec
from uavbench.scenes.spec import SequenceSpec
from uavbench.tracker.images.recorded_sequence import RecordingSpec
from uavbench.trajectories.errors import UserError


def with_shared_loop(data: dict[str, Any]) -> dict[str, Any]:
    """The tables of a file, each of `[loops.NAME]` with every key of `[loop]` that it does not have itself."""
    shared, loops = data.get("loop", {}), data.get("loops")
    if not isinstance(loops, dict) or not isinstance(shared, dict):
        return data
    return {**data, "loops": {name: _with_shared(shared, table) for name, table in loops.items()}}


def _with_shared(shared: Any, own: Any) -> Any:
    """A value with what another says and it does not; a table takes nothing from one of another kind."""
    if not (isinstance(shared, dict) and isinstance(own, dict)) or own.get("kind") not in (None, shared.get("kind")):
        return own
    return {**shared, **{key: _with_shared(shared.get(key), value) for key, value in own.items()}}


def without_loop(suite: str) -> UserError:
    """The mistake of a suite that is to be flown and does not say how."""
    return UserError(
        f"suite {suite} says nothing of how it is flown: give it a table [loop], which may be empty, or fly "
        "fly-box, fly-bridge or fly-facade"
    )


def loop_mistakes(name: str, loop: LoopSpec, sequences: Sequence[SequenceSpec | RecordingSpec | None]) -> list[str]:
    """A line for each way in which a loop cannot fly a sequence."""
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
    return mistakes
