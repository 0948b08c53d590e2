"""The report over the flights of a suite: page, tables and figures in one folder.

index.html                 success rates, failures, figures, and paired comparisons
tables/flights.*           measures by sequence, tracker, rate and loop (.md), and of every flight (.csv)
tables/pairs.md            every pair of runs on their common flights
figures/success.*          success and greatest path error; along.*: success and path error along a swept parameter
figures/flights/           the worst flight of each run, with `figures="all"` every flight
flights.json               all scores, and the content hash of the report
"""

import json
from collections.abc import Sequence as ListOf
from dataclasses import asdict, dataclass, fields
from functools import partial
from pathlib import Path

from uavbench.reports.closed_loop.comparison import PairOfRuns, by_run, compared
from uavbench.reports.closed_loop.figure import flight_in_closed_loop
from uavbench.reports.closed_loop.files import MARKER as RECORD
from uavbench.reports.closed_loop.flown import Flown
from uavbench.reports.closed_loop.measures import FlightScore
from uavbench.reports.closed_loop.summary_figures import along_loops, success_of_runs, swept_loops
from uavbench.reports.closed_loop.tables import (
    HEADS,
    PAIR_HEADS,
    PAIRS_TOLD,
    FlightNotes,
    cells,
    cells_of_pair,
    faults_of,
    groups_of,
    table,
    table_of_pairs,
    told,
    why_failed,
)
from uavbench.reports.page.templates import FigureOnPage, asset, environment
from uavbench.reports.progress import OnStep, Steps
from uavbench.reports.report_figures import Drawing, Easel, Figures
from uavbench.reports.style import house_style, write_csv
from uavbench.scenes.dataset.table_files import read_json
from uavbench.tracker.versions import versions
from uavbench.trajectories.files.listed import Marker
from uavbench.trajectories.files.writing import in_parts, write_text

MARKER = Marker("flights.json", "report of flights")
ON_PAGE = (
    "flown", "success", "95 %", "crashed", "path rms (cm)", "path max (cm)", "clearance (m)", "estimate rms (cm)",
    "filter NEES", "tracker rms (cm)", "coverage (%)",
)  # fmt: skip
"""The columns shown on the page."""
STATUS_CHIP = {"completed": "off-target"}
"""Style of a status on the page; a completed flight without success left its corridor."""


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
    judged = notes.judged(scores)
    pairs = compared(judged)
    (folder / "tables").mkdir(parents=True)
    write_text(folder / "tables" / "flights.md", table(notes, scores))
    write_text(folder / "tables" / "pairs.md", table_of_pairs(notes.title, pairs))
    columns = [f.name for f in fields(FlightScore)]
    rows = [["; ".join(v) if isinstance(v, tuple) else v for v in (getattr(s, c) for c in columns)] for s in scores]
    write_csv(folder / "tables" / "flights.csv", columns, rows)
    (folder / "figures" / "flights").mkdir(parents=True)
    drawings = drawings_of(runs, judged)
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


def drawings_of(runs: ListOf[FlownRun], judged: ListOf[FlightScore]) -> list[Drawing]:
    """The figures of a report: over all flights, then of each flight; that of a run's worst flight is always drawn.

    judged: the scores that count in the former, also those of flights that could not be flown.
    """
    made = [
        Drawing("success", "Success",
                "Share of flights that succeed, with its 95 % interval (Wilson), and the greatest path error of each "
                "flight, up to its end.", partial(success_of_runs, judged))
    ]  # fmt: skip
    tables = {run.score.run.partition("+")[2]: read_json(run.path / RECORD.name)["loop"] for run in runs}
    if found := swept_loops(tables):
        known = [score for score in judged if score.run.partition("+")[2] in tables]
        caption = f"Against {found.key} of the loop: success with its 95 % interval, and the mean and the range of the "
        caption += "rms path error, over the flown part of each flight; read it together with the success."
        made.append(Drawing("along", "Along the loops", caption, partial(along_loops, known, found)))
    worst = {
        id(worst_of([run for run in runs if run.score.run == name]))
        for name in dict.fromkeys(run.score.run for run in runs)
    }
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
        rows=[(*names, on_page(cells(group))) for names, group in groups_of(notes.judged(scores)).items()],
        told=" ".join(told(notes.every(scores))),
        failures=[s for s in scores if not s.success],
        faulty=[s for s in scores if s.success and s.faults],
        faults_of=faults_of,
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
