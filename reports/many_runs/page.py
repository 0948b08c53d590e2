"""The folder of many evaluated runs: a page, its figures and tables.

index.html            mean and spread, paired tests, figures, every run
figures/*             .pdf, .png, and the numbers behind them
tables/summary.*      Markdown, CSV, LaTeX; tables/runs.csv, tables/tests.csv
evaluation.json       all results as JSON
"""

import json
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any
from warnings import catch_warnings, filterwarnings

import numpy as np
from matplotlib import rc_context

from uavbench.reports.figures import ranking
from uavbench.reports.many_runs import figures
from uavbench.reports.many_runs.comparison import extra, frames_of
from uavbench.reports.many_runs.evaluate_many import METRICS, ManyRuns
from uavbench.reports.many_runs.groups import counted
from uavbench.reports.many_runs.results import RUN_COLUMNS, ManyResults
from uavbench.reports.page.templates import asset, environment, on_page
from uavbench.reports.statistics.bootstrap import ranks
from uavbench.reports.style import colour, house_style, write_csv
from uavbench.reports.tables.columns import Column
from uavbench.reports.tables.writers import write_tables
from uavbench.tracker.versions import versions
from uavbench.trajectories.files.listed import Marker
from uavbench.trajectories.files.writing import in_parts, write_text

MARKER = Marker("evaluation.json", "evaluation of runs")
RANKED_BY = "ATE position"
TEST_COLUMNS = ("metric", "first", "second", "difference", "low", "high", "p_holm", "first_wins", "units", "shared")
RUNS = (
    Column(head="coverage", key="coverage_percent", unit="%", best="max", decimals=1),
    Column(head="ATE position", key="ate_position_cm", unit="cm", best="min", decimals=4),
    Column(head="median", key="ate_position_median_cm", unit="cm", best="min", decimals=4),
    Column(head="largest", key="ate_position_max_cm", unit="cm", best="min", decimals=4),
    Column(head="ATE rotation", key="ate_rotation_deg", unit="deg", best="min", decimals=4),
    Column(head="RPE position", key="rpe_position_cm", unit="cm", best="min", decimals=4),
    Column(head="RPE rotation", key="rpe_rotation_deg", unit="deg", best="min", decimals=4),
    Column(head="NEES", key="nees", unit="expected 6", best="", decimals=2),
    Column(head="NEES, aligned", key="nees_aligned", unit="expected 6", best="", decimals=2),
)
"""Columns of the page's table of runs."""
UNSHOWN = ("runs", "RPE position sd", "RPE rotation sd")
"""Columns of the summary that only its files contain, not the page."""


@in_parts(MARKER)
def write_many(folder: Path, results: ManyResults) -> Path:
    """Write the folder of many runs atomically; returns the path of its index.html."""
    many = results.many
    (folder / "figures").mkdir(parents=True)
    write_tables(results.table, folder / "tables" / "summary")
    write_csv(folder / "tables" / "runs.csv", RUN_COLUMNS, results.run_rows())
    if results.tested:
        write_csv(folder / "tables" / "tests.csv", TEST_COLUMNS, _tests(results))
    with house_style(), rc_context({"text.parse_math": False}), catch_warnings():  # names are not formulas
        filterwarnings("ignore", r"Glyph \d+ ", UserWarning)  # told by `unshown`
        drawn = [
            on_page(folder, draw(folder / "figures" / name), title, caption)
            for name, title, caption, draw in _drawings(results)
        ]
    text = environment().get_template("page_runs.html").render(
        title=f"{len(many.groups)} tracker{'s' * (len(many.groups) > 1)}, {counted(len(many.runs))}",
        css=asset("page.css"), js=asset("page.js"), truth=many.truth,
        how=many.pairs.how + frames_of(many, results.tested),
        summary=_summary(results), runs=_runs(results), tests=_shown_tests(results),
        figures=[each.sized(folder) for each in drawn], straight=_straight(many), first=RANKED_BY,
        unshown=results.unshown,
        record=json.dumps(many.runs[0].record, indent=1), version=versions()["uavbench"],
    )  # fmt: skip
    write_text(folder / "index.html", text)
    write_text(folder / MARKER.name, json.dumps(results.to_json(), indent=1, allow_nan=False) + "\n")
    return folder / "index.html"


def _drawings(results: ManyResults) -> list[tuple[str, str, str, Callable[[Path], list[Path]]]]:
    many = results.many
    made: list[tuple[str, str, str, Callable[[Path], list[Path]]]] = [
        ("errors", "Errors over time and distance",
         "Lines: median over the runs of each tracker; bands: 90 % of its runs. RMSE in each of up to 200 bins; a gap "
         "has no pose.", partial(figures.errors_along, many)),
        ("spread", "Spread of the runs",
         "A dot for each run, in their order, over all poses of its own: read them with coverage; line and band: mean "
         "over the runs and its 95 % interval.",
         partial(figures.spread, many)),
        ("paths", "Paths from above",
         "The truth, and of each tracker the run whose position error is nearest to its median, as aligned.",
         partial(figures.paths, many)),
    ]  # fmt: skip
    if any(np.isfinite(extra(run, "nees")) for run in many.runs):
        made.append(
            ("nees", "NEES",
             "Mean over the poses of a run of the squared error over the claimed covariance, which is transformed "
             "with the alignment.", partial(figures.nees, many))
        )  # fmt: skip
    tests = results.tested.get("ate_position")
    if tests:
        names, paired = list(many.groups), many.paired("ate_position")
        made.append(
            ("wins", "Wins", "On the paired runs, over the frames that two trackers share; *: significant at 5 %.",
             partial(ranking.win_table, names, tests, what=RANKED_BY))
        )  # fmt: skip
        if paired and many.pairs.n > 1:
            colours = {name: k for k, name in enumerate(names)}
            made.append(
                ("ranks", "Mean ranks",
                 "Over the frames that all trackers share. Best at the left; bars join trackers without a significant "
                 "difference (Nemenyi).",
                 partial(ranking.critical_difference, ranks(paired), colours, what=RANKED_BY))
            )  # fmt: skip
    return made


def _tests(results: ManyResults) -> list[list[Any]]:
    return [
        [
            metric,
            c.first,
            c.second,
            c.difference.mean,
            *_bounds(c.difference.low, c.difference.high),
            c.p,
            c.wins,
            c.units,
            results.shared[c.first, c.second],
        ]
        for metric, found in results.tested.items()
        for c in found
    ]


def _bounds(*values: float) -> list[float | None]:
    return [value if np.isfinite(value) else None for value in values]


def _straight(many: ManyRuns) -> list[str]:
    """A sentence for each run with an undetermined alignment."""
    return [f"{run.run.group} {run.run.name}: {run.undetermined}" for run in many.runs if run.undetermined]


def _summary(results: ManyResults) -> dict[str, Any]:
    table = results.table.select([c.head for c in results.table.columns if c.head not in UNSHOWN])
    heads = [{"name": "tracker", "unit": "", "best": "min"}]
    heads += [{"name": c.head, "unit": c.unit, "best": c.best} for c in table.columns]
    rows = [
        {
            **_named(k, name, counted(len(results.many.groups[name]))),
            "cells": [
                {"text": c.text + "*" * c.significant, "bounds": c.bounds, "why": c.why, "best": c.best,
                 "sort": "" if c.mean is None else f"{c.mean:.9g}", "share": None}
                for c in cells
            ],
        }
        for k, (name, cells) in enumerate(table.rows)
    ]  # fmt: skip
    return {"name": "summary", "heads": heads, "rows": rows, "absent": (), "caption": table.caption, "shares": False}


def _runs(results: ManyResults) -> dict[str, Any]:
    table = [dict(zip(RUN_COLUMNS, row, strict=True)) for row in results.run_rows()]
    columns = [column for column in RUNS if any(row[column.key] is not None for row in table)]
    heads = [{"name": "run", "unit": "", "best": "min"}]
    heads += [{"name": c.head, "unit": c.unit, "best": c.best} for c in columns]
    groups, rows = list(results.many.groups), []
    for run, row in zip(results.many.runs, table, strict=True):
        note = "straight line" if run.undetermined else ""
        cells = [_plain_cell(row[column.key]) for column in columns]
        rows.append({**_named(groups.index(run.run.group), f"{run.run.group} {run.run.name}", note), "cells": cells})
    return {"name": "runs", "heads": heads, "rows": rows, "absent": (), "caption": "", "shares": False}


def _plain_cell(value: float | None) -> dict[str, Any]:
    text, sort = ("\N{EM DASH}", "") if value is None else (f"{value:.4g}", f"{value:.9g}")
    return {"text": text, "bounds": "", "why": "", "best": False, "sort": sort, "share": None}


def _named(index: int, name: str, status: str) -> dict[str, Any]:
    return {"name": name, "title": name, "colour": colour(index), "status": status}


def _shown_tests(results: ManyResults) -> dict[str, list[dict[str, Any]]]:
    """Rows of the page's tables of tests, by metric."""
    tables: dict[str, list[dict[str, Any]]] = {}
    for metric, found in results.tested.items():
        about = METRICS[metric]
        rows = tables.setdefault(about.name, [])
        for c in found:
            low, high = about.scale * c.difference.low, about.scale * c.difference.high
            rows.append({
                "first": c.first, "second": c.second, "p": f"{c.p:.3g}", "stands": c.significant,
                "difference": f"{about.scale * c.difference.mean:+.4g} {about.unit}", "wins": f"{100 * c.wins:.0f} %",
                "shared": f"{100 * results.shared[c.first, c.second]:.0f} %",
                "bounds": c.difference.why or f"[{low:+.4g}, {high:+.4g}]",
            })  # fmt: skip
    return tables
