"""A suite as a graph of jobs: render -> track -> score -> report.

DIR/suite.json                          what this folder is
DIR/sequences/SEQUENCE/                 rendered sequences
DIR/results/SEQUENCE/TRACKER@RATEhz/    estimates, and score.json
DIR/restarts/SEQUENCE/TRACKER@RATEhz/PROTOCOL/    the same under a protocol that gives true poses on the way
DIR/failed/SEQUENCE/TRACKER@RATEhz/     job folder of an external tracker that broke the protocol
DIR/index.html ...                      the report
"""

import shutil
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from glob import escape
from pathlib import Path
from typing import Any

from bench.config import Protocol, Suite
from bench.content import code_hash, content_hash
from bench.external import External
from bench.graph import Job, OnStep
from bench.peers.peer import Peer
from bench.peers.registry import absent
from scenes.spec import SequenceSpec
from tracker.base import Tracker
from tracker.initial_pose import Initialization
from tracker.recording import RecordingSpec, record
from tracker.run import KNOWN

Spec = SequenceSpec | RecordingSpec
VERBS = ("render", "track", "score", "report")
START_S, RENDER_S, TRACK_S, SCORE_S, REPORT_S = 3.0, 0.08, 0.02, 0.05, 1.0
"""Seconds of a sequence, a frame rendered, a frame tracked, a score and a report's entry: a first guess for 640x480."""


def plan(suite: Suite, folder: Path, last: str = "report") -> list[Job]:
    """Jobs of a suite in `folder`, in order, up to and with those of the verb `last`."""
    renders = {spec.name: _render_job(spec, folder) for spec in suite.sequences}
    away = absent(suite.trackers)
    tracks = [
        _track_job(suite.start, label, tracker, rate, spec, renders[spec.name], folder)
        for spec in suite.sequences
        for label, tracker in suite.trackers.items()
        if label not in away
        for rate in suite.rates_hz
    ]
    scores = [_score_job(track, folder) for track in tracks]
    restarts = [_restart_job(track, protocol, folder) for track in tracks for protocol in suite.protocols]
    jobs = [*renders.values(), *tracks, *restarts, *scores, _report_job(suite, scores, restarts, away, folder)]
    return [job for job in jobs if VERBS.index(job.verb) <= VERBS.index(last)]


def frames(spec: Spec) -> float:
    """How many frames a sequence will have; a guess of a minute where nothing says how long it takes."""
    path = spec.flight.path if isinstance(spec, SequenceSpec) else spec.source
    return float(getattr(path, "duration_s", 60.0)) * spec.rate_hz


def clean_leftovers(folder: Path, sequences: Iterable[str] = ("*",)) -> None:
    """Remove what a killed process had begun to write of these sequences (temporary names start with a dot)."""
    of_one = ("sequences/.{}-*", "results/.{}-*", "results/{}/.*-*", "results/{}/*/.*-*", "restarts/{}/*/.*-*")
    for pattern in (".*-*", *(p.format(escape(name) if name != "*" else name) for name in sequences for p in of_one)):
        for path in folder.glob(pattern):
            if path.is_dir():
                shutil.rmtree(path)
            else:
                path.unlink()


@dataclass(frozen=True)
class Render:
    """Render one sequence, or take over one that was recorded."""

    spec: Spec
    folder: Path

    def __call__(self, content_hash: str, on_step: OnStep) -> None:
        """Write the sequence folder."""
        if isinstance(self.spec, RecordingSpec):
            record(self.spec, self.folder, content_hash=content_hash, on_frame=on_step)
            return
        from scenes.generate import generate

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
        from bench.external import track_external
        from scenes.sequence import Sequence
        from tracker.base import TrackResult
        from tracker.run import track_sequence

        sequence = Sequence.load(self.sequence)

        def on_frame(frame: int, _: TrackResult) -> None:
            on_step(frame + 1, len(sequence))

        given: dict[str, Any] = {
            "rate_hz": self.rate_hz, "seed": self.seed, "on_frame": on_frame, "start": self.start,
        }  # fmt: skip
        if isinstance(self.tracker, External | Peer):
            kept = self.folder.parents[2] / "failed" / self.folder.parent.name / self.folder.name
            program = self.tracker.present() if isinstance(self.tracker, Peer) else self.tracker
            results = track_external(program, sequence, kept_folder=kept, **given)
        else:
            results = track_sequence(self.tracker, sequence, **given)
        record = {**results.record, "label": self.label, "content_hash": content_hash}
        if isinstance(self.tracker, Peer):
            record["tracker"] = self.tracker.record
        replace(results, record=record).save(self.folder)


@dataclass(frozen=True)
class Restart:
    """Run one tracker over one sequence under a protocol that gives it true poses on the way."""

    track: Track
    protocol: Protocol
    folder: Path

    def __call__(self, content_hash: str, on_step: OnStep) -> None:
        """Write the results folder."""
        from reports.protocols import PROTOCOLS
        from scenes.sequence import Sequence

        track = self.track
        run = PROTOCOLS[self.protocol]
        restarted = run(track.tracker, Sequence.load(track.sequence), rate_hz=track.rate_hz, seed=track.seed)
        results = restarted.results
        record = {**results.record, "label": track.label, "content_hash": content_hash}
        replace(results, record=record).save(self.folder)


@dataclass(frozen=True)
class Score:
    """Score one result against its sequence's truth."""

    sequence: Path
    results: Path

    def __call__(self, content_hash: str, on_step: OnStep) -> None:
        """Write `score.json` in the results folder."""
        from reports.recorded import score_recorded
        from reports.score import score
        from scenes.sequence import Sequence
        from tracker.results import Results

        sequence, results = Sequence.load(self.sequence), Results.load(self.results)
        scored = score_recorded(sequence, results) if sequence.recorded else score(sequence, results)
        scored.save(self.results / "score.json", content_hash=content_hash)


@dataclass(frozen=True)
class Report:
    """Write the report over all scores of a suite."""

    title: str
    folder: Path
    scored: tuple[tuple[Path, Path, str], ...]
    restarts: tuple[Path, ...] = ()
    absent: tuple[tuple[str, str], ...] = ()
    recorded: bool = False
    unrendered: tuple[tuple[str, str], ...] = ()

    def __call__(self, content_hash: str, on_step: OnStep) -> None:
        """Write index.html, figures, tables and scores.json."""
        from reports.recorded_report import write_recorded_report
        from reports.report import ReportEntry, write_report

        if self.recorded:
            more: dict[str, Any] = {"content_hash": content_hash, "on_step": on_step}
            write_recorded_report(self.folder, self.title, self.scored, absent=dict(self.absent), **more)
            return
        entries = [
            ReportEntry(sequence, results, results / "score.json", why) for sequence, results, why in self.scored
        ]
        given: dict[str, Any] = {"restarts": self.restarts, "content_hash": content_hash, "on_step": on_step}
        write_report(self.folder, self.title, entries, dict(self.unrendered), absent=dict(self.absent), **given)

    def without(self, failed: Mapping[str, str]) -> "Report | None":
        """The report that shows what failed as failed; None where no sequence is left."""
        unrendered, scored = {}, []
        for sequence, results, _ in self.scored:
            run = f"{sequence.name} {results.name}"
            if why := failed.get(f"render {sequence.name}"):
                unrendered[sequence.name] = why
            else:
                scored.append((sequence, results, failed.get(f"track {run}") or failed.get(f"score {run}", "")))
        restarts = tuple(path for path in self.restarts if " ".join(["track", *path.parts[-3:]]) not in failed)
        kept = replace(self, scored=tuple(scored), restarts=restarts, unrendered=tuple(unrendered.items()))
        return kept if scored else None


def _render_job(spec: Spec, folder: Path) -> Job:
    output = folder / "sequences" / spec.name
    return Job(
        verb="render",
        name=f"render {spec.name}",
        work=Render(spec, output),
        marker=output / "sequence.json",
        content_hash=content_hash(spec, code_hash("trajectories", "scenes")),
        weight=START_S + RENDER_S * frames(spec),
    )


def _track_job(
    start: Initialization,
    label: str,
    tracker: Tracker,
    rate_hz: float,
    spec: Spec,
    render: Job,
    folder: Path,
) -> Job:
    run = f"{label}@{rate_hz:g}hz"
    output = folder / "results" / spec.name / run
    return Job(
        verb="track",
        name=f"track {spec.name} {run}",
        work=Track(label, tracker, rate_hz, spec.seed, folder / "sequences" / spec.name, output, start),
        marker=output / "record.json",
        content_hash=content_hash(label, tracker, rate_hz, spec.seed, start, render.content_hash, code_hash("tracker")),
        needs=(render,),
        weight=TRACK_S * frames(spec) * rate_hz / spec.rate_hz,
    )


def _restart_job(track: Job, protocol: Protocol, folder: Path) -> Job:
    assert isinstance(track.work, Track)
    output = folder / "restarts" / track.work.sequence.name / track.work.folder.name / protocol
    return replace(
        track,
        name=f"{track.name} {protocol}",
        work=Restart(track.work, protocol, output),
        marker=output / "record.json",
        content_hash=content_hash(track.content_hash, protocol, code_hash("reports")),
    )


def _score_job(track: Job, folder: Path) -> Job:
    assert isinstance(track.work, Track)
    return Job(
        verb="score",
        name=track.name.replace("track", "score", 1),
        work=Score(track.work.sequence, track.work.folder),
        marker=track.work.folder / "score.json",
        content_hash=content_hash(track.content_hash, code_hash("reports")),
        needs=(track,),
        weight=SCORE_S,
    )


def _report_job(suite: Suite, scores: list[Job], restarts: list[Job], away: Mapping[str, str], folder: Path) -> Job:
    scored = tuple((job.work.sequence, job.work.results, "") for job in scores if isinstance(job.work, Score))
    needs = (*scores, *restarts)
    work = Report(suite.title, folder, scored, tuple(job.marker.parent for job in restarts), tuple(away.items()))
    work = replace(work, recorded=any(isinstance(spec, RecordingSpec) for spec in suite.sequences))
    return Job(
        verb="report",
        name="report",
        work=work,
        marker=folder / "report.json",
        content_hash=content_hash(suite.title, [job.content_hash for job in needs], away),
        needs=needs,
        weight=REPORT_S * (1 + len(scores)),
        without=work.without,
    )
