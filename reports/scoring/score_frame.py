"""Scores as one tidy DataFrame, the source of every table."""

from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pandas import DataFrame

FIRST = ("sequence", "flight", "tracker", "rate_hz", "seed", "status")
LEFT_OUT = ("record", "errors", "undefined")
"""Keys of a score that hold no numbers."""
UNITS = ("m", "deg", "ms", "px", "s")


def score_frame(scores: Iterable[Mapping[str, Any]]) -> "DataFrame":
    """DataFrame of scores, given as the objects of `score.json`: one row each, in their order.

    Columns: sequence, flight (sequence without its seed), tracker, rate_hz, seed, status; then every number, named by
    the path of its keys with its unit last (`ate_none_translation_rmse_m`), NaN where a run has none; last `error`, the
    first error of the run, "" without any.
    """
    from pandas import DataFrame

    scores = list(scores)
    rows = DataFrame([row_of(score) for score in scores])
    return rows.assign(error=[str(next(iter(score.get("errors", ())), "")) for score in scores])


def row_of(score: Mapping[str, Any]) -> dict[str, Any]:
    """A score as a row: identifying columns first, then its numbers."""
    about = {**score, "tracker": score.get("label"), "flight": flight_of(score)}
    named = {name: about.get(name) for name in FIRST}
    rest = {key: value for key, value in score.items() if key not in (*FIRST, "label", "content_hash")}
    return named | {column_of(path): value for path, value in _numbers(rest, ())}


def flight_of(score: Mapping[str, Any]) -> str:
    """Name of a score's sequence without its seed."""
    return str(score.get("sequence", "")).removesuffix(f"-s{score.get('seed')}")


def column_of(path: tuple[str, ...]) -> str:
    """Name of a column: the keys of its path, with the unit of a parent key moved to the end."""
    words: list[str] = []
    unit = ""
    for key in path[:-1]:
        stem, _, end = key.replace(" ", "").rpartition("_")
        unit = end if stem and end in UNITS else unit
        words.append(stem if stem and end in UNITS else key.replace(" ", ""))
    if path[-1] == "n":
        return "_".join([*words, "n"])
    unit += "2" if path[-1] == "sse" and unit else ""  # a sum of squares
    return "_".join([*words, path[-1], *([unit] if unit else [])])


def _numbers(value: Any, path: tuple[str, ...]) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Each number of a score with the path of its keys."""
    if isinstance(value, Mapping):
        for key, item in value.items():
            if key not in LEFT_OUT:
                yield from _numbers(item, (*path, key))
    elif isinstance(value, int | float):
        yield path, value
