"""A table of scores as Markdown, CSV and LaTeX, from the same cells."""

from pathlib import Path

from reports.style import write_csv
from reports.tables import Table
from trajectories.files import write_text


def write_tables(table: Table, stem: Path) -> list[Path]:
    """Write `stem`.md, .csv and .tex."""
    paths = [stem.with_suffix(suffix) for suffix in (".md", ".csv", ".tex")]
    write_text(paths[0], markdown(table))
    write_text(paths[2], latex(table))
    columns = ["tracker"]
    for head in heads(table):
        columns += [head, f"{head} low", f"{head} high"]
    rows = []
    for name, cells in table.rows:
        row: list[object] = [name]
        for cell in cells:
            row += [cell.mean, cell.interval and cell.interval.low, cell.interval and cell.interval.high]
        rows.append(row)
    write_csv(paths[1], columns, rows)
    return paths


def heads(table: Table) -> list[str]:
    """Heads of the columns with their units."""
    return [f"{column.head} ({column.unit})" if column.unit else column.head for column in table.columns]


def markdown(table: Table) -> str:
    """The table in Markdown."""
    lines = ["| " + " | ".join(["tracker", *heads(table)]) + " |", "|" + " --- |" + " ---: |" * len(table.columns)]
    for name, cells in table.rows:
        shown = [
            f"{'**' + c.text + '**' if c.best else c.text}{chr(92) + '*' if c.significant else ''} {c.bounds}"
            for c in cells
        ]
        lines.append("| " + " | ".join([name, *(s.strip() for s in shown)]) + " |")
    lines += ["| " + " | ".join([name, *["absent"] * len(table.columns)]) + " |" for name in table.absent]
    return "\n".join([*lines, "", table.caption, ""])


def latex(table: Table) -> str:
    """The table in LaTeX for booktabs."""
    lines = [
        r"\begin{tabular}{l" + "r" * len(table.columns) + "}",
        r"\toprule",
        " & ".join(["tracker", *map(tex, heads(table))]) + r" \\",
    ]
    lines.append(r"\midrule")
    for name, cells in table.rows:
        shown = []
        for cell in cells:
            text = rf"\textbf{{{tex(cell.text)}}}" if cell.best else tex(cell.text)
            star = r"$^{*}$" if cell.significant else ""
            shown.append(text + star + (rf" {{\scriptsize {tex(cell.bounds)}}}" if cell.bounds else ""))
        lines.append(" & ".join([tex(name), *shown]) + r" \\")
    lines += [rf"{tex(name)} & \multicolumn{{{len(table.columns)}}}{{c}}{{absent}} \\" for name in table.absent]
    needs = "% needs \\usepackage{booktabs}"
    return "\n".join([f"% {table.caption}", needs, *lines, r"\bottomrule", r"\end{tabular}", ""])


def tex(text: str) -> str:
    """Text with LaTeX's special characters escaped."""
    escapes = {"%": r"\%", "_": r"\_", "&": r"\&", "#": r"\#", "$": r"\$", "\N{EN DASH}": "--", "\N{EM DASH}": "---"}
    return "".join(escapes.get(c, c) for c in text)
