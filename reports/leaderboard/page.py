"""The leaderboard of a challenge: a static page, and its table.

index.html                 ranks, scores, coverage and intervals; points by sequence; faults of submissions
tables/leaderboard.*       Markdown, CSV, LaTeX
leaderboard.json           lists the files
"""

import json
from collections import Counter
from collections.abc import Sequence as ListOf
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from uavbench.reports.leaderboard.submission_score import RULES, SubmissionScore
from uavbench.reports.page.templates import asset, environment
from uavbench.reports.statistics.bootstrap import compare_with, hierarchical_interval
from uavbench.reports.style import colour
from uavbench.reports.tables.columns import Column
from uavbench.reports.tables.summary_table import Cell, Table
from uavbench.reports.tables.writers import write_tables
from uavbench.tracker.versions import versions
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.listed import Marker
from uavbench.trajectories.files.writing import in_parts, write_text

MARKER = Marker("leaderboard.json", "leaderboard")
COLUMNS = (
    Column(head="score", key="points", unit="0 to 100", best="max", decimals=1, most=100.0),
    Column(head="within 5 cm and 5 deg", key="success", unit="%", best="max", decimals=1, scale=100.0),
    Column(head="coverage", key="coverage", unit="%", best="max", decimals=1, scale=100.0),
    Column(head="ATE position", key="ate_position_m", unit="cm", best="min", decimals=2, scale=100.0),
    Column(head="ATE rotation", key="ate_rotation_deg", unit="deg", best="min", decimals=3),
)
CAPTION = (
    f"Score: {RULES}. Errors are RMSE over the frames that have a pose: read them with coverage; (k/n): k of n "
    "sequences have one. Means over flights and seeds with 95 % intervals (bootstrap, widened by Student's t); n/a "
    "where they cannot be given. *: better than every other submission at the 5 % level (paired by flight and seed, "
    "Holm)."
)


@in_parts(MARKER)
def write_leaderboard(folder: Path, scores: ListOf[SubmissionScore], title: str) -> Path:
    """Write the folder of a leaderboard, the best submission first; the path of its index.html.

    UserError without a submission, when two have the same name, and when they are to different challenges.
    """
    _refuse_mixed(scores)
    ranked = sorted(scores, key=lambda score: (-score.score, score.name))
    table = Table(CAPTION, COLUMNS, tuple((score.name, _cells(score, ranked)) for score in ranked), of="submission")
    write_tables(table, folder / "tables" / "leaderboard")
    text = environment().get_template("page_leaderboard.html").render(
        title=title, css=asset("page.css"), js=asset("page.js"), challenge=ranked[0].challenge,
        count=len(ranked), sequences=len(ranked[0].runs[ranked[0].counted]), ranking=_ranking(table, ranked),
        each=_by_sequence(ranked), faults={score.name: score.faults for score in ranked if score.faults},
        version=versions()["uavbench"],
    )  # fmt: skip
    write_text(folder / "index.html", text)
    write_text(folder / MARKER.name, json.dumps({"challenge": ranked[0].challenge}, indent=1) + "\n")
    return folder / "index.html"


def _refuse_mixed(scores: ListOf[SubmissionScore]) -> None:
    if not scores:
        raise UserError("a leaderboard needs the score of at least one submission")
    name, times = Counter(score.name for score in scores).most_common(1)[0]
    if times > 1:
        raise UserError(
            f"{times} submissions are called {name!r}; give each its name in its submission.toml, score again"
        )
    challenges = dict.fromkeys(score.challenge for score in scores)
    if len(challenges) > 1:
        raise UserError(
            f"the submissions are to {len(challenges)} challenges ({', '.join(challenges)}); rank each separately"
        )


def _cells(score: SubmissionScore, ranked: ListOf[SubmissionScore]) -> tuple[Cell, ...]:
    cells = tuple(_cell(score, column) for column in COLUMNS)
    alone = len(ranked) > 1 and score is ranked[0] and score.score > ranked[1].score
    values = {each.name: each.by_flight("points") for each in ranked}
    significant = alone and all(found.significant for found in compare_with(score.name, values))
    best = score.score == ranked[0].score
    return (replace(cells[0], best=best, significant=significant), *cells[1:])


def _cell(score: SubmissionScore, column: Column) -> Cell:
    values = [column.scale * flight for flight in score.by_flight(column.key)]
    known = [k for v in values if len(k := v[np.isfinite(v)])]
    n, runs = sum(map(len, known)), sum(map(len, values))
    if not n:
        return Cell(mean=None, interval=None, known=0, runs=runs, decimals=column.decimals)
    interval = column.within(hierarchical_interval(known))
    mean = score.score if column.key == "points" else interval.mean
    return Cell(
        mean=mean, interval=interval if runs > 1 else None, known=n, runs=runs, decimals=column.decimals
    )  # fmt: skip


def _ranking(table: Table, ranked: ListOf[SubmissionScore]) -> dict[str, Any]:
    heads = [{"name": table.of, "unit": "", "best": "min"}]
    heads += [{"name": column.head, "unit": column.unit, "best": column.best} for column in table.columns]
    rows = []
    for k, (score, (name, cells)) in enumerate(zip(ranked, table.rows, strict=True)):
        rank = 1 + sum(other.score > score.score for other in ranked)
        counted = f"{score.counted} of {len(score.runs)}" if len(score.runs) > 1 else ""
        shown = [
            {"text": c.text + "*" * c.significant, "bounds": c.bounds, "why": c.why, "best": c.best,
             "sort": "" if c.mean is None else f"{c.mean:.9g}", "share": None}
            for c in cells
        ]  # fmt: skip
        rows.append({"name": name, "title": f"{rank}. {name}", "colour": colour(k), "status": counted, "cells": shown})
    return {"name": "ranking", "heads": heads, "rows": rows, "absent": (), "caption": table.caption, "shares": False}


def _by_sequence(ranked: ListOf[SubmissionScore]) -> dict[str, Any]:
    """Points of the counted run on each sequence, the best of a sequence bold."""
    names = list(ranked[0].runs[ranked[0].counted])
    points = {score.name: [score.runs[score.counted][name].points for name in names] for score in ranked}
    most = [max(column) for column in zip(*points.values(), strict=True)]
    heads = [{"name": "submission", "unit": "", "best": "min"}]
    heads += [{"name": name, "unit": "points", "best": "max"} for name in names]
    rows = [
        {"name": name, "title": name, "colour": colour(k), "status": "", "cells": [
            {"text": f"{value:.1f}", "bounds": "", "why": "", "best": 0 < value == top, "sort": f"{value:.9g}",
             "share": None}
            for value, top in zip(values, most, strict=True)
        ]}
        for k, (name, values) in enumerate(points.items())
    ]  # fmt: skip
    return {"name": "sequences", "heads": heads, "rows": rows, "absent": (), "caption": "", "shares": False}
