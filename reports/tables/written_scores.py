"""Scores read from the files of a report."""

import json
from dataclasses import replace
from pathlib import Path

from uavbench.reports.run_folder import REPORTED, refuse_older_report
from uavbench.reports.scoring.repeated_seeds import repeats_among
from uavbench.reports.scoring.score import Score
from uavbench.reports.scoring.score_frame import score_frame
from uavbench.reports.tables.columns import COLUMNS, DETAILS
from uavbench.reports.tables.summary_table import Table, not_rendered, noted, summary_table
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.reading import read_json

HINT = "; name the folder of a report; one of flights has its table as tables/flights.csv"
KEY = ("label", "rate_hz", "seed", "sequence")


def table_of(folder: Path) -> Table:
    """The table of a report's folder with all columns; UserError naming a file that is missing or invalid.

    As in the report, seeds that repeat another one count once, and trackers that are not installed have a row.
    """
    scores = read_scores(folder)
    repeats = repeats_among(scores)
    frame = score_frame(each.to_json() for each in scores if repeats.counts(each.flight, each.seed))
    about = read_json(folder / REPORTED, inside=folder, hint=HINT)
    missing, absent = (each if isinstance(each := about.get(key), dict) else {} for key in ("unrendered", "absent"))
    table = replace(summary_table(frame, (*COLUMNS, *DETAILS)), absent=tuple(map(str, absent)))
    return noted(noted(table, str(repeats)), not_rendered(missing))


def read_scores(folder: Path) -> list[Score]:
    """Scores of `scores.json` with the times of `latency.json`.

    UserError naming a file that is missing or invalid, and for a report that is older than the scores of its folder.
    """
    accuracy, times = (read_json(folder / name, inside=folder, hint=HINT) for name in (REPORTED, "latency.json"))
    try:
        timed = {json.dumps([row[key] for key in KEY]): row for row in times["latency"]}
        scores = [Score.from_json({**timed[json.dumps([row[k] for k in KEY])], **row}) for row in accuracy["scores"]]
    except (KeyError, TypeError, UserError) as error:
        raise UserError(f"{folder / REPORTED}: not the scores of a report with ground truth: {error}") from None
    refuse_older_report(folder, accuracy["scores"])
    return scores
