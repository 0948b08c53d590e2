"""Extra results of a benchmark: an absent reference, or a figure measured over several rounds."""

from collections.abc import Callable
from typing import Any

ROUNDS = 7
"""Rounds of a figure that is a ratio of two times: its 95 % interval is then a few percent wide."""


def absent(benchmark: Any, why: str) -> None:
    """Record that the subject of a benchmark, or its reference, is absent, and why."""
    benchmark.pedantic(lambda: None, rounds=1)
    benchmark.extra_info["absent"] = why


def figure(benchmark: Any, name: str, measure: Callable[[], float], rounds: int = ROUNDS) -> None:
    """Measure a figure in each round; the table shows its mean with an interval."""
    values: list[float] = []
    benchmark.pedantic(lambda: values.append(measure()), rounds=rounds)
    benchmark.extra_info[name] = values
