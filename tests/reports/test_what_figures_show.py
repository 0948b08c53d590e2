"""What figures and their captions say of runs whose numbers are known."""

import json
import warnings
from dataclasses import replace
from functools import partial
from itertools import pairwise

import cv2
import numpy as np
import pytest

from tests.reports.drawn import results_of, true_rows
from tests.reports.test_closed_loop_report import score
from tests.reports.test_flight_score import flown, path
from uavbench.reports.closed_loop.figure import draw_flight_in_closed_loop
from uavbench.reports.closed_loop.tables import FlightNotes, table, why_failed
from uavbench.reports.comparison_figures import compare
from uavbench.reports.figures.comparison import LEAST_SHOWN, draw_accuracy_and_coverage
from uavbench.reports.figures.distributions import draw_error_over_bound
from uavbench.reports.figures.figure_files import Drawn, save_panel
from uavbench.reports.figures.ranking import draw_critical_difference
from uavbench.reports.figures.space import draw_error_against_distance, draw_paths
from uavbench.reports.many_runs.figures import dots, fit_scale, name_trackers
from uavbench.reports.scoring import attributes
from uavbench.reports.scoring.attributes import breakdowns
from uavbench.reports.scoring.runs import ReportEntry, open_runs
from uavbench.reports.scoring.score import score as score_run
from uavbench.reports.scoring.score_frame import score_frame
from uavbench.reports.statistics.bootstrap import Ranks
from uavbench.reports.style import dots_where_alone, house_style, line, marker, new_figure, save_figure
from uavbench.reports.tables.summary_table import summary_table
from uavbench.tracker.protocol import TrackResult


def test_the_errors_over_the_bound_are_a_distribution_in_steps():
    panel = new_figure(2.1, wide=False).subplots()
    draw_error_over_bound({"a": np.array([8.0, 2.0, np.inf, 4.0])}, {}, panel)
    curve = panel.lines[0]
    assert curve.get_drawstyle() == "steps-post"
    assert np.transpose(curve.get_data()).tolist() == [[2, 0], [2, 25], [4, 50], [8, 75]]


@pytest.mark.parametrize(("critical", "bars"), [(1.5, 1), (np.nan, 0), (np.inf, 0)])
def test_a_critical_difference_that_is_not_known_has_no_length(critical, bars):
    found = Ranks(mean_ranks={"a": 1.0, "b": 2.0}, critical_difference=critical, p=np.nan, n=2)
    panel = new_figure(1.3, wide=False).subplots()
    draw_critical_difference(found, {}, "error", panel)
    assert sum(line.get_ydata().tolist()[:1] == [1.15] for line in panel.lines) == bars
    assert any("n/a" in text.get_text() for text in panel.texts) == (not bars)


@pytest.mark.parametrize(("fix", "outages", "rows"), [
    (0.0, [], ["pose"]),
    (1.0, [], ["pose", "GNSS"]),
    (0.0, [[0.0, 9.0]], ["pose", "GNSS"]),
])  # fmt: skip
def test_gnss_is_shown_of_flights_that_have_it(fix, outages, rows):
    flight = flown(flown_path=path(gnss_fix=fix))
    flight.results.record["loop"]["gnss_outages_s"] = outages
    figure = new_figure(3.8)
    draw_flight_in_closed_loop(flight, figure)
    solid, availability = figure.axes[0], figure.axes[-1]
    assert [label.get_text() for label in availability.get_yticklabels()] == rows
    assert {"x (m)", "y (m)", "z (m)"} <= {
        *(solid.get_xlabel(), solid.get_ylabel()),
        *(t.get_text() for t in solid.texts),
    }


def test_a_flight_out_of_its_corridor_says_how_far_it_was_from_its_path():
    lost = replace(score("a@15hz", 0, succeeds=False), status="completed", path_max_m=0.4567)
    assert why_failed(lost) == "it left its corridor: it was up to 0.46 m from its path"
    assert f"box-s0 a@15hz: completed at 0.10 s: {why_failed(lost)}" in table(FlightNotes("t", {}, {}), [lost])


def test_captions_tell_of_lower_rates_where_there_are_some(entries):
    runs = open_runs(entries)
    fast = [run for run in runs if run.score.rate_hz == 15]
    told = ["lower rates" in json.dumps([d.caption for d in compare(some)]) for some in (runs, fast)]
    assert told == [True, False]


@pytest.mark.parametrize("most", [1, 200])
def test_a_breakdown_of_some_frames_says_of_how_many(entries, monkeypatch, most):
    monkeypatch.setattr(attributes, "MAX_FRAMES", most)
    runs = open_runs(entries)
    caption = next(drawing.caption for drawing in compare(runs) if drawing.name == "attributes")
    fast = [run for run in runs if run.score.rate_hz == 15]
    every = sum(len(run.errors.frames) for run in fast if run.name == fast[0].name)
    parts = breakdowns(fast)["speed"][fast[0].name]
    told = f", of {sum(part.frames for part in parts)} of {every} frames, evenly spaced" if most == 1 else ""
    assert caption == f"Success by quartile of each attribute that is known from the renderer{told}."


def test_a_pose_between_two_lost_frames_is_a_dot_in_every_figure(sequence, tmp_path):
    rows = [row if k % 3 == 1 else TrackResult(status="lost") for k, row in enumerate(true_rows(sequence, 0.02))]
    results = results_of(sequence, rows)
    results.save(tmp_path)
    score_run(sequence, results).save(tmp_path / "score.json")
    run = open_runs([ReportEntry(sequence.folder, tmp_path, tmp_path / "score.json")])[0]
    alone, drawn = list(range(1, len(rows), 3)), []
    for draw in (draw_error_against_distance, draw_paths):
        figure = new_figure(3.0)
        draw([run], figure)
        drawn += [line for axes in figure.axes for line in axes.lines if line.get_markevery() is not None]
    assert len(drawn) == 3 and all(line.get_markevery() == alone for line in drawn)
    assert all(line.get_marker() == "." for line in drawn)
    assert dots_where_alone(np.array([1.0, 2.0, np.nan, 3.0, 4.0])) == {}


def test_an_error_of_zero_is_drawn_on_a_logarithmic_axis(sequence, tmp_path):
    results = results_of(sequence, true_rows(sequence))
    results.save(tmp_path)
    score_run(sequence, results).save(tmp_path / "score.json")
    run = open_runs([ReportEntry(sequence.folder, tmp_path, tmp_path / "score.json")])[0]
    ate = run.score.ate["none"]
    run.score.ate["none"] = replace(ate, translation_m=replace(ate.translation_m, rmse=0.0))
    figure = new_figure(3.0)
    drawn = draw_accuracy_and_coverage([run], figure)
    panel = figure.axes[0]
    assert panel.get_ylim()[0] <= panel.lines[0].get_ydata()[0] == LEAST_SHOWN
    assert next(iter(drawn.rows))[3] == 0.0


def test_the_mean_of_a_figure_is_that_of_the_table(sequence, tmp_path):
    """Of a flight with two seeds and one with one, as where seeds of one repeat each other."""
    results = results_of(sequence, true_rows(sequence))
    results.save(tmp_path)
    score_run(sequence, results).save(tmp_path / "score.json")
    run = open_runs([ReportEntry(sequence.folder, tmp_path, tmp_path / "score.json")])[0]
    runs = []
    for name, seed, error_m in (("near", 0, 0.01), ("near", 1, 0.02), ("far", 0, 0.06)):
        ate = run.score.ate["none"]
        ate = replace(ate, translation_m=replace(ate.translation_m, rmse=error_m))
        where = {"sequence": f"{name}-s{seed}", "seed": seed}
        runs.append(replace(run, score=replace(run.score, **where, ate={"none": ate})))
    drawn = draw_accuracy_and_coverage(runs, new_figure(3.0))
    ((_, (cell,)),) = summary_table(score_frame(each.score.to_json() for each in runs)).select(["ATE position"]).rows
    assert next(iter(drawn.rows))[3] == pytest.approx(cell.mean) == pytest.approx(3.75)


def test_twenty_trackers_have_as_many_lines_and_markers():
    lines, markers = ({tuple(style(k).items()) for k in range(20)} for style in (line, marker))
    assert len(lines) == len(markers) == 20


@pytest.mark.parametrize("names", [7, 12])
def test_names_of_many_trackers_do_not_overlap(names, tmp_path):
    with house_style():
        figure = new_figure(2.3)
        panels = figure.subplots(1, 4)
        for panel in panels:
            name_trackers(panel, [f"tracker-{k}" for k in range(names)])
        save_figure(figure, tmp_path / "names")
        boxes = [label.get_window_extent() for label in panels[0].get_xticklabels()]
    assert all(left.x1 <= right.x0 for left, right in pairwise(boxes))


@pytest.mark.parametrize(("count", "length", "shown"), [(3, 6, 3), (12, 6, 12), (12, 24, 4)])
def test_ranks_on_the_axis_do_not_overlap(count, length, shown, tmp_path):
    found = Ranks(
        mean_ranks={f"{k:02}{'-' * (length - 2)}": k + 1.0 for k in range(count)}, critical_difference=1.0, p=0.01, n=9
    )
    with house_style():
        figure = new_figure(2.0, wide=False)
        panel = figure.subplots()
        draw_critical_difference(found, {}, "ATE", panel)
        save_figure(figure, tmp_path / "ranks")
        boxes = [each.get_window_extent() for each in panel.texts if each.get_text().isdecimal()]
    assert len(boxes) == shown and all(left.x1 < right.x0 for left, right in pairwise(boxes))


@pytest.mark.parametrize("least", [0.0, 1e-15])
def test_zeros_and_round_off_lie_at_the_lower_end_of_a_logarithmic_axis(least):
    """Errors of one tracker that are none, beside those of others from 1 to 100 cm."""
    panel = new_figure(2.0).subplots()
    values = np.array([least, 1.0, 100.0])
    dots(panel, 0, values, 0)
    fit_scale(panel, values)
    low, high = panel.get_ylim()
    assert panel.get_yscale() == "log" and 0.1 < low < 1.0 and high > 100.0
    assert panel.lines[0].get_ydata().tolist() == [low, 1.0, 100.0]


def test_a_long_legend_makes_the_figure_higher_and_leaves_its_panel_room(tmp_path):
    def draw(count, panel):
        for number in range(count):
            panel.plot([0, 1], [number, 0], label=f"tracker {number}, 15 Hz: 0.44")
        panel.set(xlabel="error threshold (cm)", ylabel="success (%)")
        return Drawn(columns=["a"], rows=[[1.0]])

    heights = []
    for count in (2, 10, 30):
        with house_style(), warnings.catch_warnings():
            warnings.simplefilter("error")
            save_panel(partial(draw, count), tmp_path / f"of-{count}", 2.2)
        heights.append(cv2.imread(str(tmp_path / f"of-{count}.png")).shape[0])
    assert heights[0] == heights[1] < heights[2]
