"""A finished run's folder: its scores as a DataFrame, and its runs opened for figures and errors frame by frame."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from uavbench.scenes.dataset.table_files import read_json
from uavbench.trajectories.errors import UserError

if TYPE_CHECKING:
    from pandas import DataFrame

    from uavbench.reports.scoring.runs import ScoredRun

FIRST = ("sequence", "flight", "tracker", "rate_hz", "seed", "status")
LEFT_OUT = ("record", "errors", "undefined")
"""Keys of a score that are no numbers."""
UNITS = ("m", "deg", "ms", "px", "s")
SCORES = "results/*/*/score.json"


def load_scores(folder: str | Path) -> "DataFrame":
    """Scores of a finished run, one row per run of a tracker on a sequence, sorted by sequence, tracker and rate.

    folder: what `uavbench run --out` or `uavbench score --out` wrote. Columns: sequence, flight (without its seed),
    tracker, rate_hz, seed, status, then every number of the scores under the path of its key, its unit last:
    `tracking_success`, `ate_none_translation_rmse_m`, `rpe_1s_rotation_median_deg`, `latency_total_p95_ms`. NaN where
    a run has none. UserError when the folder holds no scores.
    """
    from pandas import DataFrame

    scores = [read_json(path) for path in _score_files(Path(folder))]
    rows = [row_of(score) for score in [*scores, *_missing(Path(folder), scores)]]
    return DataFrame(rows).sort_values(list(FIRST[:5]), ignore_index=True)


def load_runs(folder: str | Path) -> "list[ScoredRun]":
    """The runs of a finished run on rendered sequences, for `uavbench.figures` and errors frame by frame.

    Each has `.name` (`lsd@15hz`), `.sequence`, `.results`, `.score`, and `.frames()`: a DataFrame of its errors.
    UserError when the folder holds no scores, or scores of other results.
    """
    from uavbench.reports.scoring.runs import open_runs

    files = _score_files(Path(folder))
    sequences = Path(folder) / "sequences"
    return open_runs([(sequences / file.parents[1].name, file.parent, file, "") for file in files])


def row_of(score: Mapping[str, Any]) -> dict[str, Any]:
    """A score as a row: who and what first, then its numbers."""
    about = {**score, "tracker": score.get("label"), "flight": flight_of(score)}
    named = {name: about.get(name) for name in FIRST}
    rest = {key: value for key, value in score.items() if key not in (*FIRST, "label", "content_hash")}
    return named | {column_of(path): value for path, value in _numbers(rest, ())}


def flight_of(score: Mapping[str, Any]) -> str:
    """Name of a score's sequence without its seed."""
    return str(score.get("sequence", "")).removesuffix(f"-s{score.get('seed')}")


def column_of(path: tuple[str, ...]) -> str:
    """Name of a column: the keys of its path, the unit of one before the last put last."""
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
    """Each number of a score with the keys that lead to it."""
    if isinstance(value, Mapping):
        for key, item in value.items():
            if key not in LEFT_OUT:
                yield from _numbers(item, (*path, key))
    elif isinstance(value, int | float):
        yield path, value


def _missing(folder: Path, scores: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Scores of the report that have no results: of runs that are missing."""
    report = folder / "scores.json"
    reported = read_json(report).get("scores", []) if report.is_file() else []
    known = {_who(score) for score in scores}
    return [score for score in reported if score.get("status") == "missing" and _who(score) not in known]


def _who(score: Mapping[str, Any]) -> tuple[Any, ...]:
    return tuple(score.get(key) for key in ("sequence", "label", "rate_hz", "seed"))


def _score_files(folder: Path) -> list[Path]:
    files = sorted(folder.glob(SCORES))
    if not files:
        raise UserError(f"{folder}: holds no scores ({SCORES}); `uavbench score SUITE --out {folder}` makes them")
    return files
