"""Comparison of two versions of a repository on the same frames: `uavbench compare BASE_REF HEAD_REF`.

Everything that belongs to a version comes from its own tree: uavbench itself if the repository contains it, the suite's
tables of trackers, their programs, files and plug-ins. The frames are those of the head's suite, rendered once by the
running uavbench. The trackers of both versions run on them repeatedly, interleaved in ABBA order, so that other load on
the machine affects both equally; the smallest time of each frame is used. The running version computes the scores, and
the gate decides.
"""

import json
import os
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from uavbench.bench.config.suite import Suite, load_suite
from uavbench.bench.config.suite_files import suite_file
from uavbench.bench.gate.compare_sides import Side, at_work, file_of, keys_of, statements
from uavbench.bench.gate.decision import Margins
from uavbench.bench.gate.findings import pronounce
from uavbench.bench.gate.versions import version
from uavbench.bench.inputs.content_hash import content_hash
from uavbench.bench.inputs.file_paths import FREE
from uavbench.bench.inputs.touched_files import touched_since
from uavbench.bench.runner.commands import ExecutionOptions, bring_up_to
from uavbench.bench.runner.output_folder import GATE, RESULTS, SUITE, refuse_foreign_folder, remove_verdict, resolved
from uavbench.bench.said import say
from uavbench.reports.run_folder import SCORES
from uavbench.reports.scoring.score import score
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.scenes.spec import SequenceSpec
from uavbench.tracker.images.recorded_sequence import RecordingSpec
from uavbench.tracker.results import MARKER, Results
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.listed import mark
from uavbench.trajectories.files.origin import refuse_foreign, refuse_foreign_file
from uavbench.trajectories.files.reading import read_toml
from uavbench.trajectories.files.seals import sealed_kind
from uavbench.trajectories.files.writing import write_text

SIDES = ("base", "head")
TIMING = "times of a comparison"
LEAST_MS = 0.05
"""Times below this in ms count as equal: their ratio is noise."""


def compare(refs: tuple[str, str], suite_name: str, out: Path, repeats: int, margins: Margins, workers: int) -> int:
    """Compare two versions; the exit code of the gate, 1 when the frames cannot be rendered.

    UserError also when a file of the working tree's trackers was written meanwhile.
    """
    out = resolved(out)
    for path, kind in ((out / "base" / SUITE, RESULTS), (out / "head" / "timing.json", TIMING)):
        refuse_foreign_file(path, kind)
    refuse_foreign_folder(out / "head")
    remove_verdict(out / GATE)
    given = suite_file(suite_name)
    file = given.parent.resolve() / given.name
    with ExitStack() as stack:
        versions = dict(zip(SIDES, (stack.enter_context(version(ref)) for ref in refs), strict=True))
        remove_scores(out)
        flown = file_of(versions["head"], file)
        with reading_from(versions["head"].environment([])[FREE] if flown != file else None):
            suite = load_suite(flown)
            code = bring_up_to("render", str(flown), out / "head", ExecutionOptions(workers=workers))
        if code:
            return code
        labels = [*suite.trackers]
        keys = partial(keys_of, versions, file)
        before = keys()
        sides = {name: stack.enter_context(at_work(each, file, labels)) for name, each in versions.items()}
        commits = ", ".join(f"{name} {side.version.commit}" for name, side in sides.items())
        say(f"{commits}, {repeats} repeats", err=True)
        for line in statements(sides, file):
            say(line, err=True)
        times, unknown = run_in_turn(sides, suite, flown, out, repeats)
        if (touched := touched_since(before, keys, before)).jobs:
            raise UserError(f"changed while it was compared: {touched}; compare again, as results are of both contents")
    for label, why in unknown.items():
        say(f"not compared, unknown to the base: {label} ({why})", err=True)
    known = [label for label in suite.trackers if label not in unknown]
    if not known:
        raise UserError("the base knows none of the suite's trackers")
    runs = {f"{label}@{rate:g}hz": why for label, why in unknown.items() for rate in suite.rates_hz}
    for side in SIDES:
        describe(out / side, suite, known, {run: f"unknown to the base: {why}" for run, why in runs.items()})
        score_all(out, side, suite, known)
    timing = {"runs": smallest(times, known)}
    write_text(out / "head" / "timing.json", json.dumps(timing, indent=1) + "\n", kind=TIMING)
    return pronounce(out / "head", out / "base", margins, out / GATE)


@contextmanager
def reading_from(folders: str | None) -> Iterator[None]:
    """Context in which suites may also read from these folders."""
    before = os.environ.get(FREE)
    if folders is not None:
        os.environ[FREE] = folders
    try:
        yield
    finally:
        os.environ.pop(FREE, None)
        if before is not None:
            os.environ[FREE] = before


Times = dict[tuple[str, str, str, int, str], list[list[float]]]
"""(label, run, sequence, seed, side) -> per repeat the time of each frame in ms."""


class TimedRuns(NamedTuple):
    """Times of all runs, and, by label, why the base could not run a tracker."""

    times: Times
    unknown: dict[str, str]


def run_in_turn(sides: dict[str, Side], suite: Suite, flown: Path, out: Path, repeats: int) -> TimedRuns:
    """Run all trackers of both sides in turn; their results are in the folders of both sides.

    flown: the file of the suite whose sequences and `start` these are.
    """
    start = read_toml(flown).get("start")
    for label, why in sides["head"].unknown.items():
        raise UserError(f"head, {label}: {why}")
    times: Times = {}
    unknown: dict[str, str] = dict(sides["base"].unknown)
    for repeat in range(repeats):
        for number, spec in enumerate(suite.sequences):
            for label, rate_hz in [(label, rate) for label in suite.trackers for rate in suite.rates_hz]:
                run = f"{label}@{rate_hz:g}hz"
                for side in SIDES if (repeat + number) % 2 == 0 else SIDES[::-1]:
                    if label in unknown:
                        continue
                    answer = track_on(sides[side], Run(label, rate_hz, spec), out / "head", out / side, start)
                    if "error" in answer and side == "base":
                        unknown[label] = str(answer["error"]).splitlines()[-1].strip()
                    elif "error" in answer:
                        raise UserError(f"head, {run} on {spec.name}: {answer['error']}")
                    else:
                        key = (label, run, spec.name, spec.seed, side)
                        times.setdefault(key, []).append([np.nan if t is None else t for t in answer["total_ms"]])
    return TimedRuns(times, unknown)


@dataclass(frozen=True)
class Run:
    """A tracker at a rate on a sequence."""

    label: str
    rate_hz: float
    spec: SequenceSpec | RecordingSpec

    @property
    def name(self) -> str:
        """`lsd@15hz`."""
        return f"{self.label}@{self.rate_hz:g}hz"


def track_on(side: Side, run: Run, frames: Path, out: Path, start: dict[str, Any] | None) -> dict[str, Any]:
    """Run a version's tracker on rendered frames, its results in the folder `out`; the answer, maybe an `error`."""
    spec, results = run.spec, out / "results" / run.spec.name / run.name
    refuse_foreign(results, MARKER)
    ask = {
        "rate_hz": run.rate_hz,
        "seed": spec.seed,
        "sequence": str(frames / "sequences" / spec.name),
        "out": str(results),
        "content_hash": content_hash(side.version.commit, run.label, run.rate_hz, spec.seed, spec.name),
        **({"start": start} if start else {}),
    }
    answer = side.track(run.label, ask)
    if "error" not in answer:
        mark(results, MARKER)  # an older version does not write it
    return answer


def smallest(times: Times, labels: list[str]) -> dict[str, list[dict[str, Any]]]:
    """By run, for each sequence: the median of the frames' smallest times on both sides, of the frames timed on both.

    A frame that a program lost has no time. Trackers without measured times are left out.
    """
    runs: dict[str, list[dict[str, Any]]] = {}
    for label, run, name, seed, side in times:
        if side != "head" or label not in labels:
            continue
        fastest = np.array([np.fmin.reduce(times[label, run, name, seed, s]) for s in SIDES])
        timed = fastest[:, np.isfinite(fastest).all(axis=0)]
        if timed.size:
            base_ms, head_ms = np.maximum(np.median(timed, axis=1), LEAST_MS).tolist()
            sequence = name.removesuffix(f"-s{seed}")
            row = {"sequence": sequence, "seed": seed, "base_ms": base_ms, "head_ms": head_ms}
            runs.setdefault(run, []).append(row)
    return runs


def describe(folder: Path, suite: Suite, labels: list[str], not_compared: dict[str, str]) -> None:
    """Write `suite.json`: what was compared, and why other runs were not."""
    about = {
        "suite": suite.name,
        "title": suite.title,
        "sequences": [spec.name for spec in suite.sequences],
        "trackers": labels,
        "rates_hz": list(suite.rates_hz),
        "not_compared": not_compared,
    }
    write_text(folder / SUITE, json.dumps(about, indent=1) + "\n", kind=RESULTS)


def remove_scores(out: Path) -> None:
    """Remove the scores and times of an earlier comparison, which one that ends early would leave as if its own.

    So are verdicts on them. Files that were edited since stay.
    """
    for side in SIDES:
        remove_verdict(out / side / GATE)
        for path in (out / side).glob(SCORES):
            if sealed_kind(path) == MARKER.kind:
                path.unlink()
    if sealed_kind(out / "head" / "timing.json") == TIMING:
        (out / "head" / "timing.json").unlink()


def score_all(out: Path, side: str, suite: Suite, labels: list[str]) -> None:
    """Score the results of one side, with this version."""
    for spec in suite.sequences:
        sequence = Sequence.load(out / "head" / "sequences" / spec.name)
        for run in [f"{label}@{rate:g}hz" for label in labels for rate in suite.rates_hz]:
            results = out / side / "results" / spec.name / run
            score(sequence, Results.load(results)).save(results / "score.json")
