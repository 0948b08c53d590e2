"""What is in the key of each job: a change makes just those jobs stale whose output it may change."""

from dataclasses import replace

import pytest

from tests.bench.small_suites import FLOWN
from uavbench.bench.config.suite import load_suite
from uavbench.bench.runner import jobs
from uavbench.bench.runner.jobs import plan, plan_flights
from uavbench.tracker.baselines.hold import Hold
from uavbench.tracker.initialization import CoarseGuess
from uavbench.tracker.registry import TRACKERS

TRACKED = {"track", "restart", "score", "report"}
"""Every job of a suite that needs a tracker's run."""
REPLAYED = {"render", *TRACKED}
FLIGHT = {"fly", "scoreflight", "video", "reportflights"}


@pytest.fixture
def suite(tmp_path):
    (tmp_path / "few.toml").write_text(FLOWN)
    return replace(load_suite(tmp_path / "few.toml"), trackers={"a": Hold()}, protocols=("reset",))


def keys(planned):
    """Content hashes by what the jobs do."""
    return {(type(job.work).__name__.lower(), k): job.content_hash for k, job in enumerate(planned)}


def stale(before, after):
    """What jobs with another key do."""
    assert before.keys() == after.keys() and len(set(before.values())) == len(before)
    return {kind for (kind, k), key in before.items() if after[kind, k] != key}


def both(suite, folder, **options):
    return keys(plan(suite, folder, **options)), keys(plan_flights(suite, folder, video=True, **options))


def longer(suite):
    spec = suite.sequences[0]
    return replace(suite, sequences=(replace(spec, rate_hz=2 * spec.rate_hz),))


def another_seed(suite):
    return replace(suite, sequences=(replace(suite.sequences[0], seed=7),))


def wider(suite):
    return replace(suite, loops={"": replace(suite.loops[""], corridor_m=0.5)})


CHANGES = {
    "sequence": (longer, REPLAYED, FLIGHT),
    "seed": (another_seed, REPLAYED, FLIGHT),
    "title": (lambda s: replace(s, title="other"), {"report"}, {"reportflights"}),
    "start": (lambda s: replace(s, start=CoarseGuess()), TRACKED, FLIGHT),
    "rate": (lambda s: replace(s, rates_hz=(5.0,)), TRACKED, FLIGHT),
    "label": (lambda s: replace(s, trackers={"b": Hold()}), TRACKED, FLIGHT),
    "tracker": (lambda s: replace(s, trackers={"a": TRACKERS["vo"]()}), TRACKED, FLIGHT),
    "protocol": (lambda s: replace(s, protocols=("anchors",)), {"restart", "report"}, set()),
    "loop": (wider, set(), FLIGHT),
}


@pytest.mark.parametrize("what", CHANGES)
def test_what_a_suite_says_is_in_the_keys_of_what_it_changes(suite, tmp_path, what):
    change, replayed, flown = CHANGES[what]
    (old, old_flown), (new, new_flown) = both(suite, tmp_path), both(change(suite), tmp_path)
    assert stale(old, new) == replayed
    assert stale(old_flown, new_flown) == flown


@pytest.mark.parametrize(
    ("package", "replayed", "flown"),
    [
        ("trajectories", REPLAYED, FLIGHT),
        ("scenes", REPLAYED, FLIGHT),
        ("tracker", TRACKED, FLIGHT),
        ("reports", {"restart", "score", "report"}, {"scoreflight", "video", "reportflights"}),
        ("reports/closed_loop", set(), FLIGHT),
        ("bench/closed_loop", set(), FLIGHT),
        ("bench/filming", set(), {"video", "reportflights"}),
    ],
)
def test_code_is_in_the_keys_of_the_jobs_that_run_it(suite, tmp_path, monkeypatch, package, replayed, flown):
    old, old_flown = both(suite, tmp_path)
    code = jobs.code_hash
    monkeypatch.setattr(jobs, "code_hash", lambda *names: code(*names) + " edited" * (package in names))
    new, new_flown = both(suite, tmp_path)
    assert stale(old, new) == replayed
    assert stale(old_flown, new_flown) == flown


def test_what_figures_are_for_and_which_trackers_are_absent_is_in_the_key_of_the_report_alone(
    suite, tmp_path, monkeypatch
):
    old, old_flown = both(suite, tmp_path)
    new, new_flown = both(suite, tmp_path, figures="print")
    assert (stale(old, new), stale(old_flown, new_flown)) == ({"report"}, {"reportflights"})
    monkeypatch.setattr(jobs, "absent", lambda trackers: {"c": "not set up"})
    new, new_flown = both(suite, tmp_path)
    assert (stale(old, new), stale(old_flown, new_flown)) == ({"report"}, {"reportflights"})


def test_a_report_without_any_tracker_is_stale_when_its_code_changes(suite, tmp_path, monkeypatch):
    monkeypatch.setattr(jobs, "absent", lambda trackers: dict.fromkeys(trackers, "not set up"))
    old, old_flown = both(suite, tmp_path)
    code = jobs.code_hash
    monkeypatch.setattr(jobs, "code_hash", lambda *names: code(*names) + " edited" * ("reports" in names))
    new, new_flown = both(suite, tmp_path)
    assert (stale(old, new), stale(old_flown, new_flown)) == ({"report"}, {"reportflights"})


def test_a_report_of_flights_with_videos_has_another_key(suite, tmp_path):
    with_videos, without = (plan_flights(suite, tmp_path, video=video)[-1].content_hash for video in (True, False))
    assert with_videos != without
