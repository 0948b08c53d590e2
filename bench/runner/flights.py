"""A suite flown in closed loop as a graph of jobs: fly -> score -> report.

DIR/suite.json                          what this folder is
DIR/flights/SEQUENCE/TRACKER@RATEhz/    one flight, and score.json
DIR/tables/flights.md ...               measures of all flights
DIR/figures/flights/                    each flight over its structure, success by tracker
DIR/flights.json                        what was written, and all scores
DIR/made/                               what each job wrote, with digests
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from uavbench.bench.closed_loop.spec import Pilot
from uavbench.bench.config.suite import Suite
from uavbench.bench.inputs.content_hash import code_hash, content_hash, one_look
from uavbench.bench.runner.graph import Job, OnStep
from uavbench.bench.runner.jobs import RENDER_S, START_S, TRACK_S, frames
from uavbench.bench.third_party.peer import Peer
from uavbench.bench.third_party.registry import absent
from uavbench.scenes.spec import SequenceSpec
from uavbench.tracker.results import MARKER
from uavbench.trajectories.errors import UserError

VERBS = ("fly", "score", "report")
REPORT = "flights.json"
SCORE_S, FIGURE_S = 2.0, 2.0
"""Seconds of a flight's score, most of it the coverage, and of its figure."""


@dataclass(frozen=True)
class Fly:
    """Fly one sequence on one tracker at one rate."""

    spec: SequenceSpec
    pilot: Pilot
    folder: Path

    def __call__(self, content_hash: str, on_step: OnStep) -> None:
        """Write the flight's folder."""
        from uavbench.bench.closed_loop.fly import fly

        tracker = self.pilot.tracker
        pilot = replace(self.pilot, tracker=tracker.present()) if isinstance(tracker, Peer) else self.pilot
        flown = fly(self.spec, pilot, on_step)
        record = {**flown.record, "content_hash": content_hash}
        if isinstance(tracker, Peer):
            record["tracker"] = tracker.record
        replace(flown, results=replace(flown.results, record=record)).save(self.folder)


@dataclass(frozen=True)
class ScoreFlight:
    """Score one flight."""

    folder: Path

    def __call__(self, content_hash: str, on_step: OnStep) -> None:
        """Write `score.json` in the flight's folder."""
        from uavbench.reports.closed_loop.flown import Flown
        from uavbench.reports.closed_loop.measures import measure_flight

        measure_flight(Flown.load(self.folder)).save(self.folder / "score.json", content_hash)


@dataclass(frozen=True)
class ReportFlights:
    """Write tables and figures over all flights of a suite."""

    title: str
    folder: Path
    flights: tuple[Path, ...]
    failed: tuple[tuple[str, str], ...] = ()
    absent: tuple[tuple[str, str], ...] = ()

    def __call__(self, content_hash: str, on_step: OnStep) -> None:
        """Write flights.json, tables and figures."""
        from uavbench.reports.closed_loop.report import write_flights

        more = {**dict(self.failed), **dict(self.absent)}
        write_flights(self.folder, self.title, self.flights, more, content_hash=content_hash)

    def without(self, failed: Mapping[str, str]) -> "ReportFlights | None":
        """The report of the flights that were flown; None where there is none."""
        lost = {path: _why(path, failed) for path in self.flights}
        kept = tuple(path for path in self.flights if not lost[path])
        told = tuple((" ".join(path.parts[-2:]), why) for path, why in lost.items() if why)
        return replace(self, flights=kept, failed=told) if kept else None


def plan_flights(suite: Suite, folder: Path, last: str = "report") -> list[Job]:
    """Jobs of a suite in `folder`, in order, up to and with those of the verb `last`; UserError without a `[loop]`."""
    if suite.loop is None:
        raise UserError(
            f"suite {suite.name} says nothing of how it is flown: give it a table [loop], which may be empty, or fly "
            "fly-box, fly-bridge or fly-facade"
        )
    with one_look():
        away = absent(suite.trackers)
        flights = [
            _fly_job(
                spec, Pilot(label=label, tracker=tracker, rate_hz=rate, loop=suite.loop, start=suite.start), folder
            )
            for spec in suite.sequences
            if isinstance(spec, SequenceSpec)
            for label, tracker in suite.trackers.items()
            if label not in away
            for rate in suite.rates_hz
        ]
        scores = [_score_job(job) for job in flights]
        paths = tuple(job.marker.parent for job in flights)
        work = ReportFlights(suite.title, folder, paths, absent=tuple(away.items()))
        report = Job(
            verb="report",
            name="report",
            work=work,
            marker=folder / REPORT,
            root=folder,
            content_hash=content_hash(suite.title, [job.content_hash for job in scores], away),
            needs=tuple(scores),
            weight=1.0 + FIGURE_S * len(scores),
            without=work.without,
        )
        jobs = [*flights, *scores, report]
    return [job for job in jobs if VERBS.index(job.verb) <= VERBS.index(last)]


def _fly_job(spec: SequenceSpec, pilot: Pilot, folder: Path) -> Job:
    run = f"{pilot.label}@{pilot.rate_hz:g}hz"
    output = folder / "flights" / spec.name / run
    code = code_hash("trajectories", "scenes", "tracker", "bench/closed_loop", "reports/closed_loop")
    return Job(
        verb="fly",
        name=f"fly {spec.name} {run}",
        work=Fly(spec, pilot, output),
        marker=output / MARKER,
        root=folder,
        lists=MARKER,
        content_hash=content_hash(spec, pilot, code),
        weight=START_S + (RENDER_S + TRACK_S) * frames(spec) * pilot.rate_hz / spec.rate_hz,
    )


def _score_job(flight: Job) -> Job:
    return Job(
        verb="score",
        name=flight.name.replace("fly", "score", 1),
        work=ScoreFlight(flight.marker.parent),
        marker=flight.marker.parent / "score.json",
        root=flight.root,
        content_hash=content_hash(flight.content_hash, code_hash("reports")),
        needs=(flight,),
        weight=SCORE_S,
    )


def _why(path: Path, failed: Mapping[str, str]) -> str:
    run = " ".join(path.parts[-2:])
    return failed.get(f"fly {run}") or failed.get(f"score {run}", "")
