"""Measurements of a bisection: each commit's tracker on the same frames, scored by the running version."""

import json
import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from uavbench.bench.config.suite import Suite, load_suite
from uavbench.bench.config.suite_files import suite_file
from uavbench.bench.gate.compare import Run, describe, reading_from, score_all, track_on
from uavbench.bench.gate.compare_sides import at_work, file_of
from uavbench.bench.gate.paired_scores import COVERAGE, ERRORS, Side, read_side
from uavbench.bench.gate.versions import version
from uavbench.bench.history.bisect import Cannot, Found, Measurement, between, bisect, short
from uavbench.bench.inputs.file_paths import FREE
from uavbench.bench.runner.commands import ExecutionOptions, bring_up_to
from uavbench.bench.runner.output_folder import resolved
from uavbench.bench.said import say
from uavbench.reports.history.series import LEAST_ERROR
from uavbench.trajectories.errors import UserError, one_line, unknown_name
from uavbench.trajectories.files.origin import refuse_foreign_file
from uavbench.trajectories.files.reading import read_toml
from uavbench.trajectories.files.writing import write_text

BISECTION = "bisection"
SEVERAL = 3
"""Exit code when skipped commits leave several suspects."""


@dataclass(frozen=True)
class What:
    """Subject of a bisection: suite by name or file, metric, tracker as `lsd` or `lsd@15hz` ("" for the only one)."""

    suite: str
    metric: str
    tracker: str = ""


@dataclass(frozen=True)
class Measuring:
    """Measures commits of the git repository of the current folder.

    file: the suite's in the working tree; out: folder with the frames in `head` and the results of each commit; start:
    the suite's `start` table, which perturbs the initial pose.
    """

    suite: Suite
    file: Path
    out: Path
    label: str
    rate_hz: float
    metric: str
    start: dict[str, Any] | None

    def __call__(self, commit: str) -> Measurement | Cannot:
        """The metric at a commit, or why it has none: the tracker cannot run, or a run has no finite value."""
        folder = self.out / commit
        try:
            with version(commit) as each, at_work(each, self.file, [self.label]) as side:
                for label, why in side.unknown.items():
                    return Cannot(f"{label}: {one_line(why)}")
                for spec in self.suite.sequences:
                    answer = track_on(side, Run(self.label, self.rate_hz, spec), self.out / "head", folder, self.start)
                    if "error" in answer:
                        return Cannot(f"{spec.name}: {one_line(str(answer['error']).splitlines()[-1])}")
        except UserError as error:
            return Cannot(one_line(str(error)))
        alone = self.one_rate()
        describe(folder, alone, [self.label], {})
        score_all(self.out, commit, alone, [self.label])
        return self.of(read_side(folder))

    def one_rate(self) -> Suite:
        """The suite restricted to the measured rate."""
        return replace(self.suite, rates_hz=(self.rate_hz,))

    def of(self, side: Side) -> Measurement | Cannot:
        """The metric of a commit's scores: mean over sequences of the mean over seeds, of logs for an error.

        Of a run that crashed the errors are those of the frames before, and tell nothing; its coverage does.
        """
        runs = {
            key: run.coverage if self.metric == COVERAGE else run.errors[self.metric] for key, run in side.runs.items()
        }
        for (_, sequence, seed), why in side.faults.items():
            return Cannot(f"no score of {sequence}, seed {seed}: {one_line(why)}")
        for (_, sequence, seed), run in side.runs.items():
            if run.crash and self.metric != COVERAGE:
                return Cannot(f"it crashes on {sequence}, seed {seed}: {one_line(run.crash)}")
        for (_, sequence, seed), value in runs.items():
            if not math.isfinite(value):
                return Cannot(f"no number of {self.metric} for {sequence}, seed {seed}")
        by_sequence: dict[str, list[float]] = {}
        for (_, sequence, _), value in runs.items():
            worse = -value if self.metric == COVERAGE else math.log(max(value, LEAST_ERROR))
            by_sequence.setdefault(sequence, []).append(worse)
        mean = float(np.mean([np.mean(each) for each in by_sequence.values()]))
        if self.metric == COVERAGE:
            return Measurement(mean, f"{self.metric} {-mean:.4f}", share=True)
        share = float(np.mean([run.coverage for run in side.runs.values()]))
        text = f"{self.metric} {math.exp(mean):.5g} {ERRORS[self.metric][0]}, {COVERAGE} {100 * share:.1f} %"
        return Measurement(mean, text)


def run_bisect(refs: tuple[str, str], what: What, out: Path, margin: float, workers: int) -> int:
    """Find the first commit with a worse metric and write bisect.json into `out`; 0, or 3 when several suspects remain.

    The bisect.json of an earlier bisection is removed once what was asked for is known to be there.

    refs: good and bad commit; margin: as `bisect`. UserError for an unknown metric, tracker or commit, and when the bad
    commit is not worse.
    """
    out = resolved(out)
    refuse_foreign_file(out / "bisect.json", BISECTION)
    if what.metric not in (names := [*ERRORS, COVERAGE]):
        hint = "; times need interleaved runs: use `uavbench compare`" if what.metric == "latency" else ""
        raise UserError(f"{unknown_name('metric', what.metric, names)}{hint}")
    good, bad = between(*refs)
    with measuring(bad, what, out, workers) as measure:
        (out / "bisect.json").unlink(missing_ok=True)  # a bisection without a result would leave it as its own
        if isinstance(measure, int):
            return measure
        found = bisect(good, bad, margin, measure, lambda line: say(line, err=True))
    write_text(out / "bisect.json", json.dumps(to_json(found, what), indent=1) + "\n", kind=BISECTION)
    first, *others = found.suspects
    if not others:
        say(f"first worse commit: {short(first)}")
        return 0
    say(f"the first worse commit is one of these {1 + len(others)}; all but the first named cannot run:")
    for commit in found.suspects:
        say(f"  {short(commit)}")
    return SEVERAL


@contextmanager
def measuring(bad: str, what: What, out: Path, workers: int) -> Iterator[Measuring | int]:
    """Render the frames of the suite at `bad`; the measuring of commits on them, or an exit code when rendering fails.

    UserError when the suite or its tracker is wrong.
    """
    given = suite_file(what.suite)
    file = given.parent.resolve() / given.name
    with version(bad) as last:
        flown = file_of(last, file)
        with reading_from(last.environment([])[FREE] if flown != file else None):
            suite = load_suite(flown)
            label, rate_hz = chosen(suite, what.tracker)
            code = bring_up_to("render", str(flown), out / "head", ExecutionOptions(workers=workers))
        start = read_toml(flown).get("start")
    yield code or Measuring(suite, file, out, label, rate_hz, what.metric, start)


class TrackerAtRate(NamedTuple):
    """A tracker of a suite at one of its rates."""

    label: str
    rate_hz: float


def chosen(suite: Suite, tracker: str) -> TrackerAtRate:
    """The named tracker of the suite at its rate; UserError when none matches, or several do."""
    runs = {f"{label}@{rate:g}hz": TrackerAtRate(label, rate) for label in suite.trackers for rate in suite.rates_hz}
    fitting = [run for run, each in runs.items() if tracker in ("", each.label, run)]
    if not fitting:
        raise unknown_name("tracker", tracker, [*runs])
    if len(fitting) > 1:
        raise UserError(f"the suite has several runs: select one with --tracker: {', '.join(fitting)}")
    return runs[fitting[0]]


def to_json(found: Found, what: What) -> dict[str, Any]:
    """Content of bisect.json."""
    return {
        "metric": what.metric,
        "first_worse": found.suspects[0] if len(found.suspects) == 1 else None,
        "suspects": found.suspects,
        "tried": dict(found.verdicts),
    }
