"""Change points of a history against closed forms: Student's test, logarithms of ratios, and levels without noise."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import t, ttest_1samp

from uavbench.bench.history.validation import NAME, history_of
from uavbench.reports.history import evidence
from uavbench.reports.history.change_points import changes
from uavbench.reports.history.history_file import Recorded
from uavbench.reports.history.series import AT_MOST, LEAST_SPREAD, Series, flights_worse, series_of, spread, weights_of
from uavbench.reports.history.trend import trends
from uavbench.trajectories.errors import UserError


def series(worse, *, bigger=False):
    """A series of these values (commits, flights), in which every flight counts alike."""
    n, flights = worse.shape
    numbers = np.zeros(n)
    return Series(
        tracker="a", metric="ATE", unit="m", bigger=bigger, commits=[None] * n, value=numbers, low=numbers,
        high=numbers, worse=worse, weights=np.full(flights, 1 / flights),
    )  # fmt: skip


def step(n, cut):
    """The contrast of the commits from `cut` on with those before."""
    after = np.arange(n) >= cut
    return np.where(after, 1 / (n - cut), -1 / cut)


def levels(n, *at, by=1.1, flights=6):
    """Errors (n, flights) in m without noise, that become larger by a factor at commits."""
    own = 0.01 * (1 + np.arange(flights))
    return own * by ** sum((np.arange(n) >= k).astype(float) for k in at)[:, None]


@pytest.mark.parametrize("bigger", [False, True])
def test_a_step_that_each_flight_draws_once_has_the_p_of_students_test_over_the_flights(bigger):
    steps = np.random.default_rng(1).normal(0.004, 0.005, 15)
    worse = np.vstack([np.zeros((6, 15)), np.tile(steps, (6, 1))])
    size, p = evidence.tested(series(worse, bigger=bigger), step(12, 6), [6])
    assert p == pytest.approx(ttest_1samp(steps, 0).pvalue)
    assert size == pytest.approx(steps.mean() if bigger else np.expm1(steps.mean()))
    fewer = evidence.tested(series(-worse, bigger=bigger), step(12, 6), [6])
    assert fewer.p == pytest.approx(p) and fewer.size < 0, "two-sided"


def test_few_flights_are_tested_by_the_least_spread_of_the_commits():
    worse = np.repeat([[0.0], [0.004]], [6, 6], axis=0)
    error = LEAST_SPREAD * np.sqrt(1 / 6 + 1 / 6)
    assert evidence.tested(series(worse), step(12, 6), [6]).p == pytest.approx(2 * t.cdf(-0.004 / error, 10))


def test_p_is_uniform_at_most_where_flights_slip_each_for_itself_or_all_together():
    for together in (False, True):
        p = []
        for seed in range(150):
            worse = np.random.default_rng(seed).normal(0, 0.05, (30, 1 if together else 10))
            p.append(evidence.tested(series(np.broadcast_to(worse, (30, 10))), step(30, 15), []).p)
        assert (np.array(p) < 0.05).mean() <= 0.09
        assert 0.3 < (np.array(p) < 0.5).mean() < 0.6, together


@pytest.mark.parametrize("at", [(5,), (5, 9), (4, 9, 12)])
def test_steps_without_noise_are_told_with_their_commits_and_sizes(at):
    found = changes(series_of(history_of(levels(16, *at)), *NAME))
    ends = [0, *at, 16]
    assert [(c.kind, c.at) for c in found] == [("step", k) for k in at]
    assert [(c.first, c.last) for c in found] == [(a, b - 1) for a, b in zip(ends, ends[2:], strict=False)]
    assert [c.size for c in found] == pytest.approx([0.1] * len(at))


def test_a_drift_is_told_from_its_first_commit_to_its_last_with_its_whole_rise():
    (drift,) = changes(series_of(history_of(levels(14, *range(1, 14), by=1.01)), *NAME))
    assert (drift.kind, drift.first, drift.last, drift.at) == ("drift", 0, 13, 13)
    assert drift.size == pytest.approx(1.01**13 - 1)


def test_what_is_smaller_than_the_margin_is_no_change():
    half_a_percent = series_of(history_of(levels(12, 6, by=1.005)), *NAME)
    assert changes(half_a_percent, margin=0.006) == []
    (found,) = changes(half_a_percent, margin=0.004)
    assert found.size == pytest.approx(0.005)
    better = changes(series_of(history_of(levels(12, 6, by=1 / 1.1)), *NAME))
    assert [c.size for c in better] == pytest.approx([1 / 1.1 - 1])


def recorded(rows, better="smaller"):
    return [Recorded(unit="", better=better, value=1.0, low=None, high=None, runs={"all": list(row)}) for row in rows]


def test_flights_are_measured_in_logs_of_their_own_medians():
    rows = [[1.0, 10.0, 100.0], [1.1, 11.0, 110.0], [1.2, 12.0, 120.0]]
    np.testing.assert_allclose(
        flights_worse(recorded(rows), bigger=False), np.log([[1 / 1.1] * 3, [1] * 3, [12 / 11] * 3])
    )
    shares = [[1.0, 0.5], [0.9, 0.6], [0.8, 0.7]]
    worse = flights_worse(recorded(shares, "bigger"), bigger=True)
    np.testing.assert_allclose(worse, [[-0.1, 0.1], [0.0, 0.0], [0.1, -0.1]], atol=1e-12)


def test_a_run_that_slips_is_limited_around_its_commit_and_one_without_a_number_is_as_the_others():
    rows = [[1.0] * 5, [1.0] * 5, [1.2, 1.2, 1.2, 1.2, 99.0], [1.2, 1.2, 1.2, 1.2, 1e-9], [1.2, 1.2, 1.2, 1.2, None]]
    last = flights_worse(recorded([*rows, *rows[:2]]), bigger=False)[:, 4]
    common = np.log(1.2)
    np.testing.assert_allclose(last, [0, 0, common + AT_MOST, common - AT_MOST, common, 0, 0], atol=1e-12)
    nowhere = flights_worse(recorded([[1.0, None], [2.0, None]]), bigger=False)
    assert nowhere.shape == (2, 1)


def test_a_flight_as_unsteady_as_most_counts_a_fifth_of_a_steady_one():
    unsteady = 0.1 * (-1.0) ** np.arange(20)
    weights = weights_of(np.column_stack([unsteady, -unsteady, unsteady, np.zeros(20)]))
    np.testing.assert_allclose(weights[:3] / weights[3], 1 / 5)
    assert weights.sum() == pytest.approx(1.0)


def test_the_spread_is_the_standard_deviation_about_levels_that_change_seldom():
    values = np.random.default_rng(2).normal(0, 0.3, 20_001)
    assert spread(values) == pytest.approx(0.3, rel=0.03)
    values[7000:] += 50.0
    values[13_000:] -= 20.0
    assert spread(values) == pytest.approx(0.3, rel=0.03)
    assert spread(values[:1]) == 0.0


def named(history):
    return replace(history, commits=[replace(c, subject=f"change {k}") for k, c in enumerate(history.commits)])


def test_what_changed_with_the_named_commit_itself_is_not_accepted():
    history = named(history_of(levels(12, 6)))
    for since, alarms in ((6, 1), (7, 0)):
        (trend,) = trends(history, 0.01, since=history.commits[since].commit)
        assert (len(trend.changes), len(trend.alarms)) == (1, alarms)
    for wrong in ("0" * 30, "feed"):
        with pytest.raises(UserError, match="more than one commit" if wrong[0] == "0" else "no commit"):
            trends(history, 0.01, since=wrong)


def test_a_change_is_said_with_its_size_its_commit_and_its_direction():
    (worse,) = trends(named(history_of(levels(12, 6))), 0.01)
    assert worse.said(worse.changes[0]) == "tracker metric: 10.0 % worse with 000000000 (change 6)"
    (better,) = trends(named(history_of(levels(12, 6, by=0.8))), 0.01)
    assert "20.0 % better with" in better.said(better.changes[0]) and better.alarms == []
    (drift,) = trends(named(history_of(levels(14, *range(1, 14), by=1.01))), 0.01)
    assert drift.said(drift.changes[0]) == "tracker metric: 13.8 % worse by drift from 000000000 to 000000000"


@pytest.mark.parametrize(("by", "back", "alarms"), [(1.1, 1 / 1.1, 0), (1.1, 1 / 1.08, 1), (1.5, 1 / 1.5, 0)])
def test_what_was_made_good_in_part_alarms_while_what_is_left_is_at_least_the_margin(by, back, alarms):
    errors = levels(18, 6, by=by)
    errors[12:] *= back
    (trend,) = trends(history_of(errors), 0.01)
    assert (len(trend.changes), len(trend.alarms)) == (2, alarms)
