"""The report over the flights of a suite: page, tables and figures in one folder.

index.html                 success rates, failures, figures, and paired comparisons
tables/flights.*           measures by sequence, tracker, rate and loop (.md), and of every flight (.csv)
tables/pairs.md            every pair of runs on their common flights
figures/success.*          success and greatest path error; along.*: success and path error along a swept parameter
figures/flights/           the worst flight of each run, with `figures="all"` every flight
flights.json               all scores, and the content hash of the report
"""

import json
from collections.abc import Mapping
from collections.abc import Sequence as ListOf
from dataclasses import asdict, dataclass, fields
from functools import partial
from pathlib import Path

import numpy as np

from uavbench.reports.closed_loop.comparison import PairOfRuns, by_run, compared, success
from uavbench.reports.closed_loop.figure import flight_in_closed_loop
from uavbench.reports.closed_loop.files import MARKER as RECORD
from uavbench.reports.closed_loop.flown import Flown
from uavbench.reports.closed_loop.measures import FlightScore
from uavbench.reports.closed_loop.repeated_flights import counted, repeats_of
from uavbench.reports.closed_loop.summary_figures import along_loops, success_of_runs, swept_loops
from uavbench.reports.page.templates import FigureOnPage, asset, environment
from uavbench.reports.progress import OnStep, Steps
from uavbench.reports.report_figures import Drawing, Easel, Figures
from uavbench.reports.statistics.bootstrap import CONFIDENCE
from uavbench.reports.style import house_style, write_csv
from uavbench.scenes.dataset.table_files import read_json
from uavbench.tracker.versions import versions
from uavbench.trajectories.files.listed import Marker
from uavbench.trajectories.files.writing import in_parts, write_text

MARKER = Marker("flights.json", "report of flights")
HEADS = (
    "flown", "success", "95 %", "crashed", "path rms (cm)", "added (cm)", "path max (cm)", "clearance (m)",
    "estimate rms (cm)", "filter NEES", "tracker rms (cm)", "tracker NEES", "false to crash (s)", "coverage (%)",
    "of planned (%)",
)  # fmt: skip
ON_PAGE = (
    "flown", "success", "95 %", "crashed", "path rms (cm)", "path max (cm)", "clearance (m)", "estimate rms (cm)",
    "filter NEES", "tracker rms (cm)", "coverage (%)",
)  # fmt: skip
"""The columns shown on the page."""
PAIR_HEADS = (
    "flights", "only the first succeeds", "only the second", "p", "both succeed", "path rms, first - second (cm)",
    "95 %", "p",
)  # fmt: skip
PAIRS_TOLD = (
    "Runs on the same sequences and seeds; p of success by McNemar's exact test, of the path error by the paired "
    "bootstrap over flights in which both succeed, each adjusted by Holm over all pairs; * at the 5 % level."
)
MEASURES_TOLD = "Success: flown to its end without a crash and within the corridor, with its Wilson interval."
ALPHA = 1 - CONFIDENCE
"""Significance level."""
STATUS_CHIP = {"completed": "off-target"}
"""Style of a status on the page; a completed flight without success left its corridor."""


@dataclass(frozen=True)
class FlightNotes:
    """Title and notes of a report.

    failed: flights that could not be flown, and why; absent: trackers that are not installed, and why; videos: files of
    flights' videos, relative to the report.
    """

    title: str
    failed: Mapping[str, str]
    absent: Mapping[str, str]
    videos: tuple[str, ...] = ()


@dataclass(frozen=True)
class FlownRun:
    """A flight's folder and its score."""

    path: Path
    score: FlightScore

    @property
    def slug(self) -> str:
        """Sequence and run as a file name."""
        return f"{self.score.sequence}_{self.score.run}"


@in_parts(MARKER)
def write_flights(
    folder: Path,
    notes: FlightNotes,
    flights: ListOf[Path],
    *,
    figures: Figures = "page",
    content_hash: str = "",
    on_step: OnStep | None = None,
) -> Path:
    """Write the report over folders of flights, each with its score.json; the path of flights.json.

    figures: which are drawn; content_hash: of the report's inputs. UserError when a score or flight cannot be read.
    """
    runs = [FlownRun(path, FlightScore.load(path / "score.json")) for path in flights]
    scores = [run.score for run in runs]
    pairs = compared(counted(scores))
    (folder / "tables").mkdir(parents=True)
    write_text(folder / "tables" / "flights.md", table(notes, scores))
    write_text(folder / "tables" / "pairs.md", table_of_pairs(notes.title, pairs))
    columns = [f.name for f in fields(FlightScore)]
    rows = [["; ".join(v) if isinstance(v, tuple) else v for v in (getattr(s, c) for c in columns)] for s in scores]
    write_csv(folder / "tables" / "flights.csv", columns, rows)
    (folder / "figures" / "flights").mkdir(parents=True)
    drawings = drawings_of(runs)
    easel = Easel(folder, figures, Steps(on_step, sum(d.always or figures == "all" for d in drawings)))
    with house_style():
        drawn = easel.draw(drawings)
    write_page(folder, notes, runs, pairs, drawn, easel.left_out)
    about = {
        "title": notes.title,
        "content_hash": content_hash,
        "scores": [asdict(s) for s in scores],
        "failed": dict(notes.failed),
        "absent": dict(notes.absent),
    }
    write_text(folder / MARKER.name, json.dumps(about, indent=1) + "\n")
    return folder / MARKER.name


def drawings_of(runs: ListOf[FlownRun]) -> list[Drawing]:
    """The figures of a report: over all flights, then of each flight; that of a run's worst flight is always drawn."""
    scores = counted([run.score for run in runs])
    made = [
        Drawing("success", "Success",
                "Share of flights that succeed, with its 95 % interval (Wilson), and the greatest path error of each "
                "flight, up to its end.", partial(success_of_runs, scores))
    ]  # fmt: skip
    tables = {run.score.run.partition("+")[2]: read_json(run.path / RECORD.name)["loop"] for run in runs}
    if found := swept_loops(tables):
        caption = f"Against {found.key} of the loop: success with its 95 % interval, and the mean and the range of the "
        caption += "rms path error, over the flown part of each flight; read it together with the success."
        made.append(Drawing("along", "Along the loops", caption, partial(along_loops, scores, found)))
    worst = {id(worst_of([run for run in runs if run.score.run == name])) for name in by_run(scores)}
    for run in sorted(runs, key=lambda run: run.score.success):
        score = run.score
        how = "Success" if score.success else f"No success: {why_failed(score)}"
        caption = (
            f"{how}. True, estimated and planned path; (a) errors of path, estimate and tracker, (b) normalized "
            "innovation of each pose, hollow: rejected, (c) when the tracker had a pose, red: none, and a GNSS "
            "receiver, if there is one, a fix."
        )
        draw = partial(_draw_flight, run.path)
        made.append(Drawing(f"flights/{run.slug}", f"{score.sequence}, {score.run}", caption, draw, id(run) in worst))
    return made


def why_failed(score: FlightScore) -> str:
    """Why a flight is no success."""
    return score.why or f"it left its corridor: it was up to {score.path_max_m:.2f} m from its path"


def worst_of(runs: ListOf[FlownRun]) -> FlownRun:
    """The worst flight: failed before successful, then by greatest path error."""
    return max(runs, key=lambda run: (not run.score.success, run.score.path_max_m))


def _draw_flight(path: Path, stem: Path) -> list[Path]:
    return flight_in_closed_loop(Flown.load(path), stem)


def write_page(
    folder: Path,
    notes: FlightNotes,
    runs: ListOf[FlownRun],
    pairs: ListOf[PairOfRuns],
    figures: ListOf[FigureOnPage],
    left_out: int,
) -> None:
    """Write `index.html`."""
    scores = [run.score for run in runs]
    first = read_json(runs[0].path / RECORD.name)
    text = environment().get_template("page_flights.html").render(
        title=notes.title,
        css=asset("page.css"),
        flights=len(scores),
        runs=len(by_run(scores)),
        heads=ON_PAGE,
        rows=[(sequence, run, on_page(cells(group))) for (sequence, run), group in groups_of(counted(scores)).items()],
        told=" ".join(_told(scores)),
        failures=[s for s in scores if not s.success],
        why_failed=why_failed,
        chips=STATUS_CHIP,
        notes=notes,
        figures=[f.sized(folder) for f in figures],
        left_out=left_out,
        pair_heads=PAIR_HEADS,
        pairs=[(pair.first, pair.second, cells_of_pair(pair)) for pair in pairs],
        pairs_told=PAIRS_TOLD,
        record=json.dumps({k: v for k, v in first.items() if k != "files"}, indent=1),
        version=versions()["uavbench"],
    )  # fmt: skip
    write_text(folder / "index.html", text)


def on_page(row: ListOf[str]) -> list[str]:
    """The cells of a row of HEADS that the page shows, ON_PAGE."""
    return [row[HEADS.index(head)] for head in ON_PAGE]


def groups_of(scores: ListOf[FlightScore]) -> dict[tuple[str, str], list[FlightScore]]:
    """Scores by sequence without its seed, and run."""
    groups: dict[tuple[str, str], list[FlightScore]] = {}
    for score in scores:
        groups.setdefault((score.sequence.rpartition("-s")[0], score.run), []).append(score)
    return groups


def table(notes: FlightNotes, scores: ListOf[FlightScore]) -> str:
    """Markdown table of the measures by sequence, tracker, rate and loop, over seeds."""
    lines = [f"# {notes.title}", "", *_head(["sequence", "tracker"], HEADS)]
    lines += [_row([*names, *cells(group)]) for names, group in groups_of(counted(scores)).items()]
    lines += ["", *_told(scores)]
    lines += [
        f"{s.sequence} {s.run}: {s.status} at {s.ended_s:.2f} s: {why_failed(s)}" for s in scores if not s.success
    ]
    lines += [f"{name}: {why}" for name, why in {**notes.failed, **notes.absent}.items()]
    return "\n".join(lines) + "\n"


def _told(scores: ListOf[FlightScore]) -> list[str]:
    """How success is measured, and which seeds count once."""
    repeats = str(repeats_of(scores))
    return [MEASURES_TOLD, *([f"{repeats}."] if repeats else [])]


def table_of_pairs(title: str, pairs: ListOf[PairOfRuns]) -> str:
    """Markdown table of every pair of runs."""
    lines = [f"# {title}", "", *_head(["first", "second"], PAIR_HEADS)]
    lines += [_row([pair.first, pair.second, *cells_of_pair(pair)]) for pair in pairs]
    return "\n".join([*lines, "", PAIRS_TOLD]) + "\n"


def cells(group: ListOf[FlightScore]) -> list[str]:
    """Cells of HEADS: means over the flights of a group; least clearance and greatest path error."""
    share = success(group)
    return [
        str(len(group)),
        f"{share.successes}",
        f"{100 * share.low:.0f}-{100 * share.high:.0f}",
        str(sum(s.status == "crashed" for s in group)),
        _mean([100 * s.path_rms_m for s in group], 1),
        _mean([100 * s.path_added_m for s in group], 1),
        f"{100 * max(s.path_max_m for s in group):.1f}",
        f"{min(s.clearance_min_m for s in group):.2f}",
        _mean([None if s.estimate_rms_m is None else 100 * s.estimate_rms_m for s in group], 1),
        _mean([s.estimate_nees for s in group], 2),
        _mean([None if s.tracker_rms_m is None else 100 * s.tracker_rms_m for s in group], 2),
        _mean([s.tracker_nees for s in group], 2),
        _mean([s.false_to_crash_s for s in group], 1),
        _mean([100 * s.coverage for s in group], 1),
        _mean([100 * s.coverage_planned for s in group], 1),
    ]


def cells_of_pair(pair: PairOfRuns) -> list[str]:
    """Cells of PAIR_HEADS."""
    path, bounds = "", ""
    if pair.path_m is not None:
        path = f"{100 * pair.path_m.mean:+.2f}"
        bounds = pair.path_m.why or f"{100 * pair.path_m.low:+.2f} to {100 * pair.path_m.high:+.2f}"
    return [
        str(pair.flights),
        str(pair.first_only),
        str(pair.second_only),
        f"{pair.success_p:.3g}{'*' * (pair.success_p <= ALPHA)}",
        str(pair.both),
        path,
        bounds,
        f"{pair.path_p:.3g}{'*' * (pair.path_p <= ALPHA)}" if pair.path_m is not None else "",
    ]


def _mean(values: ListOf[float | None], decimals: int) -> str:
    known = [value for value in values if value is not None]
    return f"{np.mean(known):.{decimals}f}" if known else ""


def _head(names: ListOf[str], heads: ListOf[str]) -> list[str]:
    return [_row([*names, *heads]), "|" + " --- |" * len(names) + " ---: |" * len(heads)]


def _row(cells: ListOf[str]) -> str:
    return "| " + " | ".join(cells) + " |"
