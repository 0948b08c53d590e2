"""The folder of a history: a page that opens from disk, its figures, and the formats of benchmark services.

index.html                   alarms, the trend of every metric, every change, the commits
figures/*                    .pdf, .png, and the numbers behind them
changes.json                 verdict, alarms and changes
github-smaller.json          the latest commit for github-action-benchmark: customSmallerIsBetter, customBiggerIsBetter
github-bigger.json
bencher.json                 the same in Bencher Metric Format
"""

import json
import re
from dataclasses import asdict
from pathlib import Path
from typing import Any

from matplotlib import rc_context

from uavbench.reports.history import forms
from uavbench.reports.history.figures import save_trend
from uavbench.reports.history.history_file import Commit, History
from uavbench.reports.history.series import Series
from uavbench.reports.history.trend import Trend, short
from uavbench.reports.page.templates import asset, environment, on_page
from uavbench.reports.style import colour, house_style
from uavbench.tracker.versions import versions
from uavbench.trajectories.files.listed import Marker
from uavbench.trajectories.files.writing import in_parts, write_text

MARKER = Marker("changes.json", "pages of a history")


@in_parts(MARKER)
def write_trends(folder: Path, history: History, found: list[Trend]) -> Path:
    """Write the folder of a history and its trends atomically; returns the path of its index.html."""
    (folder / "figures").mkdir(parents=True)
    with house_style(), rc_context({"text.parse_math": False}):  # names of trackers are not formulas
        drawn = [
            on_page(folder, save_trend(trend, folder / "figures" / f"{k:02d}-{_slug(trend.series.name)}"),
                    trend.series.name, _caption(trend))
            for k, trend in enumerate(found)
        ]  # fmt: skip
    latest = history.commits[-1]
    text = environment().get_template("page_history.html").render(
        title=f"{history.suite.name}: {len(history.commits)} commits", css=asset("page.css"), js=asset("page.js"),
        alarms=[trend.said(change) for trend in found for change in trend.alarms],
        changes=[trend.said(change) for trend in found for change in trend.changes],
        table=_table(found, latest), figures=[each.sized(folder) for each in drawn], commits=_commits(history),
        environment=history.environment, name=history.name, version=versions()["uavbench"],
    )  # fmt: skip
    write_text(folder / "index.html", text)
    for name, body in _forms([trend.series for trend in found if is_of(trend.series, latest)]).items():
        write_text(folder / name, json.dumps(body, indent=1, allow_nan=False) + "\n")
    write_text(folder / MARKER.name, json.dumps(to_json(found), indent=1, allow_nan=False) + "\n")
    return folder / "index.html"


def is_of(series: Series, commit: Commit) -> bool:
    """Whether the last value of a series is of this commit: a tracker may be gone, or give no number any more."""
    return series.commits[-1].commit == commit.commit


def to_json(found: list[Trend]) -> dict[str, Any]:
    """Content of changes.json: the verdict `alarm` or `quiet`, and every change with its commits."""
    changes = [
        {
            "tracker": trend.series.tracker, "metric": trend.series.metric, "alarm": change in trend.alarms,
            "said": trend.said(change), **asdict(change),
            **{key: trend.series.commits[getattr(change, key)].commit for key in ("at", "first", "last")},
        }
        for trend in found
        for change in trend.changes
    ]  # fmt: skip
    return {"verdict": "alarm" if any(trend.alarms for trend in found) else "quiet", "changes": changes}


def _forms(series: list[Series]) -> dict[str, Any]:
    return {
        "github-smaller.json": forms.github_benchmark(series, bigger=False),
        "github-bigger.json": forms.github_benchmark(series, bigger=True),
        "bencher.json": forms.bencher(series),
    }


def _caption(trend: Trend) -> str:
    told = [trend.said(change).removeprefix(f"{trend.series.name}: ") for change in trend.changes]
    noise = f"Band: twice the noise between commits, {100 * trend.series.noise:.2g} %."
    return f"{noise} {'; '.join(told) if told else 'No change.'}"


def _table(found: list[Trend], latest: Commit) -> dict[str, Any]:
    heads = [{"name": name, "unit": unit, "best": best} for name, unit, best in (
        ("metric", "", "min"), ("now", "95 % over flights", "min"), ("first", "", "min"), ("noise", "%", "min"),
        ("changes", "", "min"), ("alarms", "", "min"))]  # fmt: skip
    trackers = list(dict.fromkeys(trend.series.tracker for trend in found))
    rows = []
    for trend in found:
        series = trend.series
        low, high = series.low[-1], series.high[-1]
        now = _cell(f"{series.value[-1]:.4g} {series.unit}".strip(), series.value[-1])
        now["bounds"] = f"[{low:.4g}, {high:.4g}]" if low <= high else ""
        if not is_of(series, latest):
            now = {**_cell("\N{EM DASH}", 0.0), "sort": "", "bounds": f"last with {short(series.commits[-1])}"}
        rows.append({
            "name": series.name, "title": series.name, "colour": colour(trackers.index(series.tracker)),
            "status": "worse" if trend.alarms else "",
            "cells": [
                now, _cell(f"{series.value[0]:.4g} {series.unit}".strip(), series.value[0]),
                _cell(f"{100 * series.noise:.2g}", series.noise), _cell(str(len(trend.changes)), len(trend.changes)),
                _cell(str(len(trend.alarms)), len(trend.alarms)),
            ],
        })  # fmt: skip
    return {"name": "trends", "heads": heads, "rows": rows, "absent": (), "caption": "", "shares": False}


def _cell(text: str, value: float) -> dict[str, Any]:
    return {"text": text, "bounds": "", "why": "", "best": False, "sort": f"{value:.9g}", "share": None}


def _commits(history: History) -> list[dict[str, str]]:
    """The commits, latest first, each with the differences of its environment from that of the previous commit."""
    told, before = [], history.environment
    for commit in history.commits:
        told.append(
            {"hash": short(commit), "time": commit.time, "subject": commit.subject, "moved": _moved(before, commit)}
        )
        before = commit.environment
    return told[::-1]


def _moved(before: dict[str, str], commit: Commit) -> str:
    now = commit.environment
    names = sorted({*before, *now})
    return ", ".join(f"{k} {before.get(k, '-')} → {now.get(k, '-')}" for k in names if before.get(k) != now.get(k))


def _slug(name: str) -> str:
    return re.sub(r"[^A-Za-z0-9]+", "-", name).strip("-").lower()
