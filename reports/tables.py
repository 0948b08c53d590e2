"""Tables of scores: Markdown, CSV and LaTeX from the same cells."""

from collections.abc import Sequence as ListOf
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from reports.score import Score
from reports.style import write_csv
from trajectories.files import write_text


@dataclass(frozen=True)
class Cell:
    """A number as it is shown, with its uncertainty and whether it is the best of its column."""

    value: float | None
    text: str
    best: bool = False
    significant: bool = False


@dataclass(frozen=True)
class Table:
    """Heads (k) and, per row, a name and k - 1 cells."""

    caption: str
    heads: tuple[str, ...]
    units: tuple[str, ...]
    rows: tuple[tuple[str, tuple[Cell, ...]], ...]


COLUMNS: tuple[tuple[str, str, str, int], ...] = (
    ("coverage", "%", "max", 1),
    ("within 5 cm, 5 deg", "%", "max", 1),
    ("AUC 10 cm", "", "max", 2),
    ("ATE position", "cm", "min", 2),
    ("ATE rotation", "deg", "min", 2),
    ("RPE 1 frame", "cm", "min", 2),
    ("RPE 1 s", "cm", "min", 2),
    ("failures", "1/min", "min", 1),
    ("first loss", "s", "max", 1),
    ("frame p50", "ms", "min", 1),
    ("frame p95", "ms", "min", 1),
)
"""Head, unit, which is best, decimals."""


def numbers(score: Score) -> tuple[float | None, ...]:
    """The numbers of a score in the order of COLUMNS; None where there is none."""
    ate, tracking, total = score.ate["none"], score.tracking, score.latency.get("total")
    one_frame, one_second = score.rpe["1 frame"], score.rpe["1 s"]
    return (
        100 * tracking.coverage,
        100 * tracking.success,
        tracking.success_auc,
        100 * ate.translation_m.rmse if ate.translation_m else None,
        ate.rotation_deg.rmse if ate.rotation_deg else None,
        100 * one_frame.translation_m.rmse if one_frame.translation_m else None,
        100 * one_second.translation_m.rmse if one_second.translation_m else None,
        tracking.failures_per_minute,
        tracking.time_to_first_loss_s,
        total.p50_ms if total else None,
        total.p95_ms if total else None,
    )


def summary_table(scores: ListOf[Score]) -> Table:
    """One row per tracker and rate, means over its sequences and seeds; the worst kept rows come first."""
    groups: dict[str, list[Score]] = {}
    for score in scores:
        groups.setdefault(score.run, []).append(score)
    means = {run: _means(group) for run, group in groups.items()}
    order = sorted(groups, key=lambda run: (-groups[run][0].rate_hz, means[run][1] or 0.0))
    best = {}
    for k, (_, _, which, _) in enumerate(COLUMNS):
        known = [means[run][k] for run in order if means[run][k] is not None]
        best[k] = (max if which == "max" else min)(known) if known else None  # type: ignore[type-var]
    rows = tuple(
        (run, tuple(_cell(value, decimals, value is not None and value == best[k])
                    for k, (value, (_, _, _, decimals)) in enumerate(zip(means[run], COLUMNS, strict=True))))
        for run in order
    )  # fmt: skip
    return Table(
        "Means over sequences and seeds. Errors are RMSE over the frames that have a pose: read them with coverage.",
        ("tracker", *(head for head, *_ in COLUMNS)),
        ("", *(unit for _, unit, *_ in COLUMNS)),
        rows,
    )


def write_tables(table: Table, stem: Path) -> list[Path]:
    """Write `stem`.md, .csv and .tex."""
    heads = [f"{h} ({u})" if u else h for h, u in zip(table.heads, table.units, strict=True)]
    paths = [stem.with_suffix(suffix) for suffix in (".md", ".csv", ".tex")]
    write_text(paths[0], markdown(table, heads))
    write_csv(paths[1], heads, [[name, *(c.value for c in cells)] for name, cells in table.rows])
    write_text(paths[2], latex(table, heads))
    return paths


def markdown(table: Table, heads: ListOf[str]) -> str:
    """The table in Markdown, the best of a column bold."""
    lines = ["| " + " | ".join(heads) + " |", "|" + " --- |" + " ---: |" * (len(heads) - 1)]
    for name, cells in table.rows:
        shown = [f"**{c.text}**" if c.best else c.text for c in cells]
        lines.append(
            "| " + " | ".join([name, *(s + "\\*" * c.significant for s, c in zip(shown, cells, strict=True))]) + " |"
        )
    return "\n".join([*lines, "", table.caption, ""])


def latex(table: Table, heads: ListOf[str]) -> str:
    """The table in LaTeX for booktabs, the best of a column bold, a star where it is significant."""
    lines = [
        r"\begin{tabular}{l" + "r" * (len(heads) - 1) + "}",
        r"\toprule",
        " & ".join(map(tex, heads)) + r" \\",
        r"\midrule",
    ]
    for name, cells in table.rows:
        shown = [(rf"\textbf{{{tex(c.text)}}}" if c.best else tex(c.text)) + r"$^{*}$" * c.significant for c in cells]
        lines.append(" & ".join([tex(name), *shown]) + r" \\")
    return "\n".join(
        [f"% {table.caption}", "% needs \\usepackage{booktabs}", *lines, r"\bottomrule", r"\end{tabular}", ""]
    )


def tex(text: str) -> str:
    """Text with LaTeX's special characters escaped."""
    escapes = {"%": r"\%", "_": r"\_", "&": r"\&", "#": r"\#", "$": r"\$", "±": r"$\pm$", "–": "--", "—": "---"}
    return "".join(escapes.get(c, c) for c in text)


def _cell(value: float | None, decimals: int, best: bool) -> Cell:
    return Cell(value, "—" if value is None else f"{value:.{decimals}f}", best)


def _means(group: ListOf[Score]) -> tuple[float | None, ...]:
    columns = zip(*(numbers(score) for score in group), strict=True)
    return tuple(float(np.mean(k)) if (k := [v for v in column if v is not None]) else None for column in columns)
