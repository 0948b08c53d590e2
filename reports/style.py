"""Style of all figures: exact IEEE widths, embedded TrueType fonts, the same bytes on every run."""

import csv
import gc
import io
import warnings
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, cast

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure, SubFigure
from matplotlib.text import Text

from uavbench.reports.fonts import FAMILIES, name_fonts
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.origin import owning, refuse_foreign_file
from uavbench.trajectories.files.seals import is_sealed_with
from uavbench.trajectories.files.writing import new_file
from uavbench.trajectories.pose import Array

ONE_COLUMN_IN = 3.50
TWO_COLUMNS_IN = 7.16
PNG_DPI = 220
LONGEST_NAME = 24
"""Characters of a tracker's name beside an axis: 1 in at 7 pt."""
MOST_TILTED = 6
"""Most names under a quarter of 7.16 in that do not overlap when tilted; more stand upright."""
GAP = "\N{HORIZONTAL ELLIPSIS}"
SHORTEST_LABEL = 12
"""Characters that are left of a label or a title at least."""
LEGEND_ROWS, LEGEND_ROW_IN = 5, 0.16
"""Rows of a legend for which the height of a figure has room, and the height in inches of each further one."""
HEIGHTS = 4
"""Heights of a figure that are tried."""
NO_METADATA: dict[str, dict[str, Any]] = {
    ".pdf": {"CreationDate": None, "Producer": None, "Creator": None},
    ".png": {"Software": None},
}
"""Metadata without dates or versions, so that files are reproducible byte for byte."""

GROUND_TRUTH = "#111111"
LOSS = "#D9D9D9"
COLOURS = ("#2C458C", "#E82267", "#9EB300", "#67001C", "#AE74F7", "#735F0C", "#FDA1DC", "#50EEAC")
"""One per tracker: 8 L* apart at least, so distinct in grey, and under the three dichromacies (Machado et al. 2009)."""
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "*")
DASHES: tuple[Any, ...] = ("-", (0, (5, 1.5)), (0, (3, 1, 1, 1)), (0, (1, 1)), (0, (7, 2, 1, 2)), "--", "-.", ":")

RC: dict[str, Any] = {
    "font.family": list(FAMILIES),
    "mathtext.fontset": "stix",
    "font.size": 8.0,
    "axes.titlesize": 8.0,
    "axes.labelsize": 8.0,
    "xtick.labelsize": 7.0,
    "ytick.labelsize": 7.0,
    "legend.fontsize": 7.0,
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "axes.grid": True,
    "grid.color": "#E6E6E6",
    "grid.linewidth": 0.5,
    "lines.linewidth": 1.0,
    "lines.markersize": 3.5,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.major.size": 2.5,
    "ytick.major.size": 2.5,
    "xtick.minor.size": 0.0,
    "ytick.minor.size": 0.0,
    "legend.frameon": False,
    "legend.handlelength": 2.0,
    "legend.columnspacing": 1.2,
    "legend.borderaxespad": 0.3,
    "figure.dpi": PNG_DPI,
    "savefig.bbox": None,
    "pdf.fonttype": 42,
    "ps.fonttype": 42,
    "svg.fonttype": "none",
    "svg.hashsalt": "uavbench",
    "image.interpolation": "antialiased",
    "path.simplify_threshold": 0.2,
}


@contextmanager
def house_style() -> Iterator[None]:
    """Context in which figures have the style of the reports, regardless of the user's matplotlibrc."""
    name_fonts()
    with mpl.rc_context(), _what_is_there_uncollected():
        mpl.rcdefaults()
        mpl.rcParams.update(cast(Any, RC))
        yield


@contextmanager
def _what_is_there_uncollected() -> Iterator[None]:
    """Context in which the garbage collector scans new objects only.

    A figure has thousands of objects in reference cycles, which trigger full collections over everything imported: a
    tenth of the time of a report.
    """
    if gc.get_freeze_count():  # frozen by the calling program
        yield
        return
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()


def new_figure(height_in: float, *, wide: bool = True) -> Figure:
    """Empty figure, 7.16 in wide or 3.50 in, laid out by constraints; unknown to pyplot."""
    figure = Figure(figsize=(TWO_COLUMNS_IN if wide else ONE_COLUMN_IN, height_in), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def given_axes(axes: Axes | None) -> Axes:
    """The given Axes, or that of a new pyplot figure, which a notebook shows; UserError for something else."""
    if axes is not None and not isinstance(axes, Axes):
        raise UserError(f"axes is {type(axes).__name__}; give one matplotlib Axes, as figure.subplots() makes")
    return given_figure(None).subplots() if axes is None else axes


def given_figure(figure: Figure | SubFigure | None) -> Figure | SubFigure:
    """The given figure, or a new pyplot one, 7.16 in wide with constrained layout; UserError for something else."""
    if figure is not None and not isinstance(figure, Figure | SubFigure):
        raise UserError(f"figure is {type(figure).__name__}; give a matplotlib Figure, as pyplot.figure() makes")
    if figure is not None:
        return figure
    from matplotlib import pyplot

    return pyplot.figure(figsize=(TWO_COLUMNS_IN, 3.5), layout="constrained")


def save_figure(
    figure: Figure,
    stem: Path,
    columns: Sequence[str] = (),
    rows: Iterable[Sequence[Any]] = (),
    suffixes: Sequence[str] = (".pdf", ".png"),
    kind: str = "",
) -> list[Path]:
    """Write `stem`.pdf, .png, and the numbers behind it as .csv where there are columns.

    kind: as in `new_file`, for a figure outside a report.
    """
    numbers = stem.with_name(stem.name + ".csv")
    if kind:
        refuse_foreign_figure(stem, suffixes, kind)
    layout = figure.get_layout_engine()
    if layout is not None:  # once, not once per file
        lay_out(figure)
        figure.set_layout_engine(None)
    figures = [stem.with_name(stem.name + suffix) for suffix in suffixes]
    if columns:
        with owning([numbers] if kind else []):
            write_csv(numbers, columns, rows)
    for suffix, path in zip(suffixes, figures, strict=True):
        with new_file(path, kind=kind, beside=numbers if columns else None) as temporary:
            drawn = io.BytesIO()  # matplotlib raises something else where the disk of a PDF is full
            figure.savefig(drawn, format=suffix[1:], dpi=PNG_DPI, metadata=NO_METADATA[suffix])
            temporary.write_bytes(drawn.getbuffer())
    return [*figures, numbers] if columns else figures


def lay_out(figure: Figure) -> None:
    """Lay a figure out by its constraints, higher by a half where its labels leave no room for a panel."""
    layout = figure.get_layout_engine()
    assert layout is not None
    for _ in range(HEIGHTS):
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            layout.execute(figure)
        if not any("constrained_layout not applied" in str(each.message) for each in told):
            break
        figure.set_figheight(1.5 * figure.get_figheight())
    _move_titles_within(figure)


def short_names(names: Sequence[str], longest: int = LONGEST_NAME) -> list[str]:
    """The names with at most `longest` characters: long ones without their middles, which say which where all is alike.

    Equal names stay equal, and different ones different.
    """
    cut = [_without_middle(name, longest) for name in names]
    places = {name: k for k, name in enumerate(dict.fromkeys(names), 1)}
    alike = {short: {name for name, other in zip(names, cut, strict=True) if other == short} for short in cut}
    return [
        short if len(alike[short]) == 1 else _without_middle(name, longest, f"{GAP}({places[name]}){GAP}")
        for name, short in zip(names, cut, strict=True)
    ]


def _without_middle(name: str, longest: int, gap: str = GAP) -> str:
    """The name, with a gap for its middle where it is longer than `longest`."""
    if len(name) <= longest:
        return name
    tail = longest // 2
    return name[: max(longest - tail - len(gap), 1)] + gap + name[-tail:]


def draw_legend(
    place: Axes | Figure | SubFigure, handles: Sequence[Any], labels: Sequence[str], *, ncols: int, **options: Any
) -> float:
    """Draw a legend on an Axes, or above the Axes of a figure, that is not wider than either.

    It has `ncols` columns, or fewer of long labels; those that are too long for one column lose their middles, as in
    `short_names`. Returns by how much higher a figure should be for its rows, in inches.
    """
    if not labels:
        return 0.0
    above = {} if isinstance(place, Axes) else {"loc": "outside upper center"}
    columns, longest, shown = ncols, max(map(len, labels)), list(labels)
    while True:
        legend = place.legend(handles, shown, ncols=columns, **{**above, **options})
        excess = legend.get_window_extent().width / place.bbox.width
        if excess <= 1 or longest <= SHORTEST_LABEL:
            break
        legend.remove()
        if columns > 1:
            columns -= 1
        else:
            longest = max(min(longest - 1, int(longest / excess)), SHORTEST_LABEL)
            shown = short_names(labels, longest)
    rows, usual = (-(-len(labels) // n) for n in (columns, ncols))
    return LEGEND_ROW_IN * max(0, rows - min(usual, LEGEND_ROWS))


def _move_titles_within(figure: Figure) -> None:
    """Move titles of a figure that is laid out into it; those that are wider lose the middles of their lines."""
    for axes in figure.axes:
        titles = [each for each in axes.get_children() if isinstance(each, Text) and each not in axes.texts]
        for title in (title for title in titles if title.get_text()):
            lines = title.get_text().split("\n")
            longest = max(map(len, lines))
            while (box := title.get_window_extent()).width > figure.bbox.width and longest > SHORTEST_LABEL:
                longest = min(longest - 1, int(longest * figure.bbox.width / box.width))
                title.set_text("\n".join(short_names(lines, longest)))
            beyond = max(box.x1 - figure.bbox.x1, 0) + min(box.x0 - figure.bbox.x0, 0)
            if beyond:
                title.set_x(title.get_position()[0] - beyond / axes.bbox.width)


def refuse_foreign_figure(stem: Path, suffixes: Sequence[str], kind: str) -> None:
    """UserError when a file of a sealed figure, or of its numbers, exists and is not an unmodified one of this kind."""
    numbers = stem.with_name(stem.name + ".csv")
    figures = [stem.with_name(stem.name + suffix) for suffix in suffixes]
    for path in figures:
        refuse_foreign_file(path, kind)
    with owning([numbers] if any(is_sealed_with(path, numbers) for path in figures) else []):
        refuse_foreign_file(numbers)


def write_csv(path: Path, columns: Sequence[str], rows: Iterable[Sequence[Any]]) -> None:
    """Write a table; floats with nine significant digits, None as an empty cell."""
    with new_file(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as handle:
        writer = csv.writer(handle, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows([_cell(value) for value in row] for row in rows)


def colour(index: int) -> str:
    """Colour of the tracker with an index, repeating after the last."""
    return COLOURS[index % len(COLOURS)]


def line(index: int, slower: bool = False) -> dict[str, Any]:
    """Line style of the tracker with an index: colour and dashes; thin and pale for a slower rate."""
    weight = {"lw": 0.6, "alpha": 0.6} if slower else {}
    return {"color": colour(index), "linestyle": _of_all(DASHES, index), **weight}


def marker(index: int) -> dict[str, Any]:
    """Marker style of the tracker with an index: colour and marker."""
    return {"color": colour(index), "marker": _of_all(MARKERS, index), "linestyle": "none"}


def _of_all(styles: Sequence[Any], index: int) -> Any:
    """The style of an index, another one for each of those that share a colour."""
    return styles[(index + index // len(COLOURS)) % len(styles)]


def dots_where_alone(values: Array) -> dict[str, Any]:
    """Markers for the values (n,) of a line that have a NaN on both sides, where no line is drawn; {} without any."""
    known = np.pad(np.isfinite(values), 1)
    alone = np.flatnonzero(known[1:-1] & ~known[:-2] & ~known[2:])
    return {"marker": ".", "ms": 2.5, "markevery": alone.tolist()} if len(alone) else {}


def legend_columns(labels: Sequence[str]) -> int:
    """Columns of a legend in a figure 3.50 in wide: three of short labels, fewer of long ones."""
    longest = max(map(len, labels), default=0)
    return 3 if longest <= LABEL_OF_THREE else 2 if longest <= LABEL_OF_TWO else 1


LABEL_OF_THREE, LABEL_OF_TWO = 18, 32
"""Characters of a label at 7 pt, with its line, in a third and in half of 3.50 in."""


def panel_letter(axes: Axes, letter: str) -> None:
    """Write (a), (b) ... above an axes, at its left; nothing for an empty letter."""
    if letter:
        axes.set_title(f"({letter})", loc="left", fontweight="bold", fontsize=8)


def _cell(value: Any) -> Any:
    if value is None:
        return ""
    if isinstance(value, float):
        return f"{value:.9g}"
    return value
