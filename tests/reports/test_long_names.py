"""Figures of trackers with long names: the names are told apart, lie within the figure, and leave room for panels."""

import inspect
import warnings
from dataclasses import replace
from functools import cached_property
from importlib import import_module
from itertools import product
from pathlib import Path
from pkgutil import iter_modules

import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.text import Text

from tests.reports.drawn import make_sequence, results_of, true_rows
from tests.reports.test_closed_loop_report import flights
from tests.reports.test_flight_score import flown
from uavbench.bench.history.validation import history_of
from uavbench.reports import figures, figures_on_axes, restarts
from uavbench.reports.closed_loop import figure as closed_loop
from uavbench.reports.closed_loop import summary_figures
from uavbench.reports.figures import comparison, distributions, flight, image_panels, ranking, space, sweeps, time
from uavbench.reports.figures.tracker_pictures import write_text_on
from uavbench.reports.history import figures as history
from uavbench.reports.history.trend import trends
from uavbench.reports.many_runs import figures as many_runs
from uavbench.reports.many_runs.evaluate_many import evaluate_many
from uavbench.reports.many_runs.groups import Run
from uavbench.reports.protocols.restarting import run_from_anchors
from uavbench.reports.recorded_report import Shown, figures_of
from uavbench.reports.recorded_score import RecordedRun, score_recorded
from uavbench.reports.scoring.attributes import Part
from uavbench.reports.scoring.runs import ScoredRun
from uavbench.reports.scoring.score import score
from uavbench.reports.statistics.bootstrap import compare_pairs, ranks
from uavbench.reports.style import LONGEST_NAME, house_style, new_figure, save_figure, short_names
from uavbench.tracker.baselines.hold import Hold
from uavbench.trajectories.trajectory_files.formats import write_tum

LONG = [f"a-tracker-whose-name-says-all-of-its-{kind}-parameters-and-more@15hz" for kind in ("first", "second", "next")]
NAMES = [  # two that differ where they end, two in their middles
    *(f"tracker_with_a_name_of_some_fifty_characters_at_{k}" for k in range(2)),
    *(f"tracker_with_{k}_in_the_middle_of_some_fifty_characters" for k in range(2)),
]


def test_short_names_are_kept_and_long_ones_told_apart() -> None:
    assert short_names(["robust", "lsd@15hz"]) == ["robust", "lsd@15hz"]
    found = short_names([*LONG, "lsd", LONG[0]])
    assert len(set(found)) == 4 and found[0] == found[4] and found[3] == "lsd"
    assert max(map(len, found)) <= LONGEST_NAME
    ends = [f"{LONG[0]}-{k}" for k in range(3)]
    assert [name[-2:] for name in short_names(ends)] == ["-0", "-1", "-2"]


class Study:
    """Runs of trackers with given names, in which every kind of figure has something to show."""

    def __init__(self, names, folder):
        self.names, self.folder = names, folder
        self.runs = []
        sequences = [
            make_sequence(folder / name, 45, name=f"scene_with_a_name_of_some_fifty_characters_at_{name}")
            for name in "01"
        ]
        for sequence, rate_hz in product(sequences, (15.0, 5.0)):
            for colour, name in enumerate(names):
                rows = [
                    replace(row, covariance=1e-4 * np.eye(6), inliers=9)
                    for row in true_rows(sequence, 0.01 + 0.03 * colour)[:: round(15 / rate_hz)]
                ]
                results = results_of(sequence, rows, rate_hz)
                results = replace(results, record={**results.record, "label": name})
                self.runs.append(ScoredRun(sequence, results, score(sequence, results), colour))
        self.fast = [run for run in self.runs if run.score.rate_hz == 15]
        self.here = self.fast[: len(names)]
        self.sequence = self.here[0].sequence
        self.colours = {run.name: run.colour for run in self.runs}
        self.numbers = np.random.default_rng(0)

    def pairs(self):
        """Values of 8 flights of each run at 15 Hz."""
        return {run.name: [self.numbers.uniform(size=1) for _ in range(8)] for run in self.here}

    @cached_property
    def many(self):
        """Evaluation of two runs of each tracker."""
        truth, runs = self.folder / "truth.tum", []
        write_tum(self.sequence.ground_truth, truth)
        for run, k in product(self.here, range(2)):
            at = self.folder / f"{run.colour}-{k}.tum"
            moved = self.sequence.ground_truth
            write_tum(replace(moved, positions_m=moved.positions_m + 0.01 * run.colour * self.numbers.uniform()), at)
            runs.append(Run(run.score.label, f"a-run-with-a-long-name-{k}", at))
        return evaluate_many(truth, runs, align="none")

    def restarted(self):
        """Every tracker at 15 Hz and at 5 Hz, restarted at anchors."""
        found = []
        for name, rate_hz in product(self.names, (15, 5)):
            run = run_from_anchors(Hold(), self.sequence, rate_hz=rate_hz, seed=0, every_s=1.0)
            run.results.record["label"] = name
            found.append(restarts.RestartedRun(self.sequence, run))
        return found

    def recorded(self):
        """The runs at 15 Hz as those of a recording."""
        runs = [RecordedRun(run.sequence, run.results) for run in self.here]
        return [Shown(run, score_recorded(run.sequence, run.results), k) for k, run in enumerate(runs)]

    def flown(self):
        """Scores of flights in closed loop, which crash, stray and run out of time, and the loops that they sweep."""
        loops = {f"latency-{ms}ms": {"latency": {"ms": float(ms)}} for ms in (0, 50, 200)}
        scores = [score for name, loop in product(self.names, loops) for score in flights(f"{name}@15hz+{loop}", "++-")]
        ends = [replace(scores[2], status=status) for status in ("completed", "timed out", "strayed")]
        return [*scores, *ends], summary_figures.swept_loops(loops)

    def trend(self):
        """The trend of a tracker along commits."""
        (first, *_) = trends(history_of(np.full((8, 6), 0.01)), 0.01)
        return replace(first, series=replace(first.series, tracker=self.names[0]))


PARTS = [Part(low=low, high=low + 1.0, frames=9, success=0.5, median_m=0.01) for low in range(4)]
KINDS = {
    time.pose_components: lambda s, stem: time.pose_components(s.here[3], stem),
    time.errors_over_time: lambda s, stem: time.errors_over_time(s.here, stem),
    time.segment_counts: lambda s, stem: time.segment_counts(s.here[0], stem),
    distributions.by_attribute: lambda s, stem: distributions.by_attribute(
        {name: {run.name: PARTS for run in s.here} for name in ("speed", "distance", "blur")}, s.colours, stem
    ),
    distributions.nees_over_time: lambda s, stem: distributions.nees_over_time(s.runs, stem),
    distributions.error_over_bound: lambda s, stem: distributions.error_over_bound(
        {run.name: s.numbers.uniform(1, 9, 20) for run in s.here}, s.colours, stem
    ),
    sweeps.sweep: lambda s, stem: sweeps.sweep(
        s.runs, sweeps.Swept("noise", {run.sequence.name: float(run.sequence.name[-1]) for run in s.runs}), "ate", stem
    ),
    comparison.accuracy_and_coverage: lambda s, stem: comparison.accuracy_and_coverage(s.runs, stem),
    comparison.success_curves: lambda s, stem: comparison.success_curves(s.runs, stem),
    comparison.accuracy_against_latency: lambda s, stem: comparison.accuracy_against_latency(s.runs, stem),
    space.paths: lambda s, stem: space.paths(s.here, stem),
    space.error_against_distance: lambda s, stem: [
        *space.error_against_distance(s.here, stem),
        *space.error_against_distance([still(run) for run in s.here], stem.with_name("one_column")),
    ],
    flight.flight: lambda s, stem: flight.flight(s.sequence, stem),
    ranking.critical_difference: lambda s, stem: ranking.critical_difference(
        ranks({name: np.concatenate(values) for name, values in s.pairs().items()}), s.colours, stem, "a metric of it"
    ),
    ranking.win_table: lambda s, stem: ranking.win_table(
        list(s.pairs()), compare_pairs(s.pairs()), stem, "area over the success curve"
    ),
    image_panels.segment_pictures: lambda s, stem: image_panels.segment_pictures(s.here[0], stem),
    image_panels.edge_pictures: lambda s, stem: image_panels.edge_pictures(s.here[0], stem),
    image_panels.next_frame_pictures: lambda s, stem: image_panels.next_frame_pictures(s.here[0], stem),
    restarts.error_after_anchors: lambda s, stem: restarts.error_after_anchors(s.restarted(), s.colours, stem),
    many_runs.errors_along: lambda s, stem: many_runs.errors_along(s.many, stem),
    many_runs.spread: lambda s, stem: many_runs.spread(s.many, stem),
    many_runs.paths: lambda s, stem: many_runs.paths(s.many, stem),
    many_runs.nees: lambda s, stem: many_runs.nees(s.many, stem),
    closed_loop.flight_in_closed_loop: lambda s, stem: closed_loop.flight_in_closed_loop(closed_loop_flight(), stem),
    summary_figures.success_of_runs: lambda s, stem: summary_figures.success_of_runs(s.flown()[0], stem),
    summary_figures.along_loops: lambda s, stem: summary_figures.along_loops(*s.flown(), stem),
    history.save_trend: lambda s, stem: history.save_trend(s.trend(), stem),
    figures_of: lambda s, stem: figures_of(stem.parent, s.recorded(), 15.0),
}
"""What writes a figure, and a call of it on a study and a stem."""
MODULES = [
    *(import_module(f"{figures.__name__}.{each.name}") for each in iter_modules(figures.__path__)),
    *(restarts, many_runs, closed_loop, summary_figures, history),
]
NO_NAMES = {"picture_row", "save_panel", "save_drawn"}
"""Functions with a stem by which the others write their figures."""


def still(run):
    """The run as one whose frames are too far apart for sub-trajectories."""
    few = replace(run.results, frames=run.results.frames[:1], stamps_ns=run.results.stamps_ns[:1],
                  rows=run.results.rows[:1])  # fmt: skip
    return replace(run, results=few)


def closed_loop_flight():
    flight = flown()
    flight.results.record["loop"]["gnss_outages_s"] = []
    return flight


def test_no_kind_of_figure_is_left_out() -> None:
    written = {
        function
        for module in MODULES
        for name, function in inspect.getmembers(module, inspect.isfunction)
        if function.__module__ == module.__name__ and name not in NO_NAMES
        if "stem" in inspect.signature(function).parameters
    }
    assert written <= set(KINDS)


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    return Study(NAMES, tmp_path_factory.mktemp("study"))


@pytest.fixture
def saved(monkeypatch):
    """The figures that are saved, each once, as empty files."""
    found = []
    monkeypatch.setattr(Figure, "savefig", lambda self, *_, **__: found.extend([self] if self not in found else []))
    return found


def beyond(figure):
    """Texts of a figure's legends and titles, and those labels that name a tracker, that are not all within it."""
    figure.draw_without_rendering()
    legends = [*figure.legends, *(axes.get_legend() for axes in figure.axes if axes.get_legend())]
    texts = [text for legend in legends for text in [legend.get_title(), *legend.get_texts()]]
    titles = [text for axes in figure.axes for text in axes.get_children() if text not in axes.texts]
    texts += [text for text in titles if isinstance(text, Text)]
    texts += [text for text in figure.findobj(Text) if "track" in text.get_text() and text not in texts]
    boxes = {text: text.get_window_extent() for text in texts if text.get_visible() and text.get_text()}
    width, height = figure.bbox.size + 0.5  # px
    return [
        text.get_text()
        for text, box in boxes.items()
        if box.x0 < -0.5 or box.y0 < -0.5 or box.x1 > width or box.y1 > height
    ]


def labels_of(legend):
    return [text.get_text() for text in legend.get_texts()]


@pytest.mark.slow(seconds=20)
@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: f"{kind.__module__.split('.', 2)[2]}.{kind.__name__}")
def test_legends_and_titles_of_long_names_lie_within_their_figures(study, saved, kind, tmp_path: Path) -> None:
    (tmp_path / "figures").mkdir()
    with warnings.catch_warnings(), house_style():
        warnings.simplefilter("error")
        KINDS[kind](study, tmp_path / "figure")
    assert saved
    for figure in saved:
        assert beyond(figure) == []
        for legend in figure.legends:
            shown = labels_of(legend)
            assert len(set(shown)) == len(shown)
        assert all(axes.get_position().height * figure.get_figheight() > 0.3 for axes in figure.axes)


@pytest.mark.parametrize(("panels", "wide"), [(1, False), (2, False), (2, True)])
@pytest.mark.parametrize(
    "name", ["errors_over_time", "success_curves", "accuracy_against_latency", "nees_over_time", "paths_from_above"]
)
def test_legends_on_given_axes_lie_within_the_figure(study, name, panels, wide) -> None:
    with house_style():
        figure = new_figure(3.0, wide=wide)
        for panel in figure.subplots(1, panels, squeeze=False)[0]:
            getattr(figures_on_axes, name)(study.here, panel)
            shown = labels_of(panel.get_legend())
            assert len(set(shown)) == len(shown)
        assert beyond(figure) == []


def test_text_on_an_image_lies_within_it() -> None:
    widest = []
    for text in ("lsd, 15 Hz  frame 3", f"{NAMES[0]}, 15 Hz  frame 12  relocalized"):
        canvas = np.full((240, 320, 3), 200, np.uint8)
        write_text_on(canvas, text)
        widest.append(int((canvas != 200).any(axis=(0, 2)).sum()))
    assert widest[0] < widest[1] < 320


@pytest.mark.parametrize("count", [2, 3])
def test_rankings_of_long_names_lie_within_their_figures_without_a_warning(saved, tmp_path: Path, count: int) -> None:
    rng = np.random.default_rng(0)
    values = {name: [rng.uniform(size=1) for _ in range(8)] for name in LONG[:count]}
    ranked = ranks({name: np.concatenate(blocks) for name, blocks in values.items()})
    with warnings.catch_warnings(), house_style():
        warnings.simplefilter("error")
        ranking.win_table(list(values), compare_pairs(values), tmp_path / "wins", "error")
        ranking.critical_difference(ranked, dict.fromkeys(values, 0), tmp_path / "ranks", "error")
    for figure in saved:
        assert len([text for text in figure.findobj(plt.Text) if "track" in text.get_text()]) >= count
        assert beyond(figure) == []


def test_a_figure_whose_labels_leave_no_room_is_higher_and_no_warning_shows_a_path(tmp_path: Path) -> None:
    figure = new_figure(0.6)
    panel = figure.subplots()
    panel.set_xlabel("time\n" * 7)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        save_figure(figure, tmp_path / "tall")
    assert figure.get_figheight() > 1.0 and panel.get_position().height > 0
