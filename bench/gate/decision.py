"""The gate's decision: statistical test whether results are worse than a baseline on the same frames.

Errors and latency are compared as ratios: `fail` when the one-sided lower bound of the change, from a paired
hierarchical bootstrap (of one sequence Student's t) and corrected over all metrics, lies above the margin;
`inconclusive` when there are fewer than five seeds that differ, or when the upper bound lies above the required
resolution; else `pass`. Each error is compared twice: by its mean change, which shows a few broken runs, and by its
typical change, in which they have little weight and cannot hide a change of all others. Coverage is compared by its
absolute mean loss against its own margin, with exact permutation tests; so is the success rate of flights in closed
loop, in addition to their path and estimate errors. Missing or non-finite values fail; what cannot be compared, because
one side lacks it entirely, or a run crashes on both sides or is too short for the metric, is `inconclusive`: only what
was compared can pass.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from uavbench.bench.gate.baseline import read_baseline
from uavbench.bench.gate.paired_scores import (
    COVERAGE,
    SUCCESS,
    Key,
    Measured,
    PairedValues,
    Side,
    expect_comparable,
    known,
    read_side,
    read_timing,
)
from uavbench.bench.gate.repeated_seeds import repeats_of
from uavbench.reports.statistics.bootstrap import Bootstrap, holm
from uavbench.reports.statistics.losses import loss_p, smallest_loss_p
from uavbench.reports.statistics.student import StudentMean
from uavbench.trajectories.errors import UserError

Verdict = Literal["pass", "fail", "inconclusive"]
ALPHA = 0.05
MIN_SEEDS = 5
TINY = 1e-12
TYPICAL = 2.0
"""Clipping limit of each run's change in a typical change, in units of the change to be distinguished: a change of all
runs is preserved, and a single outlier cannot hide it.
"""
ROUNDS = 5
"""Bootstrap replicates; enough that the smallest p survives Holm's correction over many metrics."""


@dataclass(frozen=True, kw_only=True)
class Margins:
    """Tolerated changes, relative to the baseline (errors, latency) or as shares of all frames (coverage).

    resolution: a pass requires that a change of this size is outside the confidence interval.
    """

    error: float = 0.01
    latency: float = 0.05
    coverage: float = 0.01
    resolution: float = 0.10


@dataclass(frozen=True, kw_only=True)
class Finding:
    """One metric of one tracker.

    baseline and value are means over sequences of means over seeds: geometric, so that change is value / baseline - 1,
    or, for the coverage, arithmetic, so that change is baseline - value. change, low and high are shares: of the
    baseline, or of all frames, a loss being positive. p is corrected over all findings; NaN where nothing could be
    computed. reason: of the verdict, as text. repeats: the seeds that count once, since they repeat another one.
    """

    run: str
    metric: str
    unit: str
    verdict: Verdict
    baseline: float = math.nan
    value: float = math.nan
    change: float = math.nan
    low: float = math.nan
    high: float = math.nan
    margin: float = math.nan
    p: float = math.nan
    sequences: int = 0
    seeds: int = 0
    reason: str = ""
    repeats: str = ""


def gate(results: Path, baseline: Path, margins: Margins = Margins()) -> list[Finding]:
    """Findings on all trackers of the baseline, a folder or a file; UserError when the two cannot be compared."""
    head = read_side(results)
    if not baseline.exists():
        raise UserError(
            f"{baseline}: no such baseline; name the folder of another run, or make a file of this one with `uavbench "
            f"gate {results} --baseline {baseline} --update`"
        )
    base = read_baseline(baseline, head.flights) if baseline.is_file() else read_side(baseline)
    if not base.runs:
        raise UserError(f"{baseline}: no scores in it; `uavbench run` a suite there first")
    if base.is_flown and base.flights != head.flights:  # a flight's score does not identify its inputs
        raise UserError(
            f"{baseline} and {results} are of different flights: their suites differ in sequences, seeds, start, "
            "loops or the files that these name; fly the same suite in both"
        )
    return compare_sides(base, head, read_timing(results, baseline), margins)


def compare_sides(base: Side, head: Side, timing: Mapping[str, PairedValues], margins: Margins) -> list[Finding]:
    """Findings on all trackers of both sides, and on the latencies of interleaved runs."""
    for key in base.runs.keys() & head.runs.keys():
        expect_comparable(base.runs[key], head.runs[key], key)
    of_base, of_head = ({key[0] for key in (*side.runs, *side.faults)} for side in (base, head))
    findings = [finding for run in sorted(of_base) for finding in _of_run(run, base, head, margins)]
    findings += [_not_judged(run, "the baseline has no such tracker or rate") for run in sorted(of_head - of_base)]
    findings += [_not_judged(run, why) for run, why in sorted(head.not_compared.items()) if run not in of_base]
    findings += [
        _not_judged(run, f"the baseline has the metric `{metric}`, which this version lacks", metric)
        for run, metric in sorted({(key[0], name) for key, one in base.runs.items() for name in known(one.errors)})
        if metric not in _units(base, head)
    ]
    for run, times in sorted(timing.items()):
        repeats = repeats_of([key for key in head.runs if key[0] == run], base, head)
        counted = times.without(repeats)
        findings.append(ratio_finding(run, "latency", "ms", counted, margins.latency, margins.resolution))
    return decide(findings)


def _not_judged(run: str, why: str, metric: str = "all") -> Finding:
    """Inconclusive finding on something that could not be compared, which rules out a pass."""
    return Finding(run=run, metric=metric, unit="", verdict="inconclusive", reason=f"not judged: {why}")


def overall(findings: list[Finding]) -> Verdict:
    """Fail when anything fails, else inconclusive when anything is, else pass."""
    verdicts = {finding.verdict for finding in findings}
    return "fail" if "fail" in verdicts or not verdicts else "inconclusive" if "inconclusive" in verdicts else "pass"


def decide(findings: list[Finding]) -> list[Finding]:
    """Findings with p corrected over all of them, and the verdicts that follow.

    Shares have one half of ALPHA and ratios the other, each corrected by Holm over its own: the exact p of a share is
    limited by the number of runs, and must not have to outweigh all ratios as well.
    """
    tested = [[f for f in findings if math.isfinite(f.p) and is_share(f) == share] for share in (True, False)]
    halves = sum(map(bool, tested))
    corrected = {
        id(f): min(1.0, halves * p) for half in tested for f, p in zip(half, holm([f.p for f in half]), strict=True)
    }
    times = halves * len(tested[0])
    return [_decided(replace(f, p=corrected[id(f)]), times) if id(f) in corrected else f for f in findings]


def is_share(finding: Finding) -> bool:
    """Whether its metric is a share, compared as a difference."""
    return finding.metric in (COVERAGE, SUCCESS)


def _decided(finding: Finding, times: int) -> Finding:
    """The finding with its verdict; times: the factor by which the smallest p of a share was corrected."""
    if finding.verdict == "inconclusive":
        return finding
    worse = finding.change > finding.margin
    if finding.p <= ALPHA and worse:
        return replace(finding, verdict="fail", reason="worse than the margin")
    if is_share(finding):
        doubt = f"the loss is above the margin, but may be chance{_more_seeds(finding, times)}" if worse else ""
    else:
        doubt = finding.reason
    return replace(finding, verdict="inconclusive" if doubt else "pass", reason=doubt)


def _more_seeds(finding: Finding, times: int) -> str:
    """How many seeds it would take to tell a loss in all runs, where those at hand cannot."""
    seeds = finding.seeds
    while times * smallest_loss_p(finding.sequences, seeds) > ALPHA:
        seeds += 1
    few = f"; even a loss in all runs could not be told: give each sequence {seeds} seeds, it has {finding.seeds}"
    return few if seeds > finding.seeds else ""


def _of_run(run: str, base: Side, head: Side, margins: Margins) -> list[Finding]:
    """Findings on one tracker at one rate."""
    keys = [key for key in (*base.runs, *base.faults, *head.runs, *head.faults) if key[0] == run]
    crashed = sorted({k for k in keys if crash(head, k) and not crash(base, k)})
    repeats = repeats_of(keys, base, head)
    shares = paired(keys, base, head, lambda one: one.coverage).without(repeats)
    found = [share_finding(run, head.share, shares, margins.coverage)]
    if crashed:
        _, sequence, seed = crashed[0]
        why = f"{_runs_crash(crashed)} that did not, first {sequence}, seed {seed}: {crash(head, crashed[0])}"
        found = [replace(found[0], verdict="fail", p=math.nan, reason=why)]
    both = sorted({k for k in keys if crash(head, k) and crash(base, k)})
    if both and not head.is_flown:  # flights count crashes in their success rate
        _, sequence, seed = both[0]
        why = f"{_runs_crash(both)} on both sides, first {sequence}, seed {seed}: {crash(head, both[0])}"
        found.append(_not_judged(run, why, "crashes"))
    for metric, unit in _units(base, head).items():
        values = paired(keys, base, head, lambda one, metric=metric: one.errors.get(metric, math.nan))  # type: ignore[misc]
        values = values.without(repeats)
        at_most = TYPICAL * math.log1p(max(margins.error, margins.resolution))
        for name, limit in ((metric, math.inf), (f"{metric}, typical", at_most)):
            found.append(ratio_finding(run, name, unit, values, margins.error, margins.resolution, limit))
    return found


def _units(base: Side, head: Side) -> dict[str, str]:
    """Unit of each metric that is compared: of flights, those that either side has a number of."""
    return {**base.units, **head.units} if base.is_flown == head.is_flown else head.units


def _runs_crash(keys: list[Key]) -> str:
    return "1 run crashes" if len(keys) == 1 else f"{len(keys)} runs crash"


def paired(keys: list[Key], base: Side, head: Side, value: Callable[[Measured], float]) -> PairedValues:
    """One value of each run on both sides, NaN where there is no score."""
    of_base, of_head = (
        {(k[1], k[2]): value(side.runs[k]) if k in side.runs else math.nan for k in keys} for side in (base, head)
    )
    scored = {(k[1], k[2]) for k in keys if k in base.runs and k in head.runs}
    unknown = {key for key in scored if math.isnan(of_base[key]) and math.isnan(of_head[key])}
    return PairedValues(of_base, of_head, unknown)


def crash(side: Side, key: Key) -> str:
    """Why a run crashed, "" if it did not."""
    return side.runs[key].crash if key in side.runs else ""


def ratio_finding(
    run: str,
    metric: str,
    unit: str,
    values: PairedValues,
    margin: float,
    resolution: float,
    at_most: float = math.inf,
) -> Finding:
    """Finding on a metric for which smaller is better, compared as a ratio; p is not corrected yet.

    The log of each pair's ratio is clipped to +-at_most.
    """
    finding = _described(run, metric, unit, values, margin)
    if finding.verdict != "pass":
        return finding
    if math.isinf(at_most):
        base_log, head_log = (Bootstrap.of(side).mean for side in values.sides(lambda x: math.log(x + TINY)))
        finding = replace(finding, baseline=math.exp(base_log) - TINY, value=math.exp(head_log) - TINY)
    ratios = values.by_sequence(lambda b, h: math.log((h + TINY) / (b + TINY)))
    clipped = [np.clip(ratio, -at_most, at_most) for ratio in ratios]
    logs = Bootstrap.of(clipped, rounds=ROUNDS) if len(clipped) > 1 else StudentMean.of(clipped[0])
    finding = replace(
        finding,
        change=math.expm1(logs.mean),
        low=math.expm1(logs.bound(ALPHA)),
        high=math.expm1(logs.bound(1 - ALPHA)),
        p=logs.p_above(math.log1p(margin)),
    )
    if finding.seeds < MIN_SEEDS:
        return _too_few(finding)
    if finding.high > max(resolution, margin):
        return replace(finding, reason=f"a change of +{finding.high:.1%} cannot be excluded")
    return finding


def share_finding(run: str, metric: str, values: PairedValues, margin: float) -> Finding:
    """Finding on a share, the higher the better, compared as a difference; p is not corrected yet."""
    finding = _described(run, metric, "", values, margin)
    if finding.verdict != "pass":
        return finding
    base, head = (Bootstrap.of(side).mean for side in values.sides(lambda x: x))
    finding = replace(finding, baseline=base, value=head)
    loss = values.by_sequence(lambda b, h: b - h)
    losses = Bootstrap.of(loss, rounds=ROUNDS)
    finding = replace(
        finding,
        change=losses.mean,
        low=max(losses.bound(ALPHA), -1.0),
        high=min(losses.bound(1 - ALPHA), 1.0),
        p=loss_p(*values.sides(lambda x: x)),
    )
    return _too_few(finding) if finding.seeds < MIN_SEEDS else finding


def _described(run: str, metric: str, unit: str, values: PairedValues, margin: float) -> Finding:
    """The finding without its test; its verdict is `fail` if a number is missing."""
    missing = values.missing()
    undefined = next(
        (f"no number on either side for {name}, seed {seed}" for name, seed in sorted(values.undefined)), ""
    )
    return Finding(
        run=run,
        metric=metric,
        unit=unit,
        verdict="fail" if missing else "inconclusive" if undefined else "pass",
        margin=margin,
        sequences=len(values.sequences),
        seeds=values.seeds,
        reason=missing or undefined,
        repeats=values.repeats,
    )


def _too_few(finding: Finding) -> Finding:
    few = "1 seed is" if finding.seeds == 1 else f"{finding.seeds} seeds are"
    why = f"{few} too few, {MIN_SEEDS} are needed{'; repeats count once' if finding.repeats else ''}"
    return replace(finding, verdict="inconclusive", p=math.nan, reason=why)
