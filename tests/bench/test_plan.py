"""The jobs of a suite: what each does, where it writes, what it needs and how long it is thought to take."""

from dataclasses import dataclass, replace

import pytest

from tests.bench.small_suites import FLOWN, SMALL
from uavbench.bench.closed_loop.spec import Pilot
from uavbench.bench.config.suite import load_suite
from uavbench.bench.filming.files import MARKER as FILMED
from uavbench.bench.runner import jobs
from uavbench.bench.runner.jobs import frames, plan, plan_flights
from uavbench.bench.runner.tasks import (
    Fly,
    Render,
    Report,
    ReportFlights,
    Restart,
    Score,
    ScoredFolders,
    ScoreFlight,
    Track,
    Video,
)
from uavbench.reports.closed_loop.files import MARKER as FLIGHT
from uavbench.scenes.dataset.sequence import RENDERED
from uavbench.tracker.images.recorded_sequence import RecordingSpec
from uavbench.tracker.initialization import CoarseGuess
from uavbench.tracker.results import MARKER as ESTIMATES
from uavbench.trajectories.errors import UserError

NAME = "track-fly-track-fly"
"""A sequence whose name holds those of the verbs."""


@pytest.fixture
def suite(tmp_path):
    """One flight of 0.3 s at 20 Hz; two trackers at two rates, under one more protocol."""
    text = FLOWN.replace("sequences.box", f"sequences.{NAME}").replace("[15.0]", "[5.0, 10.0]")
    (tmp_path / "few.toml").write_text(text)
    found = load_suite(tmp_path / "few.toml")
    return replace(
        found,
        protocols=("reset",),
        start=CoarseGuess(),
        sequences=tuple(replace(s, rate_hz=20.0, seed=7) for s in found.sequences),
    )


RUNS = ["hold@5hz", "hold@10hz", "truth@5hz", "truth@10hz"]
RATES = dict(zip(RUNS, [5.0, 10.0, 5.0, 10.0], strict=True))


def planned(jobs):
    return {job.name: job for job in jobs}


def test_every_run_of_a_suite_is_rendered_tracked_and_scored_in_its_folder(suite, tmp_path):
    (spec,), out = suite.sequences, tmp_path / "out"
    found, sequence = planned(plan(suite, out)), out / "sequences" / spec.name
    names = [f"{verb} {spec.name} {run}" for verb in ("track", "restart", "score") for run in RUNS]
    names = [f"{n.replace('restart', 'track', 1)} reset" if n.startswith("restart") else n for n in names]
    assert list(found) == [f"render {spec.name}", *names, "report"]
    assert [job.verb for job in found.values()] == ["render", *["track"] * 8, *["score"] * 4, "report"]
    assert all(job.root == out for job in found.values())
    render = found[f"render {spec.name}"]
    assert render.work == Render(spec, sequence)
    assert (render.marker, render.lists, render.needs) == (sequence / "sequence.json", RENDERED, ())
    for run, rate in RATES.items():
        results, label = out / "results" / spec.name / run, run.partition("@")[0]
        track, restart, score = (
            found[f"{verb} {spec.name} {run}{more}"]
            for verb, more in (("track", ""), ("track", " reset"), ("score", ""))
        )
        assert track.work == Track(label, suite.trackers[label], rate, 7, sequence, results, suite.start)
        assert (track.marker, track.lists, track.needs) == (results / "record.json", ESTIMATES, (render,))
        anew = out / "restarts" / spec.name / run / "reset"
        assert restart.work == Restart(track.work, "reset", anew)
        assert (restart.marker, restart.lists, restart.needs) == (anew / "record.json", ESTIMATES, (render,))
        assert score.work == Score(sequence, results)
        assert (score.marker, score.lists, score.needs) == (results / "score.json", None, (track,))
    report = found["report"]
    assert report.marker == out / "report.json"
    assert set(report.needs) == {job for name, job in found.items() if job.verb == "score" or name.endswith(" reset")}
    assert report.work == Report(
        suite.title,
        out,
        tuple(ScoredFolders(sequence, out / "results" / spec.name / run) for run in RUNS),
        tuple(out / "restarts" / spec.name / run / "reset" for run in RUNS),
    )
    assert report.without == report.work.without


def test_jobs_are_planned_up_to_a_verb(suite, tmp_path):
    for last, verbs in (("render", 1), ("track", 2), ("score", 3), ("report", 4)):
        assert len({job.verb for job in plan(suite, tmp_path, last)}) == verbs
    every = ["fly", "score", "video", "report"]
    for count, last in enumerate(every, start=1):
        assert {job.verb for job in plan_flights(suite, tmp_path, last, video=True)} == set(every[:count])
    assert {job.verb for job in plan_flights(suite, tmp_path)} == {"fly", "score", "report"}


def test_every_flight_of_a_suite_is_flown_scored_and_filmed_in_its_folder(suite, tmp_path):
    suite = replace(suite, loops={"camera": suite.loops[""]})
    (spec,), out = suite.sequences, tmp_path / "out"
    found = planned(plan_flights(suite, out, figures="print", video=True))
    runs = {f"{run}+camera": rate for run, rate in RATES.items()}
    assert list(found) == [f"{verb} {spec.name} {run}" for verb in ("fly", "score", "video") for run in runs] + [
        "report"
    ]
    assert all(job.root == out for job in found.values())
    for run, rate in runs.items():
        fly, score, video = (found[f"{verb} {spec.name} {run}"] for verb in ("fly", "score", "video"))
        flown, filmed = (out / name / spec.name / run for name in ("flights", "videos"))
        label = run.partition("@")[0]
        pilot = Pilot(
            label=label, tracker=suite.trackers[label], rate_hz=rate, loop=suite.loops["camera"], start=suite.start,
            variant="camera",
        )  # fmt: skip
        assert fly.work == Fly(spec, pilot, flown)
        assert (fly.verb, fly.marker, fly.lists, fly.needs) == ("fly", flown / "record.json", FLIGHT, ())
        assert score.work == ScoreFlight(flown)
        assert (score.verb, score.marker, score.lists, score.needs) == ("score", flown / "score.json", None, (fly,))
        assert video.work == Video(spec, flown, filmed)
        assert (video.verb, video.marker, video.lists) == ("video", filmed / "video.json", FILMED)
        assert video.needs == (fly,)
    report = found["report"]
    assert (report.verb, report.marker) == ("report", out / "flights.json")
    assert set(report.needs) == {job for job in found.values() if job.verb in ("score", "video")}
    assert report.work == ReportFlights(
        suite.title,
        out,
        tuple(out / "flights" / spec.name / run for run in runs),
        figures="print",
        videos=tuple(out / "videos" / spec.name / run / "flight.webm" for run in runs),
    )
    assert report.without == report.work.without


def test_a_suite_that_says_nothing_of_a_loop_is_not_flown(tmp_path):
    (tmp_path / "small.toml").write_text(SMALL)
    with pytest.raises(UserError, match=r"no table \[loop\]"):
        plan_flights(load_suite(tmp_path / "small.toml"), tmp_path)


def test_absent_trackers_are_left_out_and_told_in_the_report(suite, tmp_path, monkeypatch):
    monkeypatch.setattr(jobs, "absent", lambda trackers: {"hold": "not set up"})
    for found in (plan(suite, tmp_path), plan_flights(suite, tmp_path)):
        assert not [job.name for job in found if "hold@" in job.name]
        assert found[-1].work.absent == (("hold", "not set up"),)


def test_jobs_weigh_the_seconds_that_they_are_thought_to_take(suite, tmp_path):
    (spec,) = suite.sequences
    assert frames(spec) == pytest.approx(6.0)
    found, flown = planned(plan(suite, tmp_path)), planned(plan_flights(suite, tmp_path, video=True))
    image = spec.camera.width * spec.camera.height / (640 * 480)
    assert found[f"render {spec.name}"].weight == pytest.approx(3.0 + 0.08 * 6 * image)
    bounded = replace(suite, sequences=(replace(spec, crlb_every=4),))
    assert plan(bounded, tmp_path)[0].weight == pytest.approx(3.0 + 0.08 * 6 * image + 2.0 * 6 / 4)
    for run, rate in RATES.items():
        seen = 6 * rate / 20.0
        assert found[f"track {spec.name} {run}"].weight == pytest.approx(0.02 * seen)
        assert found[f"track {spec.name} {run} reset"].weight == pytest.approx(0.02 * seen)
        assert found[f"score {spec.name} {run}"].weight == pytest.approx(0.05)
        fly = 3.0 + 0.1 * seen
        assert flown[f"fly {spec.name} {run}"].weight == pytest.approx(fly)
        assert flown[f"score {spec.name} {run}"].weight == pytest.approx(2.0)
        assert flown[f"video {spec.name} {run}"].weight == pytest.approx(3.0 + 1.0 * fly)
    assert found["report"].weight == pytest.approx(1.0 * (1 + 4))
    assert flown["report"].weight == pytest.approx(1.0 + 2.0 * 4)


@dataclass(frozen=True)
class Somewhere:
    """Images of which nobody knows how long they take."""


def test_a_recording_is_of_a_minute_its_own_code_and_report_and_does_not_fly(suite, tmp_path, monkeypatch):
    recording = RecordingSpec(name="own", seed=0, source=Somewhere(), rate_hz=10.0)
    both = replace(suite, sequences=(*suite.sequences, recording))
    found = planned(plan(both, tmp_path))
    assert frames(recording) == 600.0
    assert found["render own"].weight == pytest.approx(3.0 + 0.08 * 600)
    assert found["report"].work.recorded and not plan(suite, tmp_path)[-1].work.recorded
    assert not [job.name for job in plan_flights(both, tmp_path) if "own" in job.name]
    code = jobs.code_hash
    monkeypatch.setattr(jobs, "code_hash", lambda *names: code(*names) + " edited" * ("tracker" in names))
    edited = planned(plan(both, tmp_path))
    rendered = f"render {suite.sequences[0].name}"
    assert edited["render own"].content_hash != found["render own"].content_hash
    assert edited[rendered].content_hash == found[rendered].content_hash
