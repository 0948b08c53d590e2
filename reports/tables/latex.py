"""A table of scores in LaTeX with booktabs, within the width of one or both columns of IEEEtran.

Columns that do not fit side by side are stacked, in further tabulars with the same rows. Widths are those of Times at a
fixed size, the font of IEEEtran, measured with STIX, which has the same metrics.
"""

from functools import lru_cache

from matplotlib.font_manager import FontProperties, get_font
from matplotlib.textpath import text_to_path

from uavbench.reports.fonts import FOLDER
from uavbench.reports.tables.columns import Column
from uavbench.reports.tables.summary_table import Cell, Table

ONE_COLUMN_PT, TWO_COLUMNS_PT = 252.0, 516.0
"""\\columnwidth and \\textwidth of IEEEtran."""
TEXT_PT, BOUNDS_PT, GAP_PT = 8.0, 6.0, 3.0
"""Font size of the text and of the intervals under it; half the space between two columns."""
SLACK = 1.03
"""Safety factor of widths, for kerning and TeX's rounding."""
FAMILY = FontProperties(fname=FOLDER / "STIXGeneral.ttf"), FontProperties(fname=FOLDER / "STIXGeneralBol.ttf")
"""Plain and bold."""
WIDEST = "\N{EM DASH}"
"""In place of a character that the font lacks: as wide as Chinese and Japanese ones, the widest there are."""
LAST_LATIN = "\u017f"
"""The last character that pdflatex knows without further packages and fonts."""
NEEDS_FONT = (
    "% Names have letters that pdflatex lacks: use XeLaTeX or LuaLaTeX with \\usepackage{fontspec} and a font of them."
)


def latex(table: Table, width_pt: float = TWO_COLUMNS_PT) -> str:
    """The table in LaTeX, width_pt wide at most, unless a single column is wider."""
    blocks = _blocks(table, width_pt)
    where = "table" if width_pt <= ONE_COLUMN_PT else "table*"
    head = [
        *(f"% {' '.join(line.split())}" for line in table.caption.split(". ") if line),
        f"% Needs \\usepackage{{booktabs}}; at most {width_pt:g} pt wide, for {where} of IEEEtran.",
        *([NEEDS_FONT] if max("".join(map(tex, _names(table)))) > LAST_LATIN else []),
        rf"{{\fontsize{{{TEXT_PT:g}}}{{{1.2 * TEXT_PT:g}}}\selectfont\setlength{{\tabcolsep}}{{{GAP_PT:g}pt}}%",
    ]
    return "\n".join([*head, "\n\\par\\smallskip\n".join(_tabular(table, block) for block in blocks), "}", ""])


def tex(text: str) -> str:
    """Text with LaTeX's special characters escaped; neighbouring hyphens, which would become a dash, are parted."""
    pairs = zip(text, f"{text[1:]} ", strict=True)
    return "".join(ESCAPES.get(c, c) + "{}" * (c == following == "-") for c, following in pairs)


def _row_name(name: str) -> str:
    r"""A name at the start of a row, where `[` or `*` would be taken as an argument of the row's end before it."""
    return "{}" * name.startswith(("[", "*")) + tex(name)


ESCAPES = {
    **{c: f"\\{c}" for c in "%_&#${}"},
    "\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}",
    "<": r"\textless{}", ">": r"\textgreater{}", "|": r"\textbar{}", '"': r"\textquotedbl{}",
    "\N{EN DASH}": "--", "\N{EM DASH}": "---", "\N{DEGREE SIGN}": r"$^{\circ}$",
}  # fmt: skip


def _names(table: Table) -> list[str]:
    """The first column of a table, with its head."""
    return [table.of, *(name for name, _ in table.rows), *table.absent]


def _blocks(table: Table, width_pt: float) -> list[list[int]]:
    """Indices of the columns of each tabular, as many side by side as fit."""
    names = _widest([(name, TEXT_PT, False) for name in _names(table)])
    blocks: list[list[int]] = [[]]
    used = names
    for k, column in enumerate(table.columns):
        width = 2 * GAP_PT + _column_width(column, [cells[k] for _, cells in table.rows])
        if blocks[-1] and used + width > width_pt:
            blocks.append([])
            used = names
        blocks[-1].append(k)
        used += width
    return blocks


def _column_width(column: Column, cells: list[Cell]) -> float:
    texts = [(_head(column), TEXT_PT, False), (_unit(column), BOUNDS_PT, False)]
    for cell in cells:
        texts += [(cell.text + "*" * cell.significant, TEXT_PT, cell.best), (cell.bounds, BOUNDS_PT, False)]
    return _widest(texts)


def _widest(texts: list[tuple[str, float, bool]]) -> float:
    return SLACK * max(_width_pt(*text) for text in texts)


@lru_cache(maxsize=4096)
def _width_pt(text: str, size_pt: float, bold: bool) -> float:
    """Width of a line of text in pt."""
    font = FAMILY[bold].copy()
    font.set_size(size_pt)
    glyphs = get_font(str(font.get_file())).get_charmap()
    known = "".join(c if ord(c) in glyphs else WIDEST for c in text)
    width: float = text_to_path.get_text_width_height_descent(known, font, ismath=False)[0] if text else 0.0
    return width


def _tabular(table: Table, columns: list[int]) -> str:
    chosen = [table.columns[k] for k in columns]
    lines = [
        rf"\begin{{tabular}}{{@{{}}l{'r' * len(columns)}@{{}}}}",
        r"\toprule",
        " & ".join([table.of, *(tex(_head(column)) for column in chosen)]) + r" \\",
        " & ".join(["", *(_small(_unit(column)) for column in chosen)]) + r" \\",
    ]
    rate: str | None = None
    for name, cells in table.rows:
        now = name.rpartition("@")[2] if "@" in name else ""
        if now != rate:
            lines.append(r"\midrule")
            rate = now
        shown = [cells[k] for k in columns]
        lines.append(" & ".join([_row_name(name), *map(_value, shown)]) + r" \\")
        if any(cell.bounds for cell in shown):
            lines.append(" & ".join(["", *(_small(cell.bounds) for cell in shown)]) + r" \\")
    lines += [rf"{_row_name(name)} & \multicolumn{{{len(columns)}}}{{c}}{{absent}} \\" for name in table.absent]
    return "\n".join([*lines, r"\bottomrule", r"\end{tabular}"])


def _head(column: Column) -> str:
    return column.short or column.head


def _unit(column: Column) -> str:
    return f"({column.unit})" if column.unit else ""


def _value(cell: Cell) -> str:
    text = rf"\textbf{{{tex(cell.text)}}}" if cell.best else tex(cell.text)
    return text + (r"$^{*}$" if cell.significant else "")


def _small(text: str) -> str:
    return rf"\fontsize{{{BOUNDS_PT:g}}}{{{1.2 * BOUNDS_PT:g}}}\selectfont {tex(text)}" if text else ""
