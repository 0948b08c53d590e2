"""Figures of trackers with long names: the names are told apart, lie within the figure, and leave room for panels."""

import warnings
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest

from uavbench.reports import style
from uavbench.reports.figures.figure_files import LONGEST_NAME, short_names
from uavbench.reports.figures.ranking import critical_difference, draw_critical_difference, draw_win_table, win_table
from uavbench.reports.statistics.bootstrap import compare_pairs, ranks
from uavbench.reports.style import house_style, new_figure, save_figure

LONG = [f"a-tracker-whose-name-says-all-of-its-{kind}-parameters-and-more@15hz" for kind in ("first", "second", "next")]


def test_short_names_are_kept_and_long_ones_told_apart() -> None:
    assert short_names(["robust", "lsd@15hz"]) == ["robust", "lsd@15hz"]
    found = short_names([*LONG, "lsd", LONG[0]])
    assert len(set(found)) == 4 and found[0] == found[4] and found[3] == "lsd"
    assert max(map(len, found)) <= LONGEST_NAME
    ends = [f"{LONG[0]}-{k}" for k in range(3)]
    assert [name[-2:] for name in short_names(ends)] == ["-0", "-1", "-2"]


@pytest.mark.parametrize("count", [2, 3])
def test_rankings_of_long_names_lie_within_their_figures_without_a_warning(tmp_path: Path, count: int) -> None:
    rng = np.random.default_rng(0)
    values = {name: [rng.uniform(size=1) for _ in range(8)] for name in LONG[:count]}
    ranked = ranks({name: np.concatenate(blocks) for name, blocks in values.items()})
    with warnings.catch_warnings(), house_style():
        warnings.simplefilter("error")
        win_table(list(values), compare_pairs(values), tmp_path / "wins", "error")
        critical_difference(ranked, dict.fromkeys(values, 0), tmp_path / "ranks", "error")
        for draw in (
            lambda panel: draw_win_table(list(values), compare_pairs(values), "error", panel),
            lambda panel: draw_critical_difference(ranked, dict.fromkeys(values, 0), "error", panel),
        ):
            figure = new_figure(1.6, wide=False)
            draw(figure.subplots())
            style.lay_out(figure)
            figure.canvas.draw()
            texts = [text for text in figure.findobj(plt.Text) if "tracker" in text.get_text()]
            boxes = [text.get_window_extent() for text in texts]
            assert len(boxes) >= count
            assert min(box.x0 for box in boxes) >= 0 and max(box.x1 for box in boxes) <= figure.bbox.x1


def test_a_figure_whose_labels_leave_no_room_is_higher_and_no_warning_shows_a_path(tmp_path: Path) -> None:
    figure = new_figure(0.6)
    panel = figure.subplots()
    panel.set_xlabel("time\n" * 7)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        save_figure(figure, tmp_path / "tall")
    assert figure.get_figheight() > 1.0 and panel.get_position().height > 0
