"""A finished run's folder: its scores as a DataFrame, and its runs opened for figures and errors frame by frame."""

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from uavbench.scenes.dataset.table_files import read_json
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.reading import given_path

if TYPE_CHECKING:
    from pandas import DataFrame

    from uavbench.reports.scoring.runs import ScoredRun

SCORES = "results/*/*/score.json"
REPORTED = "scores.json"
"""All scores of a report."""
FLIGHTS = "flights.json"
"""All scores of a report of flights."""
FLOWN_SCORES = "flights/*/*/score.json"
SUITE = "suite.json"
"""Description of the suite whose runs are in the folder."""
RECORDS = "made"
"""Folder inside with a record for each job: the hash of its inputs and the files that it wrote."""


def load_scores(folder: str | Path) -> "DataFrame":
    """Scores of a finished run, one row per run of a tracker on a sequence, sorted by sequence, tracker and rate.

    folder: what `uavbench run --out` or `uavbench score --out` wrote; runs that an earlier form of the suite left in it
    do not count. Columns: sequence, flight (without its seed), tracker, rate_hz, seed, status, then every number of the
    scores under the path of its key, its unit last: `tracking_success`, `ate_none_translation_rmse_m`,
    `rpe_1s_rotation_median_deg`, `latency_total_p95_ms`. NaN where a run has none. The last column, `error`, is the
    first error of the run. UserError when the folder has no scores, or one of inputs that have changed since.

    >>> scores = load_scores(folder)
    >>> scores.groupby("tracker").tracking_success.mean().to_dict()
    {'far': 0.0, 'near': 1.0}
    """
    from uavbench.reports.scoring.score_frame import FIRST, score_frame

    folder = given_path("folder", folder)
    scores = [read_json(path) for path in score_files(folder)]
    frame = score_frame([*scores, *_missing(folder, scores)])
    return frame.sort_values(list(FIRST[:5]), ignore_index=True)


def load_runs(folder: str | Path) -> "list[ScoredRun]":
    """The runs of a finished run on rendered sequences, for `uavbench.figures` and errors frame by frame.

    Each has `.name` (`lsd@15hz`), `.sequence`, `.results`, `.score`, and `.frames()`: a DataFrame of its errors.
    UserError when the folder has no scores, or scores of other results.

    >>> run = load_runs(folder)[0]
    >>> run.name, list(run.frames())[:3]
    ('far@15hz', ['frame', 'stamp_ns', 'time_s'])
    """
    from uavbench.reports.scoring.runs import ReportEntry, open_runs

    folder = given_path("folder", folder)
    files = score_files(folder)
    sequences = folder / "sequences"
    return open_runs([ReportEntry(sequences / file.parents[1].name, file.parent, file) for file in files])


def load_run(results: Path) -> "ScoredRun":
    """The run of one tracker on a rendered sequence, by the folder of its results in that of a finished run.

    UserError for another folder, for images without ground truth, and for scores as in `load_runs`.
    """
    from uavbench.reports.scoring.runs import ReportEntry, open_runs
    from uavbench.scenes.dataset.sequence import Sequence

    place = results.absolute()
    if place.parts[-3:-2] != ("results",) or not place.is_dir():
        raise UserError(
            f"{results}: is not a folder of a tracker's results on a sequence; give one that `uavbench score` made, as "
            "out/SUITE/results/SEQUENCE/TRACKER@15hz"
        )
    folder, file = place.parents[2], place / Path(SCORES).name
    sequence = folder / "sequences" / place.parent.name
    if Sequence.load(sequence).recorded:
        raise UserError(f"{results}: has no errors, since its images have no ground truth; see overlay.mp4 of the run")
    if not file.is_file():
        raise UserError(f"{results}: has no score; create it with `uavbench score SUITE --out {folder}`")
    refuse_disowned(folder, file)
    return open_runs([ReportEntry(sequence, place, file)])[0]


def _missing(folder: Path, scores: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Scores of the report that have no results: of runs that are missing."""
    known = {_who(score) for score in scores}
    return [score for score in _reported_missing(folder) if _who(score) not in known]


def _reported_missing(folder: Path) -> list[dict[str, Any]]:
    """Scores of the report of runs that are missing and that the suite still has; none without a report."""
    report = folder / REPORTED
    reported = read_json(report).get("scores", []) if report.is_file() else []
    has = _suite(folder)
    missing = [score for score in reported if score.get("status") == "missing"]
    return [score for score in missing if has(str(score.get("sequence")), _run(score))]


def _who(score: Mapping[str, Any]) -> tuple[Any, ...]:
    return tuple(score.get(key) for key in ("sequence", "label", "rate_hz", "seed"))


def refuse_older_report(folder: Path, rows: list[dict[str, Any]]) -> None:
    """UserError when a run in the folder has other scores than the rows of its report, or is not among them.

    So does one that the suite no longer has. A folder of a report alone, without results, is as it is.
    """
    reported = {_who(row): row for row in rows}
    has = _suite(folder)
    for sequence, run in ((str(row.get("sequence")), _run(row)) for row in rows):
        if not has(sequence, run):
            raise UserError(
                f"{folder / REPORTED}: has {run} on {sequence}, which is no longer in the suite of {folder / SUITE}; "
                "write it again with `uavbench report`"
            )
    for file in score_files(folder) if any(folder.glob(SCORES)) else ():
        score = read_json(file)
        row = reported.get(_who(score))
        if row is None or any(json.dumps(score.get(key)) != json.dumps(value) for key, value in row.items()):
            raise UserError(f"{folder / REPORTED}: older than {file}; write it again with `uavbench report`")


def has_older_report(folder: Path) -> bool:
    """Whether the report in the folder is not of the scores and the suite that are there; False without a report.

    Of a suite with loops it is the report of flights.
    """
    suite = folder / SUITE
    flown = suite.is_file() and bool(read_json(suite).get("loops"))
    report = folder / (FLIGHTS if flown else REPORTED)
    if not report.is_file():
        return False
    try:
        rows = read_json(report)["scores"]
        if flown:
            return _is_older_than_flights(folder, rows)
        refuse_older_report(folder, rows)
    except (UserError, KeyError, TypeError, AttributeError):
        return True
    return False


def _is_older_than_flights(folder: Path, rows: list[dict[str, Any]]) -> bool:
    """Whether a flight in the folder has another score than in these rows, or is not in both."""
    reported = {(str(row["sequence"]), str(row["run"])): row for row in rows}
    has = _suite(folder)
    if not all(has(sequence, run.partition("+")[0]) for sequence, run in reported):
        return True
    files = {(path.parents[1].name, path.parent.name): path for path in folder.glob(FLOWN_SCORES)}
    current = {who: path for who, path in files.items() if has(who[0], who[1].partition("+")[0])}
    if current.keys() != reported.keys() or any(_is_disowned(folder, path) for path in current.values()):
        return True
    scores = {who: read_json(path) for who, path in current.items()}
    return any(json.dumps(scores[who].get(k)) != json.dumps(v) for who, row in reported.items() for k, v in row.items())


def score_files(folder: Path) -> list[Path]:
    """Files of the current scores of the suite that `suite.json` describes; without it, of all.

    UserError without any, and for one that is not current, unless the report says that its run is missing.
    """
    if folder.is_file():
        raise UserError(f"{folder}: is a file; give the folder of the run that it is in")
    has = _suite(folder)
    files = [path for path in sorted(folder.glob(SCORES)) if has(path.parents[1].name, path.parent.name)]
    if not files:
        raise UserError(f"{folder}: has no scores ({SCORES}); create them with `uavbench score SUITE --out {folder}`")
    missing = {(score.get("sequence"), _run(score)) for score in _reported_missing(folder)}
    current = []
    for file in files:
        if not (_is_disowned(folder, file) and (file.parents[1].name, file.parent.name) in missing):
            refuse_disowned(folder, file)
            current.append(file)
    return current


def _suite(folder: Path) -> Callable[[str, str], bool]:
    """Function that tells whether the suite of `suite.json` has a sequence and a run on it; without the file it has."""
    suite = folder / SUITE
    if not suite.is_file():
        return lambda sequence, run: True
    about = read_json(suite)
    try:
        sequences = set(about["sequences"])
        runs = {_run({"label": label, "rate_hz": rate}) for label in about["trackers"] for rate in about["rates_hz"]}
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise UserError(f"{suite}: not uavbench's: {error}") from None
    return lambda sequence, run: sequence in sequences and run in runs


def _run(score: Mapping[str, Any]) -> str:
    """Name of the folder of a run."""
    return f"{score.get('label')}@{float(score.get('rate_hz', 0)):g}hz"


def _is_disowned(folder: Path, file: Path) -> bool:
    record = folder / RECORDS / file.relative_to(folder)
    return record.is_file() and not read_json(record).get("content_hash")


def refuse_disowned(folder: Path, file: Path) -> None:
    """UserError when an input of a run's file has changed since, or while it was made, or its job has not ended."""
    if _is_disowned(folder, file):
        why = "made of inputs that changed meanwhile or since, or not to the end"
        raise UserError(f"{file}: {why}; run the suite again")
