"""Change points of a history against closed forms: Student's test, logarithms of ratios, and levels without noise."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2, t, ttest_1samp

from uavbench.bench.history.validation import NAME, history_of
from uavbench.reports.history import evidence
from uavbench.reports.history.change_points import ALPHA, changes
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
    return own * by ** sum((np.arange(n) >= k for k in at), np.zeros(n))[:, None]


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


def test_one_estimate_beside_the_noise_of_flights_keeps_its_own_freedom():
    """A flight that draws four times in 20 commits: 18 degrees of freedom, not the 2 of its noise."""
    worse = np.repeat([0.02, -0.02, 0.14, 0.10], 5)[:, None]
    error = np.sqrt(0.04**2 / 2)  # of each draw, and +-1/2 of four of them make the contrast
    assert evidence.tested(series(worse), step(20, 10), [10]) == (
        pytest.approx(np.expm1(0.12)),
        pytest.approx(2 * t.cdf(-0.12 / error, 18)),
    )


def test_where_commits_differ_at_a_step_alone_their_level_has_no_noise():
    steps = np.random.default_rng(3).normal(0.05, 0.02, 8)
    worse = np.vstack([np.zeros(8), steps])
    p = evidence.tested(series(worse), np.array([-1.0, 1.0]), [1]).p
    assert p == pytest.approx(2 * t.cdf(-steps.mean() / (steps.std(ddof=1) / np.sqrt(8)), 1))


def alternating(n, *sizes):
    """Flights that go up and down by their sizes with every commit."""
    return (-1.0) ** np.arange(n)[:, None] * np.array(sizes)


def test_noise_of_flights_is_theirs_and_in_part_that_of_all():
    """Differences of 2 a have a variance of 2 a^2; three more differences are those of the average flight."""
    n, flat = 10, step(10, 5)
    found = evidence._of_noise(series(alternating(n, *[0.1] * 4)), flat, [])
    assert found.value == pytest.approx(2 * 0.1**2 * (flat @ flat) / 4)
    assert found.freedom == pytest.approx(4 * 2 / 3 * 9)
    usual = (2 * 0.1**2 + 2 * 0.3**2) / 2
    own = [(9 * 2 * a**2 + 3 * usual) / 12 for a in (0.1, 0.3)]
    parts = np.array(own) * (flat @ flat) / 4
    found = evidence._of_noise(series(alternating(n, 0.1, 0.3)), flat, [])
    assert found.value == pytest.approx(parts.sum())
    assert found.freedom == pytest.approx(parts.sum() ** 2 / (parts**2 / (2 / 3 * 9)).sum())
    once = np.column_stack([alternating(n, 0.1)[:, 0], np.repeat([0.0, 1.0], 5)])  # a flight that moves at the step
    parts = np.array([0.02 * (flat @ flat), 0.02 * 2]) / 4
    found = evidence._of_noise(series(once), flat, [5])
    assert found.value == pytest.approx(parts.sum())
    assert found.freedom == pytest.approx(parts.sum() ** 2 / (parts**2 / (2 / 3 * np.array([8, 1]))).sum())


def test_noise_of_the_level_and_the_spread_of_flights_are_as_well_known_as_they_have_differences():
    worse = alternating(10, *[0.1] * 6)
    contrast = step(10, 5)
    level, flights = evidence._others(series(worse), contrast, [5], np.array([1.0, -1.0, 2.0, -2.0, 0.0, 0.0]))
    assert (level.value, level.freedom) == (pytest.approx(0.02 * (contrast @ contrast)), pytest.approx(2 / 3 * 8))
    assert (flights.value, flights.freedom) == (pytest.approx(10 / 5 / 6), 5)
    stepped = worse + 5.0 * (np.arange(10) >= 3)[:, None]
    level, _ = evidence._others(series(stepped), contrast, [3], np.zeros(6))
    assert (level.value, level.freedom) == (pytest.approx(0.02 * (contrast @ contrast)), pytest.approx(2 / 3 * 8))
    (few,) = evidence._others(series(np.zeros((10, 4))), contrast, [5], np.ones(4))
    assert (few.value, few.freedom) == (pytest.approx(LEAST_SPREAD**2 * (contrast @ contrast)), 8)
    (five,) = evidence._others(series(np.zeros((10, 5))), contrast, [5], np.ones(5))
    assert five.freedom == 4


@pytest.mark.parametrize("freedom", [12.0, 40.0])
def test_an_estimate_agrees_that_is_not_larger_by_the_chi_square_test_and_well_enough_known(freedom):
    known, limit = evidence.Variance(2.0, 99.0), 2.0 * chi2.isf(0.1, freedom) / freedom
    assert evidence.Variance(0.999 * limit, freedom).agrees(known)
    assert not evidence.Variance(1.001 * limit, freedom).agrees(known)
    assert not evidence.Variance(0.0, 11.9).agrees(known)


def test_where_both_estimates_agree_the_freedom_of_the_flights_counts():
    worse = np.random.default_rng(0).normal(0, 0.05, (40, 20))
    found, contrast = series(worse), step(40, 20)
    noise = evidence._of_noise(found, contrast, [])
    mean = (contrast @ worse).mean()
    others = list(evidence._others(found, contrast, [], contrast @ worse - mean))
    assert len(others) == 2 and all(each.agrees(noise) for each in others)
    largest = max(each.value for each in (noise, *others))
    assert noise.freedom > 300
    assert evidence.tested(found, contrast, []).p == pytest.approx(
        2 * t.cdf(-abs(mean) / np.sqrt(largest), noise.freedom)
    )


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


def one_flight(n, cut, size):
    """A flight that is worse by a size in logs from a commit on, and repeats its digits else."""
    return series(np.repeat([0.0, size], [cut, n - cut])[:, None])


@pytest.mark.parametrize(("p", "steps"), [(0.9 * ALPHA, 1), (1.1 * ALPHA, 0)])
def test_a_step_is_told_whose_two_sided_p_is_at_most_one_in_20000(p, steps):
    assert ALPHA == 1 / 20_000
    size = LEAST_SPREAD * np.sqrt(1 / 6 + 1 / 6) * -t.ppf(p / 2, 10)
    assert len(changes(one_flight(12, 6, size), margin=0.001)) == steps


@pytest.mark.parametrize(("errors", "kinds"), [(5.0, ["step"]), (4.25, [])])
def test_a_step_among_many_commits_is_no_line_while_it_is_larger_than_the_penalty(errors, kinds):
    """Of 100 commits a line leaves a quarter of a step's squares; t^2 = 4 log 100 or more is a step."""
    found = changes(one_flight(100, 50, errors * LEAST_SPREAD / 5), margin=0.001)
    assert [change.kind for change in found if change.kind == "step"] == kinds


@pytest.mark.parametrize(("commits", "kind"), [(8, "drift"), (7, "step")])
def test_a_line_is_told_from_a_step_by_eight_commits(commits, kind):
    rising = series_of(history_of(levels(commits, *range(1, commits), by=1.001, flights=40)), *NAME)
    (found,) = changes(rising, margin=0.0031)  # that of the last four commits is 0.003
    assert found.kind == kind
    if kind == "drift":
        assert (found.first, found.at, found.last) == (0, 7, 7)
        assert found.size == pytest.approx(1.001**7 - 1)


def test_changes_are_told_from_four_commits_on():
    assert [change.at for change in changes(series_of(history_of(levels(4, 2)), *NAME))] == [2]
    assert changes(series_of(history_of(levels(3, 1)), *NAME)) == []
    rising = levels(4, 1, 2, 3, by=1.001, flights=40)
    (drift,) = changes(series_of(history_of(rising), *NAME), margin=0.001)
    assert (drift.kind, drift.first, drift.last) == ("drift", 0, 3)


@pytest.mark.parametrize("last", [3, 4])
def test_where_commits_differ_by_chance_a_level_is_of_four_commits(last):
    """Three that are worse are told with the one before them, four as they are."""
    errors = levels(40, flights=15) * np.exp(np.random.default_rng(5).normal(0, 0.05, (40, 15)))
    errors[40 - last :] *= 1.5
    steps = [change.at for change in changes(series_of(history_of(errors), *NAME)) if change.kind == "step"]
    assert steps == [36]


@pytest.mark.parametrize(("large", "small"), [(10, 15), (15, 10)])
def test_a_step_is_judged_anew_without_the_noise_of_any_step_that_is_left(large, small):
    """A step of half a percent goes for the margin; the difference at the one of 10 % stays its step, no noise."""
    errors = levels(24, large) * levels(24, small, by=1.005) / levels(24)
    (found,) = changes(series_of(history_of(errors), *NAME))
    assert (found.kind, found.at) == ("step", large)
    assert found.size == pytest.approx(0.1, abs=0.006)


def test_two_levels_of_four_noisy_commits_are_told():
    errors = levels(8, 4, by=3.0, flights=15) * np.exp(np.random.default_rng(5).normal(0, 0.05, (8, 15)))
    assert [(change.kind, change.at) for change in changes(series_of(history_of(errors), *NAME))] == [("step", 4)]


def test_the_step_before_one_that_goes_is_judged_anew_with_the_longer_level():
    """1.5 % up and 0.75 % down: the second is below the margin, and the first, over all commits since, as well."""
    level = np.repeat([0.0, 0.1, 0.115, 0.1075], [5, 5, 5, 15])
    (found,) = changes(series_of(history_of(levels(30) * np.exp(level)[:, None]), *NAME))
    assert (found.kind, found.at) == ("step", 5)


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


def test_what_is_left_of_shares_is_their_sum():
    """Half of the coverage lost and 0.4 of it won back: a tenth of all frames is left."""
    errors = levels(18)
    shares = np.repeat([1.0, 0.5, 0.9], 6)
    history = history_of(errors)
    commits = [
        replace(c, metrics={NAME[0]: {"coverage": replace(recorded([[share] * 6], "bigger")[0], value=share)}})
        for c, share in zip(history.commits, shares, strict=True)
    ]
    (trend,) = trends(replace(history, commits=commits), 0.01)
    assert [change.size for change in trend.changes] == pytest.approx([0.5, -0.4])
    assert trend.alarms == trend.changes[:1]
