"""`uavbench.figures`: the figures of a report, drawn on a given matplotlib Axes or Figure.

A figure of one panel takes `axes`, one of several panels `figure`, a Figure or SubFigure, preferably with
`layout="constrained"`; by default a new pyplot figure is created. The Axes or Figure is returned. `runs` are those of
`uavbench.load_runs`, of all sequences unless stated otherwise. Fonts and sizes follow matplotlib's rcParams; within
`style()` they are those of the report.

>>> import matplotlib.pyplot as plt
>>> from uavbench import figures, load_runs
>>> figure, (left, right) = plt.subplots(1, 2)
>>> runs = load_runs(folder)
>>> figures.success_curves(runs, left) is left
True
>>> figures.accuracy_against_latency(runs, right).get_ylabel()
'frames within 5 cm, 5 deg (%)'
>>> plt.close(figure)
"""

from collections.abc import Callable, Iterable
from collections.abc import Sequence as ListOf

from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure

from uavbench.reports.comparison_figures import RANKED_BY, paired
from uavbench.reports.figures import comparison, distributions, flight, ranking, space, sweeps, time
from uavbench.reports.figures.figure_files import Drawn, legend_of
from uavbench.reports.scoring import crlb_ratio
from uavbench.reports.scoring.attributes import breakdowns
from uavbench.reports.scoring.runs import ScoredRun
from uavbench.reports.statistics.bootstrap import compare_pairs, ranks, units
from uavbench.reports.style import draw_legend, given_axes, given_figure, house_style
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.trajectories.errors import UserError, refuse_other
from uavbench.trajectories.pose import Array

AnyFigure = Figure | SubFigure
Runs = ListOf[ScoredRun]
style = house_style


def errors_over_time(runs: Runs, axes: Axes | None = None, *, quantity: time.Quantity = "position") -> Axes:
    """Error of position (cm) or rotation (deg) over time (s), of runs of one sequence; dotted: the limit of success."""
    refuse_other("quantity", quantity, time.Quantity)
    panel = given_axes(axes)
    time.draw_error_over_time(_one_sequence(runs), quantity, panel)
    panel.set_xlabel("time (s)")
    draw_legend(panel, **legend_of(panel, {}))
    return panel


def success_curves(runs: Runs, axes: Axes | None = None) -> Axes:
    """Share of frames (%) within a distance (cm) of the ground truth, by tracker, with the area under the curve."""
    return _on(axes, lambda panel: comparison.draw_success_curves(_some(runs), panel))


def accuracy_against_latency(runs: Runs, axes: Axes | None = None) -> Axes:
    """Success (%) against the median time of a frame (ms), with a line to its 95th percentile."""
    return _on(axes, lambda panel: comparison.draw_accuracy_against_latency(_some(runs), panel))


def nees_over_time(runs: Runs, axes: Axes | None = None) -> Axes:
    """Normalized estimation error squared over time (s), of the runs that claim a covariance."""
    return _on(axes, lambda panel: distributions.draw_nees_over_time(_some(runs), panel))


def error_over_bound(runs: Runs, axes: Axes | None = None) -> Axes:
    """Share of frames (%) below a ratio of position error to Cramer-Rao bound, of runs of one sequence."""
    runs = _one_sequence(runs)
    ratios: dict[str, Array] = {run.name: crlb_ratio.error_over_bound(run.sequence, run.errors) for run in runs}
    return _on(axes, lambda panel: distributions.draw_error_over_bound(ratios, _colours(runs), panel))


def segment_counts(run: ScoredRun, axes: Axes | None = None) -> Axes:
    """Segments, control points and inliers in each frame of a run over time (s)."""
    return _on(axes, lambda panel: time.draw_segment_counts(_one(run), panel))


def mean_ranks(runs: Runs, axes: Axes | None = None) -> Axes:
    """Mean ranks with the critical difference of Nemenyi's test, of runs at one rate on several flights or seeds."""
    runs = _some(runs)
    found = ranks({name: units(values) for name, values in _paired(runs).items()})
    return _on(axes, lambda panel: ranking.draw_critical_difference(found, _colours(runs), RANKED_BY, panel))


def win_table(runs: Runs, axes: Axes | None = None) -> Axes:
    """How often (%) the tracker of a row beats that of a column, of runs at one rate on several flights or seeds."""
    values = _paired(runs)
    found = compare_pairs(values)
    return _on(axes, lambda panel: ranking.draw_win_table(list(values), found, RANKED_BY, panel))


def sweep(runs: Runs, axes: Axes | None = None, *, what: sweeps.What = "success") -> Axes:
    """ATE (cm) or success (%) against the one number in which the sequences of a suite differ."""
    refuse_other("what", what, sweeps.What)
    runs = _some(runs)
    found = sweeps.swept(list({run.sequence.name: run.sequence for run in runs}.values()))
    if found is None:
        raise UserError("the sequences of these runs do not differ in one number with three values or more")
    return _on(axes, lambda panel: sweeps.draw_sweep_of(runs, found, what, panel))


def paths_from_above(runs: Runs, axes: Axes | None = None) -> Axes:
    """True and estimated paths (m) of one sequence, over the structure seen from above."""
    panel = given_axes(axes)
    space.draw_paths_from_above(_one_sequence(runs), panel)
    draw_legend(panel, **legend_of(panel, {}))
    return panel


def error_panels(runs: Runs, figure: AnyFigure | None = None) -> AnyFigure:
    """Errors of position and rotation over time, and a strip that shows where each run of a sequence is off target."""
    return _over(figure, lambda drawn_on: time.draw_errors_over_time(_one_sequence(runs), drawn_on))


def accuracy_and_coverage(runs: Runs, figure: AnyFigure | None = None) -> AnyFigure:
    """ATE of position and rotation, coverage and success of every tracker at every rate, side by side."""
    return _over(figure, lambda drawn_on: comparison.draw_accuracy_and_coverage(_some(runs), drawn_on))


def by_attribute(runs: Runs, figure: AnyFigure | None = None) -> AnyFigure:
    """Success in the quarters of the frames by speed, distance and so on, of runs at one rate."""
    given = _one_rate(runs)
    found = breakdowns(given)
    return _over(figure, lambda drawn_on: distributions.draw_by_attribute(found, _colours(given), drawn_on))


def paths(runs: Runs, figure: AnyFigure | None = None) -> AnyFigure:
    """True and estimated paths (m) of one sequence, in 3-D and from above, with the structure."""
    return _over(figure, lambda drawn_on: space.draw_paths(_one_sequence(runs), drawn_on))


def error_against_distance(runs: Runs, figure: AnyFigure | None = None) -> AnyFigure:
    """Error against the distance travelled, and over sub-trajectories, of runs of one sequence."""
    return _over(figure, lambda drawn_on: space.draw_error_against_distance(_one_sequence(runs), drawn_on))


def pose_components(run: ScoredRun, figure: AnyFigure | None = None) -> AnyFigure:
    """Position (cm) and roll, pitch, yaw (deg) of `world_from_body`: estimate with 3-sigma band, ground truth."""
    return _over(figure, lambda drawn_on: time.draw_pose_components(_one(run), drawn_on))


def flight_of(sequence: Sequence, figure: AnyFigure | None = None) -> AnyFigure:
    """The flight of a sequence in 3-D with its structure, and height, speed and turn rate over time."""
    if not isinstance(sequence, Sequence):
        raise UserError(f"{type(sequence).__name__} is no sequence; give one, as runs[0].sequence")
    return _over(figure, lambda drawn_on: flight.draw_flight(sequence, drawn_on))


def _on(axes: Axes | None, draw: Callable[[Axes], Drawn]) -> Axes:
    panel = given_axes(axes)
    drawn = draw(panel)
    if drawn.legend is not None:
        draw_legend(panel, **legend_of(panel, {**drawn.legend, "ncols": 1}))
    return panel


def _over(figure: AnyFigure | None, draw: Callable[[AnyFigure], Drawn]) -> AnyFigure:
    drawn_on = given_figure(figure)
    drawn = draw(drawn_on)
    if drawn.legend is not None:
        draw_legend(drawn_on, **drawn.legend)
    return drawn_on


def _some(runs: Runs) -> list[ScoredRun]:
    """The runs as a list; UserError where there is none, or something else."""
    given = list(runs) if isinstance(runs, Iterable) else [runs]
    for each in given:
        if not isinstance(each, ScoredRun):
            raise UserError(f"{type(each).__name__} is no run to draw; give those of uavbench.load_runs")
    if not given:
        raise UserError("there are no runs to draw")
    return given


def _one(run: ScoredRun) -> ScoredRun:
    """The run; UserError for several, or something else."""
    if len(given := _some([run] if isinstance(run, ScoredRun) else run)) > 1:
        raise UserError(f"give one run, as runs[0], not {len(given)}")
    return given[0]


def _one_sequence(runs: Runs) -> list[ScoredRun]:
    given = _some(runs)
    names = list(dict.fromkeys(run.sequence.name for run in given))
    if len(names) > 1:
        raise UserError(f"give the runs of one sequence, these are of {', '.join(names)}")
    return given


def _one_rate(runs: Runs) -> list[ScoredRun]:
    given = _some(runs)
    rates = sorted({run.score.rate_hz for run in given}, reverse=True)
    if len(rates) > 1:
        raise UserError(f"give the runs at one rate, these are at {', '.join(f'{rate:g}' for rate in rates)} Hz")
    return given


def _paired(runs: Runs) -> dict[str, list[Array]]:
    values = paired(_one_rate(runs))
    if not values:
        raise UserError("give runs of two trackers or more on the same two flights or seeds or more")
    return values


def _colours(runs: Runs) -> dict[str, int]:
    return {run.name: run.colour for run in _some(runs)}
