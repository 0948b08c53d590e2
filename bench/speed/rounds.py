"""Reports of a benchmark beside its time: what is absent, and a value of several rounds."""

from collections.abc import Callable
from typing import Any

ROUNDS = 7
"""Rounds of a figure that is a ratio of two times: enough for an interval of some percent of it."""


def absent(benchmark: Any, why: str) -> None:
    """Report that the subject of a benchmark, or its reference, is absent."""
    benchmark.pedantic(lambda: None, rounds=1)
    benchmark.extra_info["absent"] = why


def figure(benchmark: Any, name: str, measure: Callable[[], float], rounds: int = ROUNDS) -> None:
    """Measure a figure round by round; the table says its mean with an interval."""
    values: list[float] = []
    benchmark.pedantic(lambda: values.append(measure()), rounds=rounds)
    benchmark.extra_info[name] = values
