"""The gate on values made up by hand: each rule of its verdict by itself."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from tests.bench.drawn_scores import drawn, write
from tests.reports.test_flight_score import flown, path
from uavbench.bench.gate.decision import (
    Finding,
    Margins,
    compare_sides,
    decide,
    gate,
    overall,
    ratio_finding,
    share_finding,
)
from uavbench.bench.gate.paired_scores import ERRORS, FLOWN, Measured, PairedValues, Side, read_side
from uavbench.reports.closed_loop.measures import measure_flight
from uavbench.reports.statistics.bootstrap import holm, sign_flip_p
from uavbench.trajectories.errors import UserError

KEYS = [(f"s{i}", seed) for i in range(4) for seed in range(5)]


def finding(p, *, change=0.2, margin=0.01, **more):
    return Finding(run="lsd", metric="ATE", unit="m", verdict="pass", change=change, margin=margin, p=p, **more)


def values(ratio, keys=KEYS, spread=0.0):
    """Errors that change by a ratio; half of the pairs by a share more, the others by as much less."""
    base = {key: 0.01 * (1 + k) for k, key in enumerate(keys)}
    head = {key: base[key] * ratio * math.exp(spread * (1 if k % 2 else -1)) for k, key in enumerate(keys)}
    return PairedValues(base, head)


def decided(paired, margin=0.01, resolution=0.10):
    (found,) = decide([ratio_finding("lsd", "ATE", "m", paired, margin, resolution)])
    return found


def measured(error=0.01, coverage=1.0, crash=""):
    return Measured(coverage=coverage, errors=dict.fromkeys(ERRORS, error), crash=crash)


def side(**changed):
    runs = {("lsd@15hz", *key): measured() for key in KEYS}
    return Side(runs | {("lsd@15hz", "s0", 0): measured(**changed)})


def coverage_of(base, head):
    return next(f for f in compare_sides(base, head, {}, Margins()) if f.metric == "coverage")


def test_p_is_corrected_over_all_findings():
    raw = [0.02, 0.5, 0.04, 0.9]
    found = decide([finding(p) for p in raw])
    assert [f.p for f in found] == holm(raw)
    assert [f.verdict for f in found] == ["pass"] * 4
    assert decide([finding(0.02)])[0].verdict == "fail"
    assert [f.verdict for f in decide([finding(0.01), finding(math.nan), finding(0.5)])] == ["fail", "pass", "pass"]


def test_a_finding_fails_when_it_is_worse_than_the_margin_and_not_by_chance():
    assert decide([finding(0.05)])[0].verdict == "fail"
    assert decide([finding(0.051)])[0].verdict == "pass"
    assert decide([finding(0.05, change=0.01)])[0].verdict == "pass"
    assert decide([finding(0.05, change=0.015, margin=Margins().error)])[0].verdict == "fail"
    assert decide([finding(0.5, reason="doubt")])[0].verdict == "inconclusive"
    assert decide([finding(0.01, reason="doubt")])[0].reason == "worse than the margin"


def test_what_is_tolerated_need_not_be_excluded():
    """Bounds of +8 % to +17 %: above the resolution, and within a margin that is wider than it."""
    paired = values(1.12, spread=0.1)
    wide = decided(paired, margin=0.2, resolution=0.1)
    assert 0.1 < wide.high < 0.2
    assert wide.verdict == "pass"
    narrow = decided(paired, margin=0.11, resolution=0.1)
    assert narrow.verdict == "inconclusive"
    assert f"+{narrow.high:.1%}" in narrow.reason


def test_the_change_is_the_mean_ratio_and_its_bounds_lie_on_both_sides():
    found = decided(values(1.3, spread=0.2))
    assert found.change == pytest.approx(0.3)
    assert found.low < 0.3 < found.high
    assert (1 + found.low) * (1 + found.high) == pytest.approx(1.3**2, rel=0.01)
    geometric = 0.01 * math.factorial(20) ** (1 / 20)  # of 0.01, 0.02 ... 0.2; by it the change is value over baseline
    assert (found.baseline, found.value) == pytest.approx((geometric, 1.3 * geometric), rel=1e-6)
    assert (found.sequences, found.seeds, found.margin, found.unit) == (4, 5, 0.01, "m")


def test_a_typical_change_counts_no_run_for_more_than_its_limit():
    paired = values(1.0)
    paired.head["s0", 0] *= 1000.0
    found = ratio_finding("lsd", "ATE, typical", "m", paired, 0.01, 0.1, 0.2)
    assert found.change == pytest.approx(math.expm1(0.2 / 20))
    paired.head["s0", 0] /= 1e6
    assert ratio_finding("lsd", "ATE, typical", "m", paired, 0.01, 0.1, 0.2).change == pytest.approx(
        math.expm1(-0.2 / 20)
    )


def test_errors_of_zero_on_both_sides_are_no_change():
    paired = PairedValues(dict.fromkeys(KEYS, 0.0), dict.fromkeys(KEYS, 0.0))
    assert decided(paired).change == pytest.approx(0.0, abs=1e-9)
    assert decided(paired).verdict == "pass"
    assert (decided(paired).baseline, decided(paired).value) == pytest.approx((0.0, 0.0), abs=1e-15)


@pytest.mark.parametrize(("seeds", "verdict"), [(4, "inconclusive"), (5, "fail")])
def test_five_seeds_are_enough(seeds, verdict):
    found = decided(values(1.3, [(f"s{i}", seed) for i in range(4) for seed in range(seeds)]))
    assert found.verdict == verdict
    assert math.isnan(found.p) == (verdict == "inconclusive")


def test_a_crash_that_the_baseline_has_too_is_not_new():
    assert coverage_of(side(crash="boom"), side(crash="boom")).verdict == "pass"
    assert coverage_of(side(crash="boom"), side()).verdict == "pass"
    new = coverage_of(side(), side(crash="boom"))
    assert new.verdict == "fail"
    assert new.reason == "1 run crashes that did not, first s0, seed 0: boom"
    assert math.isnan(new.p)


def test_coverage_is_compared_as_a_difference_by_the_signs_of_the_pairs():
    base = dict.fromkeys(KEYS, 0.9)
    head = {key: 0.9 - (0.04 if k % 4 else -0.02) for k, key in enumerate(KEYS)}
    found = share_finding("lsd", "coverage", PairedValues(base, head), 0.01)
    assert found.change == pytest.approx(0.025)
    assert found.low < 0.025 < found.high
    assert found.p == sign_flip_p(np.array([base[key] - head[key] for key in sorted(KEYS)]))
    assert decide([found])[0].verdict == "fail"
    doubtful = PairedValues(base, base | {KEYS[0]: 0.5})
    (lost,) = decide([share_finding("lsd", "coverage", doubtful, 0.01)])
    assert (lost.verdict, lost.reason) == ("inconclusive", "the loss is above the margin, but may be chance")
    (little,) = decide([share_finding("lsd", "coverage", PairedValues(base, base | {KEYS[0]: 0.8}), 0.01)])
    assert (little.verdict, little.reason) == ("pass", "")


def test_what_is_missing_fails_and_says_on_which_side():
    paired = values(1.0)
    del paired.head["s1", 2]
    assert decided(paired).verdict == "fail"
    assert decided(paired).reason == "no number in the results for s1, seed 2"
    paired = values(1.0)
    paired.base["s3", 4] = math.inf
    assert (decided(paired).verdict, decided(paired).reason) == ("fail", "no number in the baseline for s3, seed 4")


def test_a_number_that_neither_side_has_is_not_judged():
    """RPE over 1 s of a flight of 0.3 s: nothing was lost between the two."""

    def rpe(base, head):
        return next(f for f in compare_sides(base, head, {}, Margins()) if f.metric == "RPE 1 s")

    short = side(error=math.nan)
    found = rpe(short, short)
    assert (found.verdict, found.reason) == ("inconclusive", "no number on either side for s0, seed 0")
    assert rpe(side(), short).verdict == rpe(short, side()).verdict == "fail"
    unscored = Side({key: one for key, one in short.runs.items() if key[1:] != ("s0", 0)})
    assert rpe(short, unscored).verdict == rpe(unscored, short).verdict == "fail"


def test_a_baseline_without_any_score_is_refused(tmp_path):
    head = write(tmp_path / "head", drawn(np.random.default_rng(0)))
    with pytest.raises(UserError, match="no scores in it"):
        gate(head, write(tmp_path / "base", []))


def test_a_tracker_that_the_baseline_lacks_is_told_and_judged_on_nothing():
    new = {("other@15hz", *key): measured() for key in KEYS}
    both = Side(dict(side().runs) | new)
    found = [f for f in compare_sides(side(), both, {}, Margins()) if f.run == "other@15hz"]
    assert [f.verdict for f in found] == ["inconclusive"]
    assert (found[0].sequences, found[0].seeds) == (0, 0)
    assert "baseline has no such" in found[0].reason


def test_a_metric_that_this_version_does_not_know_is_told_with_its_run():
    known = dict(side().runs)
    base = Side({key: replace(each, errors={**each.errors, "jerk": 1.0}) for key, each in known.items()})
    (told,) = [f for f in compare_sides(base, side(), {}, Margins()) if f.metric == "jerk"]
    assert (told.run, told.verdict) == ("lsd@15hz", "inconclusive")


def test_flights_are_compared_by_success_path_and_estimate(tmp_path):
    """One completed flight 3 cm beside its path, and one that crashed on its true state, with no estimate."""
    ended = {
        "cube-s3": measure_flight(flown(flown_path=path(planned_p_m=np.array([0.0, 0.03, 0.0])))),
        "cube-s4": measure_flight(
            flown(status="crashed", why="into the face", flown_path=path(estimated_p_m=math.nan))
        ),
    }
    for name, score in ended.items():
        folder = tmp_path / "flights" / name / "a@1hz"
        folder.mkdir(parents=True)
        score.save(folder / "score.json")
    about = {"sequences": list(ended), "trackers": ["a"], "rates_hz": [1.0], "loops": {"": {}}, "flights": "f"}
    (tmp_path / "suite.json").write_text(json.dumps(about))
    found = read_side(tmp_path)
    assert found.is_flown and not found.faults
    done, crashed = (found.runs["a@1hz", "cube", seed] for seed in (3, 4))
    assert done.errors == {"path error": pytest.approx(0.03), "estimate error": pytest.approx(0.0, abs=1e-12)}
    assert (done.coverage, done.crash, done.how) == (1.0, "", {FLOWN: True})
    assert (crashed.coverage, crashed.crash, crashed.how) == (0.0, "into the face", {FLOWN: True})
    assert not math.isfinite(crashed.errors["estimate error"])


def test_fail_goes_before_inconclusive_and_nothing_at_all_fails():
    one = {
        verdict: Finding(run="r", metric="m", unit="", verdict=verdict) for verdict in ("pass", "inconclusive", "fail")
    }
    assert overall(list(one.values())) == "fail"
    assert overall([one["pass"], one["inconclusive"]]) == "inconclusive"
    assert overall([one["pass"]]) == "pass"
    assert overall([]) == "fail"


def test_every_tracker_of_the_baseline_is_compared_in_every_metric():
    base, head = side(), side()
    faulty = Side(head.runs, {("lsd@15hz", "s0", 9): "score.json: damaged"})
    names = [name for metric in ERRORS for name in (metric, f"{metric}, typical")]
    assert [f.metric for f in compare_sides(base, head, {}, Margins())] == ["coverage", *names]
    assert {f.verdict for f in compare_sides(base, faulty, {}, Margins())} == {"fail"}
    assert {f.verdict for f in compare_sides(base, Side({}), {}, Margins())} == {"fail"}
    timed = compare_sides(base, head, {"lsd@15hz": values(1.2)}, Margins())
    assert (timed[-1].metric, timed[-1].unit, timed[-1].margin, timed[-1].verdict) == ("latency", "ms", 0.05, "fail")
