"""The gate on values made up by hand: each rule of its verdict by itself."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import t

from tests.bench.drawn_scores import drawn, make_score, write
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
    undecided = replace(finding(0.01, reason="few"), verdict="inconclusive")
    assert repr(decide([undecided])) == repr([undecided])  # NaN among its numbers is not equal to itself


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


def crashing(*keys):
    known = dict(side().runs)
    return Side(known | {("lsd@15hz", *key): measured(crash=f"boom in {key[0]}") for key in keys})


def test_crashes_are_counted_and_the_first_is_named():
    two = crashing(("s2", 1), ("s1", 3))
    new = coverage_of(side(), two)
    assert new.reason == "2 runs crash that did not, first s1, seed 3: boom in s1"
    (both,) = [f for f in compare_sides(two, crashing(("s1", 3)), {}, Margins()) if f.metric == "crashes"]
    assert both.reason == "not judged: 1 run crashes on both sides, first s1, seed 3: boom in s1"
    assert (both.verdict, both.run, both.unit) == ("inconclusive", "lsd@15hz", "")
    one_more = compare_sides(crashing(("s1", 3)), two, {}, Margins())
    assert [f.reason for f in one_more if f.metric == "coverage"] == [
        "1 run crashes that did not, first s2, seed 1: boom in s2"
    ]
    assert overall(compare_sides(side(), crashing(("s1", 3)), {}, Margins())) == "fail"


def test_what_is_not_compared_is_told_of_trackers_that_the_baseline_lacks():
    why = {"other@15hz": "unknown to the base", "lsd@15hz": "for no reason"}
    found = compare_sides(side(), replace(side(), not_compared=why), {}, Margins())
    (told,) = [f for f in found if f.reason]
    assert (told.run, told.metric, told.verdict) == ("other@15hz", "all", "inconclusive")
    assert told.reason == "not judged: unknown to the base"


def test_every_metric_has_its_margin_and_a_typical_change_its_limit():
    broken = compare_sides(side(), side(error=10.0), {"lsd@15hz": values(1.0)}, Margins())
    margins = {f.metric: f.margin for f in broken}
    names = [name for metric in ERRORS for name in (metric, f"{metric}, typical")]
    assert margins == {"coverage": 0.01, **dict.fromkeys(names, 0.01), "latency": 0.05}
    change = {f.metric: f.change for f in broken}
    assert change["ATE"] == pytest.approx(1000 ** (1 / 20) - 1)
    assert change["ATE, typical"] == pytest.approx(1.1 ** (2 / 20) - 1)
    wide = Margins(error=0.5, latency=0.3, coverage=0.2)
    found = compare_sides(side(), side(error=10.0), {"lsd@15hz": values(1.0)}, wide)
    assert {f.metric: f.margin for f in found} == {"coverage": 0.2, **dict.fromkeys(names, 0.5), "latency": 0.3}
    (typical,) = [f for f in found if f.metric == "ATE, typical"]
    assert typical.change == pytest.approx(1.5 ** (2 / 20) - 1), "a margin that is wider than the resolution"


def test_a_change_of_a_tenth_need_not_be_excluded_and_more_must():
    """Without spread the upper bound is the change itself."""
    for ratio, verdict in ((1.099, "fail"), (1.009, "pass")):
        assert decided(values(ratio)).verdict == verdict
    reasons = [ratio_finding("lsd", "ATE", "m", values(r), 0.01, Margins().resolution).reason for r in (1.099, 1.101)]
    assert reasons == ["", "a change of +10.1% cannot be excluded"]


def test_bounds_are_one_sided_at_five_percent():
    """Of 60 runs of one sequence, against Student's: the bounds of a mean are those of a two-sided 90 % interval."""
    logs = np.random.default_rng(0).normal(0.1, 0.2, 60)
    keys = [("s", k) for k in range(60)]
    paired = PairedValues(dict.fromkeys(keys, 1.0), {key: math.exp(v) for key, v in zip(keys, logs, strict=True)})
    found = ratio_finding("lsd", "ATE", "m", paired, 0.1, 0.1)
    half = t.ppf(0.95, 59) * logs.std(ddof=1) / math.sqrt(60)
    assert (found.low, found.high) == pytest.approx(
        (math.expm1(logs.mean() - half), math.expm1(logs.mean() + half)), abs=0.1 * half
    )
    p = t.sf((logs.mean() - math.log(1.1)) / (logs.std(ddof=1) / math.sqrt(60)), 59)
    assert found.p == pytest.approx(p, rel=0.25)
    shares = share_finding("lsd", "coverage", PairedValues(paired.head, paired.base), 0.01)
    loss = np.exp(logs) - 1
    half = t.ppf(0.95, 59) * loss.std(ddof=1) / math.sqrt(60)
    assert (shares.low, shares.high) == pytest.approx((loss.mean() - half, loss.mean() + half), abs=0.1 * half)
    assert (shares.baseline, shares.value) == pytest.approx((np.exp(logs).mean(), 1.0))


def test_few_seeds_are_counted_by_the_sequence_with_the_fewest():
    keys = [("a", seed) for seed in range(5)] + [("b", 0)]
    found = decided(values(1.5, keys))
    assert (found.verdict, found.reason) == ("inconclusive", "1 seed is too few, 5 are needed")
    (lost,) = decide([share_finding("lsd", "coverage", values(0.5, keys[:4]), 0.01)])
    assert (lost.verdict, lost.reason) == ("inconclusive", "4 seeds are too few, 5 are needed")
    assert math.isnan(lost.p)


@pytest.mark.parametrize("how", ["compared", "association", "rpe_pairs", "success", "std_ddof", FLOWN])
def test_scores_that_were_made_in_another_way_are_refused(how):
    other = {key: replace(one, how={how: "otherwise"}) for key, one in side().runs.items()}
    with pytest.raises(UserError, match=rf"lsd@15hz on s., seed .: `{how}` of the scores differs"):
        compare_sides(side(), Side(other), {}, Margins())
    assert "fail" not in {f.verdict for f in compare_sides(Side(other), Side(other), {}, Margins())}


def test_a_score_is_measured_with_all_that_must_agree():
    score = make_score("s0", 0, 0.02, coverage=0.9)
    record = {"compared": "a", "association": "b", "rpe_pairs": "c", "success": "d", "std_ddof": 0, "more": 1}
    own = {"sequence": {"content_hash": "frames", "images": "images"}}
    found = Measured.of(replace(score, record=record | own))
    assert found == Measured(
        coverage=0.9,
        errors={"ATE": 0.02, "ATE rotation": 1.0, "RPE 1 s": 0.02},
        frames="frames",
        images="images",
        how={name: record[name] for name in ("compared", "association", "rpe_pairs", "success", "std_ddof")},
        seen=found.seen,
    )
    other = replace(score, seed=1, sequence="s0-s1", latency={}, record=record | own)
    assert found.seen == Measured.of(other).seen != Measured.of(replace(other, status="lost")).seen
    bare = Measured.of(replace(score, record={}))
    assert (bare.frames, bare.images, bare.crash, bare.seen) == ("", "", "", "")
    crashed = replace(score, status="crashed", errors=())
    assert Measured.of(crashed).crash == "no reason given"
    assert Measured.of(replace(crashed, errors=("first", "second"))).crash == "first"
    assert Measured.of(replace(score, errors=("first",))).crash == ""
    assert Measured.of(make_score("s0", 0, 0.0)).errors["ATE"] == 0.0
    assert math.isnan(Measured.of(make_score("s0", 0, -0.1)).errors["ATE"])


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


def flights(folder, scores, of="f"):
    """A suite's folder with flights of a tracker, by the name of their sequence."""
    for name, score in scores.items():
        run = folder / "flights" / name / "a@1hz+far"
        run.mkdir(parents=True)
        score.save(run / "score.json")
    about = {"sequences": list(scores), "trackers": ["a"], "rates_hz": [1.0], "loops": {"far": {}}, "flights": of}
    (folder / "suite.json").write_text(json.dumps(about))
    return folder


def test_flights_pass_against_the_same_flights_alone_and_a_crash_on_both_sides_is_no_success(tmp_path):
    done = measure_flight(flown(flown_path=path(planned_p_m=np.array([0.0, 0.03, 0.0]))))
    crashed = measure_flight(flown(status="crashed", why="into the face"))
    fates = [crashed if seed == 4 else done for seed in range(6)]
    scores = {f"cube-s{seed}": replace(fate, seed=seed, ended_s=1.0 + seed) for seed, fate in enumerate(fates)}
    base, head = (flights(tmp_path / side, scores) for side in ("base", "head"))
    found = {f.metric: f for f in gate(head, base)}
    errors = ["path error", "path error, typical", "estimate error", "estimate error, typical"]
    assert list(found) == ["success", *errors]
    assert (found["success"].verdict, found["success"].value) == ("pass", pytest.approx(5 / 6))
    assert {f.run for f in found.values()} == {"a@1hz+far"}
    with pytest.raises(UserError, match="are of different flights"):
        gate(flights(tmp_path / "other", scores, of="g"), base)
    without = replace(done, estimate_rms_m=None)
    true_state = {name: replace(without, ended_s=score.ended_s) for name, score in scores.items()}
    blind, again = (flights(tmp_path / f"true-{side}", true_state) for side in ("base", "head"))
    assert {f.metric: f.verdict for f in gate(again, blind)} == dict.fromkeys(["success", *errors[:2]], "pass")
    for pair, side in (((blind, base), "results"), ((base, blind), "baseline")):
        (lost,) = [f for f in gate(*pair) if f.metric == "estimate error"]
        assert (lost.verdict, lost.reason) == ("fail", f"no number in the {side} for cube, seed 0")


@pytest.mark.parametrize(
    "wrong",
    [{"sequences": ["a/b"]}, {"trackers": ["../a"]}, {"sequences": ["a\0b"]}, {"rates_hz": ["fast"]}, {"sequences": 3}],
)
def test_a_description_that_names_what_is_no_folder_is_refused(tmp_path, wrong):
    about = {"sequences": ["s"], "trackers": ["a"], "rates_hz": [1.0], **wrong}
    (tmp_path / "suite.json").write_text(json.dumps(about))
    with pytest.raises(UserError, match=r"suite\.json: not uavbench's: "):
        read_side(tmp_path)


def test_runs_of_a_suite_that_could_be_flown_are_replayed_ones_without_flights(tmp_path):
    head = write(tmp_path / "head", drawn(np.random.default_rng(0)))
    about = json.loads((head / "suite.json").read_text())
    (head / "suite.json").write_text(json.dumps({**about, "loops": {"": {}}, "not_compared": None}))
    found = read_side(head)
    assert len(found.runs) == 20 and not found.is_flown and not found.faults
    assert (found.flights, found.not_compared, found.share) == ("these", {}, "coverage")
    del about["flights"]
    (head / "suite.json").write_text(json.dumps(about))
    (head / "flights").mkdir()
    assert read_side(head).runs == found.runs and read_side(head).flights == ""


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


def lost_by(lost, trackers, seeds, sequences=1):
    """Findings on the coverage of trackers, of which the first loses a share of its frames in every run."""
    names = [f"t{k}@15hz" for k in range(trackers)]
    keys = [(name, f"s{i}", seed) for name in names for i in range(sequences) for seed in range(seeds)]
    base = {key: measured(coverage=1.0 - 0.01 * key[2]) for key in keys}
    head = {k: replace(one, coverage=one.coverage - lost) if k[0] == names[0] else one for k, one in base.items()}
    found = compare_sides(Side(base), Side(head), {}, Margins())
    return [f for f in found if f.metric == "coverage"]


@pytest.mark.parametrize("trackers", [1, 2, 3])
def test_coverage_that_is_lost_in_all_of_five_runs_fails(trackers):
    lost, *others = lost_by(0.7, trackers, 5)
    assert (lost.verdict, lost.reason) == ("fail", "worse than the margin")
    assert lost.p == pytest.approx(2 * trackers * 2 / 252), "of 252 choices of 5 of 10 runs, two ways, two halves"
    assert {f.verdict for f in others} <= {"pass"}


def test_a_loss_that_so_few_runs_cannot_tell_says_how_many_can():
    lost, *_ = lost_by(0.7, 4, 5)
    assert lost.verdict == "inconclusive"
    assert lost.reason == (
        "the loss is above the margin, but may be chance; "
        "even a loss in all runs could not be told: give each sequence 6 seeds, it has 5"
    )
    assert lost_by(0.7, 4, 6)[0].verdict == "fail"
    assert lost_by(0.7, 4, 5, sequences=2)[0].verdict == "fail"


def of_one_sequence(rng):
    """A side with two trackers on five seeds of one sequence; their errors vary by 10 %, and nothing else differs."""
    return Side({
        (f"t{k}@15hz", "s0", seed): replace(measured(), errors={m: np.exp(0.1 * rng.normal()) for m in ERRORS})
        for k in range(2)
        for seed in range(5)
    })  # fmt: skip


def test_five_seeds_of_one_sequence_give_a_false_alarm_in_one_of_twenty_at_most():
    """By a bootstrap, which is too narrow for five values, it would be one of ten."""
    rng = np.random.default_rng(0)
    found = [overall(compare_sides(of_one_sequence(rng), of_one_sequence(rng), {}, Margins())) for _ in range(300)]
    assert found.count("fail") <= 0.05 * len(found)
