"""The history of a suite: change points, drift, alarms, the page and the forms of other services."""

import fcntl
import json
import os
import subprocess
import sys
import threading
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

from uavbench.bench.cli.main import main
from uavbench.bench.history.record import _recorded, alone
from uavbench.bench.history.validation import RERUNS, Trial, history_of, measured, resampled
from uavbench.reports.history import change_points
from uavbench.reports.history.change_points import changes
from uavbench.reports.history.history_file import Recorded, read_history, write_history
from uavbench.reports.history.series import series_of
from uavbench.reports.history.trend import trends
from uavbench.scenes.dataset.table_files import read_json

NAME = ("tracker", "metric")
FLIGHTS = read_json(RERUNS)["robust@15hz"]["ATE"]


def noisy(commits, seed=0, flights=FLIGHTS):
    return resampled(flights, commits, np.random.default_rng(seed))


def found(errors):
    return changes(series_of(history_of(errors), *NAME))


def test_the_interval_of_a_share_ends_where_shares_do():
    """The widened bootstrap of these reaches beyond."""
    shares = {(f"flight-{k}", 0): value for k, value in enumerate([1.0, 1.0, 0.6, 1.0])}
    found = _recorded(shares, "", bigger=True)
    assert (found.value, found.high) == (0.9, 1.0) and 0.4 < found.low < 0.6
    least = _recorded({key: 1.0 - value for key, value in shares.items()}, "", bigger=True)
    assert least.low == 0.0
    assert _recorded({key: 5.0 + key[0].count("3") for key in shares}, "cm", bigger=False).high > 5.0


def test_a_folder_that_a_failed_record_removed_is_locked_as_it_was_made_again(tmp_path):
    """Else one process would hold the removed folder and another one the new one, at the same time."""
    folder = tmp_path / "history"
    folder.mkdir()
    failing = os.open(folder, os.O_RDONLY)
    fcntl.flock(failing, fcntl.LOCK_EX)
    entered, leave = threading.Event(), threading.Event()

    def record():
        with alone(folder / "history.json"):
            entered.set()
            leave.wait()

    thread = threading.Thread(target=record)
    thread.start()
    try:
        assert not entered.wait(0.3)
        folder.rmdir()
        os.close(failing)
        assert entered.wait(30.0)
        other = os.open(folder, os.O_RDONLY)
        with pytest.raises(BlockingIOError):
            fcntl.flock(other, fcntl.LOCK_EX | fcntl.LOCK_NB)
        os.close(other)
    finally:
        leave.set()
        thread.join()


@pytest.mark.parametrize(
    ("tracker", "metric"),
    [
        ("robust", "ATE"),
        pytest.param("robust", "ATE rotation", marks=pytest.mark.ci),
        pytest.param("robust", "RPE 1 s", marks=pytest.mark.ci),
        ("lsd", "ATE"),
        pytest.param("lsd", "ATE rotation", marks=pytest.mark.ci),
    ],
)
def test_five_percent_are_found_within_five_commits_and_nothing_is_found_in_nothing(tracker, metric):
    shares = measured(read_json(RERUNS)[f"{tracker}@15hz"][metric], Trial(looks=37))
    assert shares["steps found"] >= 90
    assert shares["false alarms"] <= 1
    assert shares["drifts found"] >= 90


def slipping(rng, shape):
    """A flight in thirty slips, by a factor that has no bound."""
    return rng.normal(0, 0.15, shape) + (rng.random(shape) < 0.03) * rng.exponential(1.5, shape)


NOISE = {
    "heavy tails": lambda rng, shape: 0.15 * rng.standard_t(2, shape),
    "slips": slipping,
    "what flights share": lambda rng, shape: rng.normal(0, 0.05, shape) + rng.normal(0, 0.1, (shape[0], 1)),
    "commits that slip": lambda rng, shape: rng.normal(0, 0.05, shape) + 0.05 * rng.standard_t(2, (shape[0], 1)),
}


@pytest.mark.parametrize("kind", NOISE)
def test_noise_of_any_kind_alarms_seldom(kind):
    looks, alarmed = (8, 16, 24, 32, 40), 0
    for seed in range(50):
        rng = np.random.default_rng(seed)
        errors = 0.01 * np.exp(NOISE[kind](rng, (40, 15)))
        alarmed += any(change.size > 0 for n in looks for change in found(errors[:n]))
    assert alarmed <= 1


def test_a_commit_that_slips_as_a_whole_is_no_step_where_commits_differ_by_chance():
    errors = noisy(30)
    errors[20] *= 1.5
    for n in (21, 22, 30):
        assert not [change for change in found(errors[:n]) if change.kind == "step"]


def test_a_step_is_told_where_it_is_and_how_large():
    errors = noisy(50)
    errors[30:] *= 1.1
    (step,) = found(errors)
    assert step.kind == "step" and abs(step.at - 30) <= 1 and step.size == pytest.approx(0.1, abs=0.02)


def test_a_drift_that_no_two_commits_show_is_told_as_one():
    """Of 100 seeds, 95 are; in the others it begins with one step or two."""
    told = [found(noisy(60, seed) * 1.002 ** np.arange(60)[:, None]) for seed in range(10)]
    alone = [of_seed[0] for of_seed in told if len(of_seed) == 1]
    assert len(alone) >= 8
    for drift in alone:
        assert drift.kind == "drift" and (drift.first, drift.last) == (0, 59)
        assert drift.size == pytest.approx(1.002**59 - 1, abs=0.03)


def test_three_commits_that_made_it_worse_are_each_told():
    errors = noisy(80)
    for at in (20, 45, 65):
        errors[at:] *= 1.08
    assert [step.kind for step in found(errors)] == ["step"] * 3
    assert np.abs(np.array([step.at for step in found(errors)]) - [20, 45, 65]).max() <= 1


def test_chance_that_is_drawn_once_and_stays_is_no_change():
    """With fixed seeds the commits repeat the same digits until one draws other random numbers."""
    alarmed = 0
    for seed in range(50):
        errors = np.repeat(noisy(4, seed), 10, axis=0)
        alarmed += any(change.size > 0 for change in found(errors))
    assert alarmed <= 1


def test_equal_digits_and_one_worse_commit_are_told_at_once():
    errors = np.repeat(noisy(1), 12, axis=0)
    assert found(errors) == []
    errors[-1] *= 1.05
    (step,) = found(errors)
    assert step.at == 11 and step.size == pytest.approx(0.05)
    assert [c.at for c in found(errors[:, :1])] == [11], "with one flight"


@pytest.mark.parametrize("noise", [0.0, 0.01, 0.03])
@pytest.mark.parametrize(("share", "step"), [(0.3, 0.15), (0.5, 0.2), (0.6, 0.15)])
def test_a_step_of_some_of_the_flights_is_told_as_large_as_their_mean(share, step, noise):
    """The flights that it leaves as they were must not count for more than those that it makes worse."""
    rng, worse = np.random.default_rng(0), np.arange(90) < 90 * share
    errors = 0.01 * np.exp(rng.normal(0, 0.3, 90) + rng.normal(0, noise, (30, 90)))
    errors[18:, worse] *= 1 + step
    (found_step,) = found(errors)
    assert (found_step.kind, found_step.at) == ("step", 18)
    assert found_step.size == pytest.approx((1 + step) ** worse.mean() - 1, rel=0.1)


def test_changes_that_only_few_commits_made_in_the_same_flights_are_each_told():
    errors = np.tile(0.01 * np.exp(np.random.default_rng(0).normal(0, 0.3, 90)), (40, 1))
    for at in (8, 16, 24, 30):
        errors[at:, :42] *= 1.03
    steps = found(errors)
    assert [step.at for step in steps] == [8, 16, 24, 30]
    assert [step.size for step in steps] == pytest.approx([1.03 ** (42 / 90) - 1] * 4, rel=0.05)


def test_a_run_that_slips_by_chance_is_no_change_and_hides_none():
    errors = noisy(50)
    errors[40:, 3] *= 20
    assert found(errors) == []
    errors[30:] *= 1.1
    assert [abs(step.at - 30) <= 1 for step in found(errors)] == [True]


def test_a_step_that_goes_leaves_only_its_neighbours_to_be_judged_anew(monkeypatch):
    levels = np.exp(np.repeat(np.random.default_rng(1).normal(0, 1, 40), 5))
    series, steps = series_of(history_of(noisy(200) * levels[:, None]), *NAME), []
    proposed, judged = len(change_points._proposed(series)), change_points._step
    monkeypatch.setattr(change_points, "_step", lambda *place: steps.append(place) or judged(*place))
    assert changes(series, margin=1e9) == []  # all are too small, and go one at a time
    assert proposed > 30 and len(steps) <= 3 * proposed


def test_runs_without_a_number_are_no_change():
    history = history_of(noisy(30))
    commits = []
    for k, commit in enumerate(history.commits):
        runs = {"all": [None if (k + i) % 7 == 0 else v for i, v in
                        enumerate(commit.metrics[NAME[0]][NAME[1]].runs["all"])]}  # fmt: skip
        metric = replace(commit.metrics[NAME[0]][NAME[1]], runs=runs)
        commits.append(replace(commit, metrics={NAME[0]: {NAME[1]: metric}}))
    assert changes(series_of(replace(history, commits=commits), *NAME)) == []


@pytest.mark.parametrize("error", [0.0, 1e-300, 1e300])
def test_errors_of_any_size_and_none_at_all_are_followed(error):
    errors = noisy(12)
    errors[6:] = error
    assert len(found(np.maximum(errors, 1e-300))) == 1
    empty = history_of(errors[:, :0] + 1.0)
    assert trends(empty, 0.01) == []


def covered(shares):
    """A history of one tracker's coverage, shares (commits, flights)."""
    history = history_of(np.ones((len(shares), 2)))
    commits = [
        replace(commit, metrics={NAME[0]: {"coverage": Recorded(
            unit="", better="bigger", value=float(np.mean(row)), low=None, high=None, runs={"all": list(row)})}})
        for commit, row in zip(history.commits, shares, strict=True)
    ]  # fmt: skip
    return replace(history, commits=commits)


def test_a_loss_of_coverage_is_worse_and_a_gain_is_not():
    shares = np.ones((20, 6))
    shares[12:] -= 0.1
    (trend,) = trends(covered(shares), 0.01)
    assert [(c.at, round(c.size, 6)) for c in trend.alarms] == [(12, 0.1)]
    (trend,) = trends(covered(shares[::-1]), 0.01)
    assert len(trend.changes) == 1 and trend.alarms == []


def test_what_was_made_good_and_what_is_accepted_do_not_alarm():
    errors = noisy(50)
    errors[20:35] *= 1.1
    history = history_of(errors)
    (trend,) = trends(history, 0.01)
    assert len(trend.changes) == 2 and trend.alarms == []
    again = errors.copy()
    again[44:] *= 1.1
    (trend,) = trends(history_of(again), 0.01)
    assert len(trend.changes) == 3 and trend.alarms == trend.changes[2:]
    errors[35:] *= 1.1
    (trend,) = trends(history_of(errors), 0.01)
    assert len(trend.alarms) == 1
    (trend,) = trends(history_of(errors), 0.01, since=history.commits[30].commit)
    assert len(trend.changes) == 1 and trend.alarms == []


def named(history):
    commits = [
        replace(c, subject="<script>alert(1)</script> $x_1$", time=f"2026-01-{k % 28 + 1:02d}T00:00:00+00:00")
        for k, c in enumerate(history.commits)
    ]
    return replace(history, suite=replace(history.suite, name="mine"), commits=commits)


def test_the_command_writes_a_page_figures_and_forms(tmp_path):
    errors = noisy(30)
    errors[20:] *= 1.1
    write_history(tmp_path / "history.json", named(history_of(errors)))
    arguments = ["history", str(tmp_path / "history.json"), "--out", str(tmp_path / "out")]
    result = CliRunner().invoke(main, arguments)
    assert result.exit_code == 1, result.output
    assert "ALARM  tracker metric: " in result.output and "worse with" in result.output
    page = (tmp_path / "out/index.html").read_text()
    assert "<script>alert" not in page and "worse" in page and "http" not in page
    about = json.loads((tmp_path / "out/changes.json").read_text())
    assert about["verdict"] == "alarm" and about["changes"][0]["kind"] == "step"
    (smaller,) = json.loads((tmp_path / "out/github-smaller.json").read_text())
    assert smaller["name"] == "tracker metric" and smaller["unit"] == "m"
    assert smaller["value"] == pytest.approx(np.exp(np.log(errors[-1]).mean()), rel=1e-5)
    assert json.loads((tmp_path / "out/github-bigger.json").read_text()) == []
    bencher = json.loads((tmp_path / "out/bencher.json").read_text())
    assert bencher == {"tracker": {"metric (m)": {"value": smaller["value"]}}}
    assert {p.suffix for p in (tmp_path / "out/figures").iterdir()} == {".pdf", ".png", ".csv"}
    accepted = CliRunner().invoke(main, [*arguments, "--since", f"{25:040x}"])
    assert accepted.exit_code == 0, accepted.output


def test_a_value_of_an_earlier_commit_is_not_given_as_that_of_the_latest(tmp_path):
    """A tracker that has another name since, and one that gives no number any more."""
    history = history_of(noisy(6))
    *before, last = history.commits
    moved = replace(last, commit="f" * 40, metrics={"renamed": last.metrics["tracker"]})
    write_history(tmp_path / "history.json", replace(history, commits=[*before, moved]))
    done = CliRunner().invoke(main, ["history", str(tmp_path / "history.json"), "--out", str(tmp_path / "out")])
    assert done.exit_code == 0, done.output
    (smaller,) = json.loads((tmp_path / "out/github-smaller.json").read_text())
    assert smaller["name"] == "renamed metric" and smaller["extra"].startswith(moved.commit)
    assert list(json.loads((tmp_path / "out/bencher.json").read_text())) == ["renamed"]
    page = (tmp_path / "out/index.html").read_text()
    assert page.count(f"last with {before[-1].commit[:9]}") == 1 and "last with fff" not in page


def test_mistakes_are_told(tmp_path, monkeypatch):
    file = tmp_path / "history.json"
    write_history(file, history_of(noisy(3)))
    out = ["--out", str(tmp_path / "out")]
    few = CliRunner().invoke(main, ["history", str(file), *out])
    assert few.exit_code == 0 and "3 of the 4 commits" in few.output
    write_history(file, history_of(noisy(0)))
    none = CliRunner().invoke(main, ["history", str(file), *out])
    assert none.exit_code == 2 and "no commits" in none.output
    write_history(file, history_of(noisy(9)))
    unknown = CliRunner().invoke(main, ["history", str(file), "--since", "feed", *out])
    assert unknown.exit_code == 2 and "--since feed" in unknown.output
    monkeypatch.setitem(sys.modules, "ruptures", None)
    absent = CliRunner().invoke(main, ["history", str(file), *out])
    assert absent.exit_code == 2 and "pip install 'uavbench[history]'" in absent.output
    file.write_text(file.read_text()[:-20])
    cut = CliRunner().invoke(main, ["history", str(file), *out])
    assert cut.exit_code == 2 and "history.json" in cut.output and "earlier run" in cut.output


def test_a_history_is_read_as_it_was_written(tmp_path):
    history = named(history_of(noisy(5)))
    write_history(tmp_path / "history.json", history)
    assert read_history(tmp_path / "history.json") == history


def test_commands_do_not_load_the_detector():
    code = "import uavbench.bench.cli.main, sys; print('ruptures' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "False\n"
    assert change_points.ALPHA < 0.001
