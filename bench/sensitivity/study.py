"""The study: runs of every variant of a tracker over a suite, and the table of changes.

DIR/sequences, DIR/results      as for every suite, so that an interrupted study is resumed
DIR/sensitivity.md, .csv        the table of the latest study, listed in sensitivity.json; none while runs are missing
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from uavbench.bench.config.suite import Suite, load_suite
from uavbench.bench.config.suite_files import suite_file
from uavbench.bench.runner.commands import disown_stale_scores, disowned_if_ended, refuse_touched, tell
from uavbench.bench.runner.executors import local_pool
from uavbench.bench.runner.graph import NOT_DONE, Job, Outcome, run_graph
from uavbench.bench.runner.jobs import plan
from uavbench.bench.runner.output_folder import resolved, suite_folder
from uavbench.bench.runner.tasks import Score as ScoreTask
from uavbench.bench.said import say
from uavbench.bench.sensitivity.variants import Number, Value, changed, values_of
from uavbench.reports.scoring.score import Score
from uavbench.reports.style import write_csv
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.listed import Listed, Marker
from uavbench.trajectories.files.origin import owning, refuse_foreign_file
from uavbench.trajectories.files.writing import in_parts, new_parts, write_text

TABLE = Marker("sensitivity.json", "table of a sensitivity study")
CSV, MARKDOWN = "sensitivity.csv", "sensitivity.md"
FACTORS = (0.5, 2.0)
DEFAULT = "default"
COLUMNS = ("value", "default", "factor", "set_to", "runs", "runs_changed", "success_change", "median_error_ratio")
HEADS = ("value", "default", "set to", "runs changed", "success (points)", "median error (%)")


@dataclass(frozen=True)
class Variant:
    """A value of a tracker's config, and its changed setting."""

    value: Value
    factor: float
    set_to: Number

    @property
    def label(self) -> str:
        """Name of its runs; `+` marks a capital, since `K` and `k` are two values."""
        path = re.sub("[A-Z]", lambda capital: f"+{capital[0].lower()}", self.value.path)
        return f"{path}-x{self.factor:g}".replace("_", "-")


@dataclass(frozen=True)
class Change:
    """Change by a variant, paired by run against the default.

    runs: number compared, including failed ones; runs_changed: number with different poses; success: mean change of the
    share of frames within 5 cm and 5 deg; error_ratio: geometric mean of the ratios of median position errors, NaN when
    no run has both.
    """

    variant: Variant
    runs: int
    runs_changed: int
    success: float
    error_ratio: float


def study(suite_name: str, out: Path, label: str, paths: Sequence[str], workers: int) -> int:
    """Run the missing runs of a study of the tracker `label`, and write its table; the exit code.

    paths: values to study, or tables of them, by dotted path; all without any. UserError for an unknown path, and when
    an input was written while runs used it.
    """
    suite = load_suite(suite_file(suite_name))
    variants = variants_of(suite, label, paths)
    trackers = {DEFAULT: suite.trackers[label]}
    trackers |= {v.label: changed(suite.trackers[label], v.value.path, v.set_to) for v in variants}
    suite = replace(suite, name=f"{suite.name}-sensitivity", trackers=trackers, protocols=())
    folder = resolved(out)
    planned = partial(plan, suite, folder, last="score")
    jobs = planned()
    with (
        suite_folder(folder, suite, kind="sensitivity study"),
        disowned_if_ended(jobs, planned),
        local_pool(workers) as pool,
    ):
        remove_table(folder)
        disown_stale_scores(suite, folder, suite)
        outcome = run_graph(jobs, *pool)
        tell(outcome, folder, suite_name)
        refuse_touched(jobs, planned, outcome.done)
        if unknown := of_no_variant(jobs, outcome):
            told = "which says nothing of a value; once that is mended, the same command goes on from here"
            say(f"no table: {unknown[0]} failed, {told}", err=True)
            return 2 if outcome.users_mistake else 1
        done = {job.work.results for job in jobs if isinstance(job.work, ScoreTask) and job.name not in outcome.failed}
        changes = [change(suite, variant, folder, done) for variant in variants]
        say(f"{len(changes)} variants: {write(folder, changes)}")
    return 2 if outcome.users_mistake else 1 if outcome.failed else 0


def of_no_variant(jobs: Sequence[Job], outcome: Outcome) -> list[str]:
    """Names of the jobs that failed for another reason than the changed value of a variant.

    That is what renders, what the default runs in, and what a full disk or the end of a worker has stopped. A variant
    alone has a mistake when its tracker refuses to start with the value: the rest of the input is that of the default.
    """
    failed = [job for job in jobs if not outcome.failed.get(job.name, NOT_DONE).startswith(NOT_DONE)]
    runs = [job for job in failed if job.verb != "render" and f" {DEFAULT}@" not in job.name]
    by_value = {job.name for job in runs if job.name in outcome.tracebacks or job.name in outcome.mistakes}
    return [job.name for job in failed if job.name not in by_value]


def variants_of(suite: Suite, label: str, paths: Sequence[str]) -> list[Variant]:
    """Variants with each value halved and doubled, within its bounds."""
    if label not in suite.trackers:
        raise UserError(f"the suite {suite.name} has no tracker {label!r}; it has: {', '.join(suite.trackers)}")
    values = list(values_of(suite.trackers[label]))
    for path in paths:
        if not any(_below(value, path) for value in values):
            known = ", ".join(value.path for value in values) or "none"
            raise UserError(f"the tracker {label} has no value {path!r}; its values: {known}")
    chosen = [value for value in values if not paths or any(_below(value, path) for path in paths)]
    if not chosen:
        raise UserError(f"the tracker {label} has no numbers to vary; name another with --tracker")
    scaled = [(value, factor, value.scaled(factor)) for value in chosen for factor in FACTORS]
    return [Variant(value, factor, set_to) for value, factor, set_to in scaled if set_to is not None]


def _below(value: Value, path: str) -> bool:
    return value.path == path or value.path.startswith(f"{path}.")


def change(suite: Suite, variant: Variant, folder: Path, done: set[Path]) -> Change:
    """Change by a variant over all runs with a scored default; a failed run of the variant counts as entirely lost."""
    success, ratios, differ, runs = [], [], 0, 0
    for spec in suite.sequences:
        for rate in suite.rates_hz:
            there, here = (folder / "results" / spec.name / f"{name}@{rate:g}hz" for name in (DEFAULT, variant.label))
            if there not in done:
                continue
            runs += 1
            before = Score.load(there / "score.json")
            after = Score.load(here / "score.json") if here in done else None
            differ += after is None or (here / "frames.csv").read_bytes() != (there / "frames.csv").read_bytes()
            success.append((after.tracking.success if after else 0.0) - before.tracking.success)
            errors = [score.ate["none"].translation_m if score else None for score in (before, after)]
            medians = [error.median for error in errors if error is not None and error.median > 0.0]
            if len(medians) == len(errors):
                ratios.append(medians[1] / medians[0])
    ratio = float(np.exp(np.mean(np.log(ratios)))) if ratios else float("nan")
    return Change(variant, runs, differ, float(np.mean(success)) if success else float("nan"), ratio)


def remove_table(folder: Path) -> None:
    """Remove the table of an earlier study, whose runs may be replaced; UserError when it was edited."""
    listed = Listed.of(folder, TABLE)
    with owning(folder / name for name in (CSV, MARKDOWN) if listed.holds(folder, name)):
        for name in (CSV, MARKDOWN):
            refuse_foreign_file(folder / name, TABLE.kind)
    with new_parts(folder, TABLE):
        pass


@in_parts(TABLE)
def write(folder: Path, changes: list[Change]) -> Path:
    """Write the table as CSV, a row per variant, and as Markdown, largest changes first; the path of the latter."""
    rows = [
        (c.variant.value.path, c.variant.value.default, c.variant.factor, c.variant.set_to, c.runs, c.runs_changed,
         c.success, c.error_ratio)
        for c in changes
    ]  # fmt: skip
    write_csv(folder / CSV, COLUMNS, rows)
    still = sorted({c.variant.value.path for c in changes} - {c.variant.value.path for c in changes if c.runs_changed})
    lines = ["| " + " | ".join(HEADS) + " |", "|---|---:|---:|---:|---:|---:|"]
    lines += [
        f"| `{c.variant.value.path}` | {c.variant.value.default} | {c.variant.set_to} | {c.runs_changed} of {c.runs} | "
        f"{_percent(c.success)} | {_percent(c.error_ratio - 1)} |"
        for c in sorted(changes, key=_most)
    ]
    lines += ["", f"No run responds to: {', '.join(f'`{path}`' for path in still) or 'none of them'}.", ""]
    write_text(folder / MARKDOWN, "\n".join(lines))
    return folder / MARKDOWN


def _percent(share: float) -> str:
    """A signed share in percent; n/a where no run has one."""
    return f"{100 * share:+.1f}" if np.isfinite(share) else "n/a"


def _most(c: Change) -> tuple[float, float, str]:
    error = abs(np.log(c.error_ratio)) if np.isfinite(c.error_ratio) else 0.0
    return -abs(c.success), -float(error), c.variant.label
