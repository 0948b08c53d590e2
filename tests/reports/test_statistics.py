"""Bootstrap, Holm and ranks: closed forms, calibration, and pairs that do not match."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import friedmanchisquare, norm, t

from tests.reports.drawn import RATE_HZ, track
from uavbench.reports.scoring.attributes import ATTRIBUTES, breakdown, breakdowns
from uavbench.reports.scoring.runs import ScoredRun
from uavbench.reports.scoring.score import score
from uavbench.reports.statistics.bootstrap import (
    Bootstrap,
    Ranks,
    _weights,
    compare,
    compare_pairs,
    compare_with,
    hierarchical_interval,
    holm,
    least_units,
    ranks,
    sign_flip_p,
)
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.trajectories.errors import UserError

UNTOLD = {"blur", "occlusion"}
"""Attributes of which the drawn sequence knows nothing: it has neither a config nor a ground truth of its edges."""


def test_the_interval_is_calibrated() -> None:
    """Of intervals over 12 sequences x 3 seeds, close to 95 % hold the true mean."""
    rng = np.random.default_rng(0)
    inside = 0
    for trial in range(200):
        values = [rng.normal(rng.normal(0, 1), 0.5, 3) for _ in range(12)]
        interval = hierarchical_interval(values, seed=trial)
        inside += interval.low <= 0 <= interval.high
    assert 0.89 <= inside / 200 <= 0.99


@pytest.mark.parametrize("runs", [3, 6, 10])
def test_intervals_of_few_runs_hold_the_true_mean_as_often_as_they_say(runs: int) -> None:
    """A bootstrap alone holds it in 82 % with three runs and in 90 % with six."""
    rng = np.random.default_rng(0)
    found = [hierarchical_interval([rng.normal(0, 1, runs)]) for _ in range(500)]
    assert 0.925 <= np.mean([each.low <= 0 <= each.high for each in found]) <= 0.985


def test_the_interval_of_many_seeds_is_the_normal_one() -> None:
    values = np.random.default_rng(1).normal(3.0, 2.0, 400)
    interval = hierarchical_interval([values])
    half = norm.ppf(0.975) * values.std(ddof=1) / np.sqrt(400)
    assert interval.mean == pytest.approx(values.mean())
    assert (interval.high - interval.low) / 2 == pytest.approx(half, rel=0.06)


def test_one_value_has_no_interval() -> None:
    interval = hierarchical_interval([np.array([2.0])])
    assert interval.mean == 2.0 and np.isnan(interval.low) and np.isnan(interval.high)
    assert interval.why == "1 run, 3 are needed"


@pytest.mark.parametrize(
    ("values", "why"),
    [
        ([np.arange(2.0)], "2 runs, 3 are needed"),
        ([np.arange(9.0), np.arange(9.0) + 1], "2 sequences, 3 are needed"),
        ([np.full(9, 0.1)], "the values of all 9 runs are equal"),
        ([np.full(2, 0.1), np.full(3, 0.1), np.full(4, 0.1)], "the values of all 3 sequences are equal"),
    ],
)
def test_no_interval_is_presented_as_certain(values: list[np.ndarray], why: str) -> None:
    interval = hierarchical_interval(values)
    assert interval.why == why
    assert np.isnan([interval.low, interval.high]).all()


@pytest.mark.parametrize(("rivals", "least"), [(1, 6), (2, 7), (3, 7), (10, 9)])
def test_significance_needs_as_many_pairs_as_an_exact_test(rivals: int, least: int) -> None:
    """The sign-flip test of n pairs has 2^n outcomes, so that its two-sided p is 2/2^n at least."""
    assert least_units(rivals) == least
    for n in (least - 1, least):
        values = {f"t{k}": [k + np.arange(n) / 100 * (1 + k)] for k in range(1, rivals + 1)}
        found = compare_with("best", {"best": [np.arange(n) / 100], **values})
        assert {c.significant for c in found} == {n == least}


def test_one_flight_under_many_names_is_one_pair() -> None:
    """Seeds that were all the same, and copies of a sequence, add nothing."""
    for a, b in (([np.full(50, 1.0)], [np.full(50, 2.0)]), ([np.ones(1)] * 50, [np.full(1, 2.0)] * 50)):
        (found,) = compare_pairs({"a": a, "b": b})
        assert found.units == 1
        assert not found.significant


def test_few_blocks_tell_no_ranks_apart() -> None:
    few = ranks({"a": np.arange(5.0), "b": np.arange(5.0) + 1, "c": np.arange(5.0) + 2})
    assert few.cliques == [("a", "b", "c")]
    assert np.isnan(few.p)
    copied = ranks({"a": np.ones(40), "b": np.full(40, 2.0), "c": np.full(40, 3.0)})
    assert copied.cliques == [("a", "b", "c")]


def test_a_sequence_weighs_the_same_however_many_seeds_it_has() -> None:
    assert hierarchical_interval([np.zeros(1), np.ones(99)]).mean == 0.5


def test_the_same_seed_gives_the_same_interval() -> None:
    values = [np.arange(5.0), np.arange(3.0), np.arange(4.0)]
    assert hierarchical_interval(values, seed=3) == hierarchical_interval(values, seed=3)


def test_a_clear_winner_is_significant_and_a_twin_is_not() -> None:
    rng = np.random.default_rng(2)
    base = [rng.normal(5, 1, 5) for _ in range(10)]
    found = compare_pairs({
        "base": base,
        "better": [v - 0.5 + rng.normal(0, 0.1, 5) for v in base],
        "twin": [v + rng.normal(0, 0.1, 5) for v in base],
    })  # fmt: skip
    pairs = {(c.first, c.second): c for c in found}
    assert pairs["base", "better"].significant and pairs["base", "better"].wins == 0
    assert pairs["base", "better"].difference.mean == pytest.approx(0.5, abs=0.05)
    assert not pairs["base", "twin"].significant


def test_p_of_every_pair_is_corrected_over_all_pairs() -> None:
    rng = np.random.default_rng(4)
    values = {
        name: [rng.normal(level, 1, 5) for _ in range(6)]
        for name, level in zip("abcd", (0, 0.3, 0.6, 0.9), strict=True)
    }
    alone = [compare(a, b, values).p for a, b in combinations(values, 2)]
    assert [c.p for c in compare_pairs(values)] == holm(alone) != alone
    assert [c.p for c in compare_with("a", values)] == holm(alone[:3]) != alone[:3]


def test_wins_are_lower_values_ties_counted_half_and_signs_are_those_of_the_first() -> None:
    values = {"a": [np.array([1.0, 2.0, 3.0]), np.array([4.0])], "b": [np.array([2.0, 2.0, 5.0]), np.array([3.0])]}
    found = compare("a", "b", values)
    assert found.wins == 0.625
    assert (found.first, found.second) == ("a", "b")
    assert found.difference.mean == 0.0 and found.difference.n == 4
    assert found.difference.why == "2 sequences, 3 are needed"
    more = {"a": [*values["a"], np.array([7.0])], "b": [*values["b"], np.array([1.0])]}
    known = hierarchical_interval([np.array([-1.0, 0.0, -2.0]), np.array([1.0]), np.array([6.0])])
    assert compare("a", "b", more).difference == known != compare("b", "a", more).difference
    assert known.low < known.mean == 2.0 < known.high
    assert [(c.first, c.second) for c in compare_with("b", values)] == [("b", "a")]
    assert [(c.first, c.second) for c in compare_pairs(values | {"c": values["a"]})] == [
        ("a", "b"), ("a", "c"), ("b", "c"),
    ]  # fmt: skip


def test_p_of_a_comparison_is_two_sided_and_never_zero_nor_above_one() -> None:
    """Of two pairs no test can say more than 1/2; of 20 that differ to one side the bootstrap's least is 2 in 4001."""
    steps = np.arange(20) / 10
    far = {
        "a": [np.array([v]) for v in steps],
        "b": [np.array([v + 5.0]) for v in 1.1 * steps],
        "c": [np.zeros(1)] * 20,
    }
    for first, second in (("a", "b"), ("b", "a")):
        assert compare(first, second, far).p == pytest.approx(2 / 4001)
        assert compare(first, second, {name: v[:2] for name, v in far.items()}).p == 0.5
    assert compare("c", "c", far).p == 1.0
    assert compare("a", "b", {name: v[:1] for name, v in far.items()}).p == 1.0
    drawn = np.random.default_rng(6).normal(0.35, 1.0, 30)
    pairs = {"x": [np.array([v]) for v in drawn], "y": [np.zeros(1)] * 30}
    of_student = 2 * t.sf(abs(drawn.mean()) / (drawn.std(ddof=1) / np.sqrt(30)), 29)
    assert compare("x", "y", pairs).p == pytest.approx(of_student, rel=0.35)
    assert compare("y", "x", pairs).p == pytest.approx(compare("x", "y", pairs).p)


def test_significant_is_at_most_five_percent() -> None:
    one = compare("a", "b", {"a": [np.zeros(2)], "b": [np.ones(2)]})
    assert [replace(one, p=p).significant for p in (0.01, 0.05, 0.0501, np.nan)] == [True, True, False, False]


def test_ranks_need_two_trackers_and_two_runs() -> None:
    found = ranks({"a": np.array([1.0, 2.0]), "b": np.array([2.0, 1.0])})
    assert found.mean_ranks == {"a": 1.5, "b": 1.5} and found.n == 2 and np.isnan(found.p)
    for values in ({"a": np.zeros(3)}, {"a": np.zeros(1), "b": np.ones(1)}):
        with pytest.raises(UserError, match="at least two trackers and two runs"):
            ranks(values)


def test_statistics_of_nothing_are_refused() -> None:
    for values in ([], [np.zeros(0)], [np.ones(2), np.zeros(0)]):
        with pytest.raises(UserError, match="at least one value per sequence"):
            hierarchical_interval(values)


def test_another_confidence_is_another_width() -> None:
    values = [np.array([v]) for v in np.random.default_rng(7).normal(size=200)]
    wide, narrow = (hierarchical_interval(values, confidence=c) for c in (0.99, 0.5))
    halves = [t.ppf(0.5 + c / 2, 199) * np.std(values, ddof=1) / np.sqrt(200) for c in (0.99, 0.5)]
    for interval, half in zip((wide, narrow), halves, strict=True):
        assert interval.n == 200
        assert (interval.low, interval.high) == pytest.approx(
            (interval.mean - half, interval.mean + half), abs=0.1 * half
        )


def test_replicates_draw_sequences_and_then_their_seeds() -> None:
    """Two sequences of 1 and 3 seeds: their variance is between sequences, and within the one that has any."""
    values = [np.array([0.0]), np.array([2.0, 3.0, 7.0])]
    found = Bootstrap.of(values, rounds=10)
    assert found.mean == 2.0
    assert len(found.replicates) == 40_000
    assert (np.diff(found.replicates) >= 0).all()
    # Of two draws each is the second with probability 1/2: variance of a draw 4 + 14/9 / 2, on average over seeds.
    of_draw = 4.0 + 0.5 * np.var(values[1]) / 3
    assert found.replicates.var() == pytest.approx(2 * of_draw / 2, rel=0.03)


def test_holm_is_that_of_a_table_worked_by_hand() -> None:
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert holm([0.6, 0.7]) == [1.0, 1.0]
    assert holm([]) == []


@pytest.mark.parametrize("count", [2, 3, 5])
def test_the_spread_of_few_values_is_that_of_their_mean(count: int) -> None:
    """With s values the plain bootstrap is short by sqrt((s - 1) / s); whether they are sequences or seeds of one."""
    values = np.random.default_rng(count).normal(2.0, 1.0, count)
    of_mean = values.std(ddof=1) / np.sqrt(count)
    for each in ([np.array([v]) for v in values], [values]):
        replicates = Bootstrap.of(each, rounds=5).replicates
        assert replicates.std() == pytest.approx(of_mean, rel=0.02)
        assert replicates.mean() == pytest.approx(values.mean(), abs=0.03 * of_mean)


def test_trackers_on_different_seeds_are_not_compared() -> None:
    with pytest.raises(UserError, match="same sequences and seeds"):
        compare_pairs({"a": [np.zeros(3)], "b": [np.zeros(2)]})


@given(st.lists(st.floats(0, 1), min_size=1, max_size=8))
def test_holm_never_lowers_and_keeps_the_order(p: list[float]) -> None:
    adjusted = holm(p)
    assert all(a >= b for a, b in zip(adjusted, p, strict=True))
    assert min(adjusted) == pytest.approx(min(1.0, len(p) * min(p)))
    order = np.argsort(p, kind="stable")
    assert (np.diff(np.array(adjusted)[order]) >= 0).all()


def test_the_critical_difference_is_that_of_the_books() -> None:
    """Demsar 2006, table 5 and section 3.2.2: q = 2.569 for k = 4; with N = 14, CD = 1.25."""
    rng = np.random.default_rng(3)
    found = ranks({name: rng.normal(size=14) for name in "abcd"})
    assert found.critical_difference == pytest.approx(2.569 * np.sqrt(4 * 5 / (6 * 14)), abs=2e-3)
    assert sum(found.mean_ranks.values()) == pytest.approx(10)


def test_a_failed_run_ranks_last() -> None:
    """Seven blocks of unlike values: of fewer than six no test could be significant, and p is not told."""
    a = 1.0 + np.arange(7) / 100
    values = {"a": a, "b": a + 1, "c": np.array([0.5, *[np.inf] * 6])}
    found = ranks(values)
    assert found.mean_ranks == pytest.approx({"a": (2 + 6 * 1) / 7, "b": (3 + 6 * 2) / 7, "c": (1 + 6 * 3) / 7})
    assert found.n == 7
    few = ranks({name: of[:3] for name, of in values.items()})
    assert few.mean_ranks == pytest.approx({"a": (2 + 1 + 1) / 3, "b": (3 + 2 + 2) / 3, "c": (1 + 3 + 3) / 3})
    assert np.isnan(few.p) and few.cliques == [("a", "b", "c")]
    assert found.p == pytest.approx(friedmanchisquare(*values.values()).pvalue)
    assert found.cliques == [("a", "b"), ("b", "c")]


def test_a_clique_is_of_neighbours_within_the_critical_difference() -> None:
    found = Ranks(mean_ranks={"d": 4.0, "a": 1.0, "c": 2.5, "b": 2.0}, critical_difference=1.5, p=0.01, n=10)
    assert found.cliques == [("a", "b", "c"), ("c", "d")]
    assert replace(found, critical_difference=0.4).cliques == []
    assert replace(found, critical_difference=3.0).cliques == [("a", "b", "c", "d")]


def test_a_breakdown_finds_where_it_fails() -> None:
    values = np.linspace(0, 1, 100)
    parts = breakdown(values, (values < 0.5).astype(float), np.where(values < 0.5, 0.01, np.inf))
    assert [p.success for p in parts] == [1, 1, 0, 0]
    assert [p.frames for p in parts] == [25, 25, 25, 25]
    assert parts[-1].median_m == np.inf
    assert breakdown(np.full(5, np.nan), np.ones(5), np.ones(5)) == []


def test_every_attribute_is_known_of_every_frame(sequence: Sequence) -> None:
    frames = list(range(len(sequence) - 1))
    for name, (_, function) in ATTRIBUTES.items():
        values = function(sequence, frames)
        assert values.shape == (len(frames),)
        assert np.isfinite(values).all() == (name not in UNTOLD), name
    assert ATTRIBUTES["distance"][1](sequence, [0])[0] == pytest.approx(1.25, abs=0.4)
    assert 3 < ATTRIBUTES["visible edges"][1](sequence, [0])[0] < 10


def test_breakdowns_of_runs_cover_their_frames(sequence: Sequence) -> None:
    results = track(sequence, "hold", RATE_HZ)
    run = ScoredRun(sequence, results, score(sequence, results), 0)
    found = breakdowns([run])
    assert set(found) == set(ATTRIBUTES) - UNTOLD
    assert sum(part.frames for part in found["contrast"][run.name]) == len(sequence)


def test_bootstrap_bounds_are_those_of_student_for_plain_normal_means() -> None:
    rng = np.random.default_rng(3)
    values = rng.normal(size=400)
    paired = Bootstrap.of([np.array([v]) for v in values], rounds=5)
    half = t.ppf(0.95, 399) * values.std(ddof=1) / 20
    assert paired.mean == pytest.approx(values.mean())
    assert paired.bound(0.95) - paired.mean == pytest.approx(half, rel=0.05)
    assert paired.mean - paired.bound(0.05) == pytest.approx(half, rel=0.05)


def test_bootstrap_takes_sequences_of_unlike_length() -> None:
    paired = Bootstrap.of([np.array([1.0] * 3), np.array([1.0] * 7)], rounds=5)
    assert (paired.mean, paired.bound(0.05), paired.bound(0.95)) == pytest.approx((1.0, 1.0, 1.0), abs=1e-12)
    assert paired.p_above(0.5) < 1e-4
    assert paired.p_above(1.0) == 1.0


def test_sign_flip_is_the_sign_test_for_like_steps() -> None:
    assert sign_flip_p(np.ones(10)) == pytest.approx(2**-10, rel=0.5)
    assert sign_flip_p(np.array([1.0, -1.0] * 5)) > 0.3
    assert sign_flip_p(np.zeros(4)) == 1.0


def test_what_is_drawn_by_default_is_that_of_seed_0_and_rounds_are_the_next_seeds() -> None:
    rng = np.random.default_rng(11)
    a, b = ([rng.normal(size=3) for _ in range(5)] for _ in range(2))
    of = {"a": a, "b": b}
    assert hierarchical_interval(a) == hierarchical_interval(a, seed=0) != hierarchical_interval(a, seed=1)
    assert compare("a", "b", of) == compare("a", "b", of, 0) != compare("a", "b", of, 1)
    assert compare_pairs(of) == compare_pairs(of, seed=0) != compare_pairs(of, seed=1)
    assert compare_with("a", of) == compare_with("a", of, seed=0) != compare_with("a", of, seed=1)
    assert compare_pairs(of, seed=1) == [compare("a", "b", of, 1)] == compare_with("a", of, seed=1)
    assert sign_flip_p(a[0]) == sign_flip_p(a[0], seed=0)
    both = np.concatenate([Bootstrap.of(a, seed=k).replicates for k in (4, 5)])
    np.testing.assert_allclose(Bootstrap.of(a, seed=4, rounds=2).replicates, np.sort(both))
    np.testing.assert_allclose(Bootstrap.of(a).replicates, Bootstrap.of(a, seed=0, rounds=1).replicates)


def test_draws_are_shared_and_changed_by_nobody() -> None:
    first, again = _weights((3, 1), 0), _weights((3, 1), 0)
    assert first is again and first.shape == (4000, 4) and not first.flags.writeable
    np.testing.assert_allclose(first.sum(axis=1), 1.0)


def test_the_smallest_p_is_one_of_all_flips() -> None:
    assert sign_flip_p(np.ones(60)) == 1 / 20_001
    assert sign_flip_p(-np.ones(60)) == 1.0
    paired = Bootstrap.of([np.array([v]) for v in (1.0, 2.0, 3.0)])
    assert paired.p_above(0.0) == 1 / 4001 and paired.p_above(4.0) == 1.0


@pytest.mark.parametrize("runs", [6, 8, 12])
def test_a_star_is_given_to_equal_trackers_in_one_of_twenty_tables_at_most(runs: int) -> None:
    """By the bootstrap alone, which is too narrow for so few runs, it was one of eight with six runs."""
    rng = np.random.default_rng(0)
    values = [{name: [rng.normal(3.0, 0.3, runs)] for name in "ab"} for _ in range(400)]
    assert sum(compare("a", "b", each).significant for each in values) <= 0.06 * len(values)
