"""Tasks of a suite: render, track, restart, score, report, and fly; each reads and writes files."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal, NamedTuple

from uavbench.bench.closed_loop.spec import Pilot
from uavbench.bench.config.suite import Protocol
from uavbench.bench.external.program import External
from uavbench.bench.runner.graph import OnStep
from uavbench.bench.third_party.tracker import ThirdPartyTracker
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.scenes.spec import SequenceSpec
from uavbench.tracker.images.recorded_sequence import GroundTruth, Recording, RecordingSpec, record
from uavbench.tracker.initialization import Initialization
from uavbench.tracker.protocol import Tracker
from uavbench.tracker.results import Results, evaluated_poses
from uavbench.tracker.run import KNOWN
from uavbench.trajectories.trajectory import Trajectory

Spec = SequenceSpec | RecordingSpec
Figures = Literal["page", "all"]
"""Figures of a report, as in uavbench.reports.report_figures; repeated here, because that module needs matplotlib."""


def has_ground_truth(spec: Spec) -> bool:
    """Whether runs on a sequence have errors: rendered ones do, and recordings whose true poses are given."""
    return isinstance(spec, SequenceSpec) or bool(spec.ground_truth_file)


def known_poses(spec: RecordingSpec) -> Callable[[Recording], GroundTruth]:
    """What finds the true poses of a recording; jobs of one without them read none of its modules."""
    from uavbench.bench.own_images.true_poses import ground_truth_of

    return partial(ground_truth_of, spec)


@dataclass(frozen=True)
class Render:
    """Render one sequence, or import a recorded one."""

    spec: Spec
    folder: Path

    def __call__(self, content_hash: str, on_step: OnStep) -> None:
        """Write the sequence folder."""
        if isinstance(self.spec, RecordingSpec):
            truth = known_poses(self.spec) if self.spec.ground_truth_file else None
            record(self.spec, self.folder, content_hash=content_hash, ground_truth=truth, on_frame=on_step)
            return
        from uavbench.scenes.generate import generate

        generate(self.spec, self.folder, content_hash=content_hash, on_frame=on_step)


@dataclass(frozen=True)
class Track:
    """Run one tracker over one sequence at one rate."""

    label: str
    tracker: Tracker
    rate_hz: float
    seed: int
    sequence: Path
    folder: Path
    start: Initialization = KNOWN

    def __call__(self, content_hash: str, on_step: OnStep) -> None:
        """Write the results folder."""
        from uavbench.bench.external.program import track_external
        from uavbench.tracker.protocol import TrackResult
        from uavbench.tracker.run import all_failed, track_sequence

        sequence = Sequence.load(self.sequence)

        def on_frame(frame: int, _: TrackResult) -> None:
            on_step(frame + 1, len(sequence))

        given: dict[str, Any] = {
            "rate_hz": self.rate_hz, "seed": self.seed, "on_frame": on_frame, "start": self.start,
        }  # fmt: skip
        if isinstance(self.tracker, External | ThirdPartyTracker):
            kept = self.folder.parents[2] / "failed" / self.folder.parent.name / self.folder.name
            program = self.tracker.present() if isinstance(self.tracker, ThirdPartyTracker) else self.tracker
            results = track_external(program, sequence, kept_folder=kept, **given)
        else:
            results = track_sequence(self.tracker, sequence, **given)
        record = {**results.record, "label": self.label, "content_hash": content_hash}
        if why := all_failed(results):
            record["failed"] = why
        if isinstance(self.tracker, ThirdPartyTracker):
            record["tracker"] = self.tracker.record
        replace(results, record=record).save(self.folder, groundtruth(sequence, results))


@dataclass(frozen=True)
class Restart:
    """Run one tracker over one sequence under a protocol with restarts from true poses."""

    track: Track
    protocol: Protocol
    folder: Path

    def __call__(self, content_hash: str, on_step: OnStep) -> None:
        """Write the results folder."""
        from uavbench.reports.protocols.restarting import PROTOCOLS

        track = self.track
        run = PROTOCOLS[self.protocol]
        sequence = Sequence.load(track.sequence)
        restarted = run(track.tracker, sequence, rate_hz=track.rate_hz, seed=track.seed)
        results = restarted.results
        record = {**results.record, "label": track.label, "content_hash": content_hash}
        replace(results, record=record).save(self.folder, groundtruth(sequence, results))


def groundtruth(sequence: Sequence, results: Results) -> Trajectory | None:
    """True `world_from_body` at the frames of results; None for a recording."""
    return None if sequence.recorded else evaluated_poses(sequence).select(results.frames)


@dataclass(frozen=True)
class Score:
    """Score one result against its sequence's ground truth."""

    sequence: Path
    results: Path

    def __call__(self, content_hash: str, on_step: OnStep) -> None:
        """Write `score.json` in the results folder."""
        from uavbench.reports.recorded_score import score_recorded
        from uavbench.reports.scoring.score import score

        sequence, results = Sequence.load(self.sequence), Results.load(self.results)
        scored = score_recorded(sequence, results) if sequence.recorded else score(sequence, results)
        scored.save(self.results / "score.json", content_hash=content_hash)


class ScoredFolders(NamedTuple):
    """Folders of a sequence and of results on it; why: reason why the results do not count, "" if they do."""

    sequence: Path
    results: Path
    why: str = ""


@dataclass(frozen=True)
class Report:
    """Write the report over all scores of a suite."""

    title: str
    folder: Path
    scored: tuple[ScoredFolders, ...]
    restarts: tuple[Path, ...] = ()
    absent: tuple[tuple[str, str], ...] = ()
    recorded: bool = False
    unrendered: tuple[tuple[str, str], ...] = ()
    figures: Figures = "page"

    def __call__(self, content_hash: str, on_step: OnStep) -> None:
        """Write index.html, figures, tables and scores.json."""
        from uavbench.reports.recorded_report import write_recorded_report
        from uavbench.reports.report import ReportInputs, write_report
        from uavbench.reports.scoring.runs import ReportEntry

        entries = [ReportEntry(run.sequence, run.results, run.results / "score.json", run.why) for run in self.scored]
        if self.recorded:
            more: dict[str, Any] = {"content_hash": content_hash, "on_step": on_step}
            more |= {"absent": dict(self.absent), "unrendered": dict(self.unrendered)}
            write_recorded_report(self.folder, self.title, entries, **more)
            return
        inputs = ReportInputs(self.title, entries, self.restarts, dict(self.unrendered), dict(self.absent))
        write_report(self.folder, inputs, figures=self.figures, content_hash=content_hash, on_step=on_step)

    def without(self, failed: Mapping[str, str]) -> "Report | None":
        """The report with failed runs marked as failed; None if no sequence is left."""
        unrendered, scored = {}, []
        for sequence, results, _ in self.scored:
            run = f"{sequence.name} {results.name}"
            if why := failed.get(f"render {sequence.name}"):
                unrendered[sequence.name] = why
            else:
                why = failed.get(f"track {run}") or failed.get(f"score {run}", "")
                scored.append(ScoredFolders(sequence, results, why))
        restarts = tuple(path for path in self.restarts if " ".join(["track", *path.parts[-3:]]) not in failed)
        kept = replace(self, scored=tuple(scored), restarts=restarts, unrendered=tuple(unrendered.items()))
        return kept if scored else None


@dataclass(frozen=True)
class Fly:
    """Fly one sequence in closed loop with one tracker at one rate."""

    spec: SequenceSpec
    pilot: Pilot
    folder: Path

    def __call__(self, content_hash: str, on_step: OnStep) -> None:
        """Write the flight's folder."""
        from uavbench.bench.closed_loop.fly import fly

        tracker = self.pilot.tracker
        pilot = replace(self.pilot, tracker=tracker.present()) if isinstance(tracker, ThirdPartyTracker) else self.pilot
        flown = fly(self.spec, pilot, on_step)
        record = {**flown.record, "content_hash": content_hash}
        if isinstance(tracker, ThirdPartyTracker):
            record["tracker"] = tracker.record
        replace(flown, results=replace(flown.results, record=record)).save(self.folder)


@dataclass(frozen=True)
class Video:
    """Write the video of one flight."""

    spec: SequenceSpec
    flight: Path
    folder: Path

    def __call__(self, content_hash: str, on_step: OnStep) -> None:
        """Write the video's folder."""
        from uavbench.bench.filming.video import write_video

        write_video(self.spec, self.flight, self.folder, content_hash, on_step)


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
    """Write page, tables and figures over all flights of a suite."""

    title: str
    folder: Path
    flights: tuple[Path, ...]
    failed: tuple[tuple[str, str], ...] = ()
    absent: tuple[tuple[str, str], ...] = ()
    figures: Figures = "page"
    videos: tuple[Path, ...] = ()

    def __call__(self, content_hash: str, on_step: OnStep) -> None:
        """Write index.html, flights.json, tables and figures."""
        from uavbench.reports.closed_loop.report import write_flights
        from uavbench.reports.closed_loop.tables import FlightNotes

        videos = tuple(path.relative_to(self.folder).as_posix() for path in self.videos)
        notes = FlightNotes(self.title, dict(self.failed), dict(self.absent), videos)
        given: dict[str, Any] = {"figures": self.figures, "content_hash": content_hash, "on_step": on_step}
        write_flights(self.folder, notes, self.flights, **given)

    def without(self, failed: Mapping[str, str]) -> "ReportFlights | None":
        """The report of the completed flights; None without any."""
        lost = {path: _why_unflown(path, failed) for path in self.flights}
        kept = tuple(path for path in self.flights if not lost[path])
        told = tuple((" ".join(path.parts[-2:]), why) for path, why in lost.items() if why)
        videos = tuple(path for path in self.videos if f"video {' '.join(path.parts[-3:-1])}" not in failed)
        return replace(self, flights=kept, failed=told, videos=videos) if kept else None


def _why_unflown(path: Path, failed: Mapping[str, str]) -> str:
    run = " ".join(path.parts[-2:])
    return failed.get(f"fly {run}") or failed.get(f"score {run}", "")
