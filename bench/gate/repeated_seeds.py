"""Seeds that the gate counts once: see `uavbench.reports.statistics.repeats`."""

from collections.abc import Iterable

from uavbench.bench.gate.paired_scores import Key, Measured, Side, known
from uavbench.reports.statistics.repeats import Observation, Repeats


def repeats_of(keys: Iterable[Key], base: Side, head: Side) -> Repeats:
    """The seeds of each sequence that repeat another one on both sides, in the runs of these keys."""
    pairs = ((key, base.runs.get(key), head.runs.get(key)) for key in keys)
    return Repeats.of(Observation(key[0], key[1], key[2], _seen(of_base, of_head)) for key, of_base, of_head in pairs)


def _seen(base: Measured | None, head: Measured | None) -> str | None:
    """What was seen on both sides; of a baseline's file only its numbers are known."""
    if base is None or head is None or not head.seen:
        return None
    return repr((head.seen, base.seen, base.coverage, base.crash, sorted(known(base.errors).items())))
