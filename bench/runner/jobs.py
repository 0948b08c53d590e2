"""A suite as a graph of jobs: render -> track -> score -> report, or, in closed loop, fly -> score -> report.

DIR/suite.json                          description of the folder
DIR/sequences/SEQUENCE/                 rendered sequences
DIR/results/SEQUENCE/TRACKER@RATEhz/    estimates, and score.json
DIR/restarts/SEQUENCE/TRACKER@RATEhz/PROTOCOL/    the same under a protocol with restarts from true poses
DIR/made/                               files written by each job, with digests
DIR/failed/SEQUENCE/TRACKER@RATEhz/     job folder of an external tracker that violated the protocol
DIR/index.html ...                      the report
DIR/flights/SEQUENCE/TRACKER@RATEhz/    one flight in closed loop, and score.json; TRACKER@RATEhz+LOOP of several loops
DIR/videos/SEQUENCE/TRACKER@RATEhz/     the video of a flight, with --video
DIR/flights.json                        all scores of flights, beside index.html, tables/flights.md and figures/flights/
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from uavbench.bench.closed_loop.spec import Pilot
from uavbench.bench.config.loops import without_loop
from uavbench.bench.config.suite import Protocol, Suite
from uavbench.bench.filming.files import MARKER as VIDEO_MARKER
from uavbench.bench.filming.files import VIDEO
from uavbench.bench.inputs.content_hash import code_hash, content_hash, key_of, one_look
from uavbench.bench.runner.graph import Job
from uavbench.bench.runner.tasks import (
    Figures,
    Fly,
    Render,
    Report,
    ReportFlights,
    Restart,
    Score,
    ScoredFolders,
    ScoreFlight,
    Spec,
    Track,
    Video,
    has_ground_truth,
)
from uavbench.bench.third_party.registry import absent
from uavbench.reports.closed_loop.files import MARKER as FLIGHT_MARKER
from uavbench.scenes.dataset.sequence import RENDERED
from uavbench.scenes.spec import SequenceSpec
from uavbench.tracker.images.recorded_sequence import RECORDED, RecordingSpec
from uavbench.tracker.initialization import Initialization
from uavbench.tracker.protocol import Tracker
from uavbench.tracker.results import MARKER

VERBS = ("render", "track", "score", "report")
FLIGHT_VERBS = ("fly", "score", "video", "report")
START_S, RENDER_S, BOUND_S, TRACK_S, SCORE_S, REPORT_S = 3.0, 0.08, 2.0, 0.02, 0.05, 1.0
"""Seconds of a sequence, an image rendered, its bound, a frame tracked, a score and a report's entry, at 640x480."""
FLIGHT_SCORE_S, FLIGHT_FIGURE_S = 2.0, 2.0
"""Seconds of a flight's score, most of it the coverage, and of its figure."""
VIDEO_S = 1.0
"""Seconds of work on a video per second of flight: its frames are rendered again, and drawn on."""
TRUE_POSES = ("reports/evaluation", "reports/metrics", "bench/own_images")
"""Code by which true poses of one's own are read, and paired with images."""
FLIGHTS = "flights.json"
"""File in which the report of flights lists its files."""


def plan(suite: Suite, folder: Path, last: str = "report", figures: Figures = "page") -> list[Job]:
    """Jobs of a suite in `folder`, in order, up to and with those of the verb `last`; figures: of the report."""
    with one_look():
        return _plan(suite, folder, last, figures)


def _plan(suite: Suite, folder: Path, last: str, figures: Figures) -> list[Job]:
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
    report = _report_job(suite, scores, restarts, away, folder, figures)
    jobs = [*renders.values(), *tracks, *restarts, *scores, report]
    return [job for job in jobs if VERBS.index(job.verb) <= VERBS.index(last)]


def frames(spec: Spec) -> float:
    """Number of frames of a sequence; for a path of unknown duration a minute is assumed."""
    path = spec.flight.path if isinstance(spec, SequenceSpec) else spec.source
    return float(getattr(path, "duration_s", None) or 60.0) * spec.rate_hz


def images(spec: Spec) -> float:
    """Images of all cameras of a sequence, by their pixels in images of 640x480."""
    if not isinstance(spec, SequenceSpec):
        return frames(spec)
    pixels = sum(camera.width * camera.height for camera in (spec.camera, *(other.camera for other in spec.cameras)))
    return frames(spec) * pixels / (640 * 480)


def _render_job(spec: Spec, folder: Path) -> Job:
    output = folder / "sequences" / spec.name
    packages = ("trajectories", "scenes")
    if isinstance(spec, RecordingSpec):
        packages += ("tracker", *(TRUE_POSES if spec.ground_truth_file else ()))
    every = getattr(spec, "crlb_every", 0)
    key = key_of(spec, code_hash(*packages))
    return Job(
        verb="render",
        name=f"render {spec.name}",
        work=Render(spec, output),
        marker=output / "sequence.json",
        root=folder,
        lists=RECORDED if isinstance(spec, RecordingSpec) else RENDERED,
        content_hash=key.content_hash,
        keyed=key.files,
        weight=START_S + RENDER_S * images(spec) + (BOUND_S * frames(spec) / every if every else 0.0),
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
    key = key_of(label, tracker, rate_hz, spec.seed, start, render.content_hash, code_hash("tracker"))
    return Job(
        verb="track",
        name=f"track {spec.name} {run}",
        work=Track(label, tracker, rate_hz, spec.seed, folder / "sequences" / spec.name, output, start),
        marker=output / MARKER.name,
        root=folder,
        lists=MARKER,
        content_hash=key.content_hash,
        keyed=key.files,
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
        marker=output / MARKER.name,
        content_hash=content_hash(track.content_hash, protocol, code_hash("reports")),
    )


def _score_job(track: Job, folder: Path) -> Job:
    assert isinstance(track.work, Track)
    return Job(
        verb="score",
        name=track.name.replace("track", "score", 1),
        work=Score(track.work.sequence, track.work.folder),
        marker=track.work.folder / "score.json",
        root=folder,
        content_hash=content_hash(track.content_hash, code_hash("reports")),
        needs=(track,),
        weight=SCORE_S,
    )


def _report_job(
    suite: Suite, scores: list[Job], restarts: list[Job], away: Mapping[str, str], folder: Path, figures: Figures
) -> Job:
    scored = tuple(ScoredFolders(job.work.sequence, job.work.results) for job in scores if isinstance(job.work, Score))
    needs = (*scores, *restarts)
    work = Report(suite.title, folder, scored, tuple(job.marker.parent for job in restarts), tuple(away.items()))
    work = replace(work, figures=figures, recorded=not all(map(has_ground_truth, suite.sequences)))
    return Job(
        verb="report",
        name="report",
        work=work,
        marker=folder / "report.json",
        root=folder,
        content_hash=content_hash(
            suite.title, [job.content_hash for job in needs], away, figures, code_hash("reports")
        ),
        needs=needs,
        weight=REPORT_S * (1 + len(scores)),
        without=work.without,
    )


def plan_flights(
    suite: Suite, folder: Path, last: str = "report", figures: Figures = "page", *, video: bool = False
) -> list[Job]:
    """Jobs of a suite in `folder`, in order, up to and with those of the verb `last`; UserError without a `[loop]`.

    figures: of the report; video: each flight gets one.
    """
    if not suite.loops:
        raise without_loop(suite.name)
    with one_look():
        away = absent(suite.trackers)
        pilots = [
            Pilot(label=label, tracker=tracker, rate_hz=rate, loop=loop, start=suite.start, variant=variant)
            for label, tracker in suite.trackers.items()
            if label not in away
            for rate in suite.rates_hz
            for variant, loop in suite.loops.items()
        ]
        specs = [spec for spec in suite.sequences if isinstance(spec, SequenceSpec)]
        flights = [_fly_job(spec, pilot, folder) for spec in specs for pilot in pilots]
        scores = [_flight_score_job(job) for job in flights]
        paths = tuple(job.marker.parent for job in flights)
        videos = [_video_job(job, folder) for job in flights] if video else []
        work = ReportFlights(suite.title, folder, paths, absent=tuple(away.items()), figures=figures)
        work = replace(work, videos=tuple(job.marker.with_name(VIDEO) for job in videos))
        needs = (*scores, *videos)
        keys = [job.content_hash for job in needs]
        report = Job(
            verb="report",
            name="report",
            work=work,
            marker=folder / FLIGHTS,
            root=folder,
            content_hash=content_hash(suite.title, keys, away, figures, code_hash("reports")),
            needs=needs,
            weight=1.0 + FLIGHT_FIGURE_S * len(scores),
            without=work.without,
        )
        jobs = [*flights, *scores, *videos, report]
    return [job for job in jobs if FLIGHT_VERBS.index(job.verb) <= FLIGHT_VERBS.index(last)]


def plans_of_scores(suite: Suite, folder: Path) -> list[list[Job]]:
    """Jobs up to all scores of a suite in `folder`, in order: of its replays, and, with a `[loop]`, of its flights."""
    flights = [plan_flights(suite, folder, "score")] if suite.loops else []
    return [plan(suite, folder, "score"), *flights]


def _fly_job(spec: SequenceSpec, pilot: Pilot, folder: Path) -> Job:
    output = folder / "flights" / spec.name / pilot.run
    code = code_hash("trajectories", "scenes", "tracker", "bench/closed_loop", "reports/closed_loop")
    key = key_of(spec, pilot, code)
    return Job(
        verb="fly",
        name=f"fly {spec.name} {pilot.run}",
        work=Fly(spec, pilot, output),
        marker=output / FLIGHT_MARKER.name,
        root=folder,
        lists=FLIGHT_MARKER,
        content_hash=key.content_hash,
        keyed=key.files,
        weight=START_S + (RENDER_S + TRACK_S) * frames(spec) * pilot.rate_hz / spec.rate_hz,
    )


def _video_job(flight: Job, folder: Path) -> Job:
    assert isinstance(flight.work, Fly)
    spec = flight.work.spec
    output = folder / "videos" / spec.name / flight.marker.parent.name
    return Job(
        verb="video",
        name=flight.name.replace("fly", "video", 1),
        work=Video(spec, flight.marker.parent, output),
        marker=output / VIDEO_MARKER.name,
        root=folder,
        lists=VIDEO_MARKER,
        content_hash=content_hash(flight.content_hash, code_hash("reports", "bench/closed_loop", "bench/filming")),
        keyed=flight.keyed,
        needs=(flight,),
        weight=START_S + VIDEO_S * flight.weight,
    )


def _flight_score_job(flight: Job) -> Job:
    return Job(
        verb="score",
        name=flight.name.replace("fly", "score", 1),
        work=ScoreFlight(flight.marker.parent),
        marker=flight.marker.parent / "score.json",
        root=flight.root,
        content_hash=content_hash(flight.content_hash, code_hash("reports")),
        needs=(flight,),
        weight=FLIGHT_SCORE_S,
    )
