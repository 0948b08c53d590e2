"""Scores read from the files of a report."""

import json
from pathlib import Path

from uavbench.reports.run_folder import REPORTED, refuse_older_report
from uavbench.reports.scoring.score import Score
from uavbench.reports.scoring.score_frame import score_frame
from uavbench.reports.tables.columns import COLUMNS, DETAILS
from uavbench.reports.tables.summary_table import Table, not_rendered, noted, summary_table
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.reading import read_json

HINT = "; name the folder of a report; one of flights has its table as tables/flights.csv"
KEY = ("label", "rate_hz", "seed", "sequence")


def table_of(folder: Path) -> Table:
    """The table of a report's folder with all columns; UserError naming a file that is missing or invalid."""
    table = summary_table(score_frame(score.to_json() for score in read_scores(folder)), (*COLUMNS, *DETAILS))
    missing = read_json(folder / REPORTED, inside=folder, hint=HINT).get("unrendered", {})
    return noted(table, not_rendered(missing) if isinstance(missing, dict) else "")


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
