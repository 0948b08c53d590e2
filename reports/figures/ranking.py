"""Figures of paired comparisons: mean ranks, and win rates."""

from collections.abc import Mapping
from collections.abc import Sequence as ListOf
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from uavbench.reports.figures.figure_files import Drawn, finite, save_panel
from uavbench.reports.statistics.bootstrap import Comparison, Ranks, least_units
from uavbench.reports.style import GROUND_TRUTH, colour, marker, short_names

CHARACTER, RANK_CHARACTERS = 0.0135, 7
"""Width of a character at 7 pt in widths of 3.50 in, and characters of a mean rank beside a name."""
RANK = 0.04
"""Width of a rank of two digits with its gap at 7 pt, in widths of 3.50 in."""


def critical_difference(found: Ranks, colours: Mapping[str, int], stem: Path, what: str) -> list[Path]:
    """Write `draw_critical_difference` as files at a stem; their paths."""
    half = (len(found.mean_ranks) + 1) // 2
    return save_panel(partial(draw_critical_difference, found, colours, what), stem, 0.95 + 0.17 * half)


def draw_critical_difference(found: Ranks, colours: Mapping[str, int], what: str, panel: Axes) -> Drawn:
    """Critical-difference diagram (Demsar 2006): mean ranks, best at the left; bars join equivalent trackers.

    colours: index of a colour by tracker; what: the ranked metric.
    """
    names = sorted(found.mean_ranks, key=lambda name: found.mean_ranks[name])
    k, half = len(names), (len(names) + 1) // 2
    labels = short_names(names)
    share = CHARACTER * (max(map(len, labels)) + RANK_CHARACTERS)
    reach = max(0.45 * k, (share * (k - 1) + 0.1) / (1 - 2 * share))
    panel.set_xlim(1 - reach, k + reach)
    panel.set_ylim(-half - 1.7, 2.0)
    panel.axis("off")
    panel.plot([1, k], [0, 0], color=GROUND_TRUTH, lw=0.8)
    for tick in range(1, k + 1, int(np.ceil(RANK * (k - 1 + 2 * reach)))):
        panel.plot([tick, tick], [0, 0.15], color=GROUND_TRUTH, lw=0.8)
        panel.text(tick, 0.25, str(tick), ha="center", va="bottom", fontsize=7)
    for place, (name, shown) in enumerate(zip(names, labels, strict=True)):
        at_left = place < half
        rank, y = found.mean_ranks[name], -1.0 - (place if at_left else k - 1 - place)
        end, index = (0.9 if at_left else k + 0.1), colours.get(name, 0)
        panel.plot([rank, rank, end], [0, y, y], color=colour(index), lw=0.8)
        panel.plot(rank, 0, **marker(index))
        text = f"{shown}  {rank:.2f} " if at_left else f" {rank:.2f}  {shown}"
        panel.text(end, y, text, ha="right" if at_left else "left", va="center", fontsize=7)
    for level, group in enumerate(found.cliques):
        ends = [found.mean_ranks[name] for name in group]
        height = -0.28 - 0.2 * level
        panel.plot([min(ends) - 0.04, max(ends) + 0.04], [height] * 2, color="#444444", lw=2.2, solid_capstyle="butt")
    width, text = found.critical_difference, f"CD: n/a, {least_units()} runs are needed"
    if np.isfinite(width):
        text, ends = f"CD = {width:.2f}", [1, 1, 1, 1 + width, 1 + width, 1 + width]
        panel.plot(ends, [1.15, 1.45, 1.3, 1.3, 1.15, 1.45], color=GROUND_TRUTH, lw=0.9)
    panel.text(1 + min(width, k - 1) / 2, 1.45, text, va="bottom", ha="center", fontsize=7)
    note = f"mean rank by {what}; n = {found.n}, best at the left"
    panel.text((k + 1) / 2, -half - 1.6, note, ha="center", va="bottom", fontsize=7)
    rows = sorted(found.mean_ranks.items(), key=lambda item: item[1])
    return Drawn(columns=["tracker", "mean_rank"], rows=rows, legend=None)


def win_table(names: ListOf[str], comparisons: ListOf[Comparison], stem: Path, what: str) -> list[Path]:
    """Write `draw_win_table` as files at a stem; their paths."""
    return save_panel(partial(draw_win_table, names, comparisons, what), stem, 1.0 + 0.28 * len(names))


def draw_win_table(names: ListOf[str], comparisons: ListOf[Comparison], what: str, panel: Axes) -> Drawn:
    """Percentage of runs in which the row beats the column; a star marks differences significant at the 5 % level.

    what: the compared metric.
    """
    wins = np.full((len(names), len(names)), np.nan)
    star = np.zeros(wins.shape, dtype=bool)
    for c in comparisons:
        a, b = names.index(c.first), names.index(c.second)
        wins[a, b], wins[b, a] = 100 * c.wins, 100 * (1 - c.wins)
        star[a, b] = star[b, a] = c.significant
    needed = least_units(len(comparisons))
    few = max((c.units for c in comparisons), default=0) < needed
    panel.imshow(np.nan_to_num(wins, nan=50), cmap="cividis", vmin=0, vmax=100, aspect="auto", alpha=0.85)
    panel.grid(False)
    for (row, column), value in np.ndenumerate(wins):
        if np.isfinite(value):
            text = f"{value:.0f}{'*' if star[row, column] else ''}"
            panel.text(
                column, row, text, ha="center", va="center", color="white" if value < 50 else "black", fontsize=7
            )
    shown = short_names(names)
    panel.set_xticks(range(len(names)), shown, rotation=30, ha="right")
    panel.set_yticks(range(len(names)), shown)
    note = f"\nsignificance n/a: {needed} independent runs are needed" if few else ""
    panel.set_title(f"row beats column, % of runs, by {what}{note}", fontsize=7.5)
    rows = [
        [
            c.first,
            c.second,
            c.wins,
            c.difference.mean,
            *map(finite, (c.difference.low, c.difference.high)),
            c.p,
            c.units,
        ]
        for c in comparisons
    ]
    columns = ["first", "second", "wins", "difference", "low", "high", "p_holm", "units"]
    return Drawn(columns=columns, rows=rows, legend=None)
