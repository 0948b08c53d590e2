"""A table of scores as Markdown, CSV and LaTeX, from the same cells."""

from pathlib import Path

from uavbench.reports.style import write_csv
from uavbench.reports.tables.columns import COLUMNS, DETAILS, ONE_COLUMN, TWO_COLUMNS
from uavbench.reports.tables.latex import ONE_COLUMN_PT, TWO_COLUMNS_PT, latex
from uavbench.reports.tables.summary_table import Cell, Table
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.writing import write_text

OWN_TABLE = "table of a report"
"""Kind of a table that a user asks for."""
WIDTHS = {"one": ONE_COLUMN_PT, "two": TWO_COLUMNS_PT}
"""Widths of a LaTeX table in pt, by the number of columns of the page that it takes."""


def write_tables(table: Table, stem: Path) -> list[Path]:
    """Write `stem`.md, .csv and .tex, each with all columns; the paths."""
    return [write_table(table, stem.with_name(stem.name + suffix)) for suffix in (".md", ".csv", ".tex")]


def write_summary(table: Table, stem: Path) -> list[Path]:
    """Write `stem`.md and .csv with all columns, `stem`.tex and `stem`_one_column.tex with a selection; the paths.

    UserError when the table lacks one of TWO_COLUMNS or ONE_COLUMN.
    """
    wide = write_table(table.select(TWO_COLUMNS), stem.with_name(f"{stem.name}.tex"))
    narrow = write_table(table.select(ONE_COLUMN), stem.with_name(f"{stem.name}_one_column.tex"), ONE_COLUMN_PT)
    return [*(write_table(table, stem.with_name(stem.name + suffix)) for suffix in (".md", ".csv")), wide, narrow]


def write_table(table: Table, path: Path, width_pt: float = TWO_COLUMNS_PT, *, kind: str = "") -> Path:
    """Write a table as .md, .csv or .tex, by the suffix; width_pt: of LaTeX. UserError for any other suffix.

    kind: as in `new_file`, for a table outside a report; CSV, which programs expect without comments, is not sealed.
    """
    if path.suffix == ".csv":
        write_csv(path, *_numbers(table))
    elif path.suffix in (".md", ".tex"):
        write_text(path, markdown(table) if path.suffix == ".md" else latex(table, width_pt), kind=kind)
    else:
        raise UserError(f"{path}: a table is written as .md, .csv or .tex")
    return path


def heads_of(text: str) -> list[str]:
    """Column heads of a comma-separated list; heads that contain a comma are recognized."""
    parts, found = [part.strip() for part in text.split(",")], []
    commas = {column.head for column in (*COLUMNS, *DETAILS) if "," in column.head}
    while parts:
        pair = ", ".join(parts[:2])
        found.append(pair if pair in commas else parts[0])
        parts = parts[2 if pair in commas else 1 :]
    return found


def heads(table: Table) -> list[str]:
    """Heads of the columns with their units."""
    return [f"{column.head} ({column.unit})" if column.unit else column.head for column in table.columns]


def markdown(table: Table) -> str:
    """The table in Markdown."""
    lines = [_row([table.of, *heads(table)]), "|" + " --- |" + " ---: |" * len(table.columns)]
    lines += [_row([name, *map(_shown, cells)]) for name, cells in table.rows]
    lines += [_row([name, *["absent"] * len(table.columns)]) for name in table.absent]
    return "\n".join([*lines, "", table.caption, ""])


def _row(cells: list[str]) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def _shown(cell: Cell) -> str:
    text = f"**{cell.text}**" if cell.best else cell.text
    return f"{text}{chr(92) + '*' if cell.significant else ''} {cell.bounds}".strip()


def _numbers(table: Table) -> tuple[list[str], list[list[object]]]:
    """Heads and rows of the CSV: mean and interval of each column, `n/a` for an undefined interval."""
    columns = [table.of]
    for head in heads(table):
        columns += [head, f"{head} low", f"{head} high"]
    rows = []
    for name, cells in table.rows:
        row: list[object] = [name]
        for cell in cells:
            row.append(cell.mean)
            if cell.why:
                row += ["n/a", "n/a"]
            else:
                row += [cell.interval and cell.interval.low, cell.interval and cell.interval.high]
        rows.append(row)
    return columns, rows
