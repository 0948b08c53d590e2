"""Implementation of the commands over a suite."""

import json
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain
from pathlib import Path

from uavbench.bench.config.shard import Shard
from uavbench.bench.config.suite import Suite, load_suite, suite_model
from uavbench.bench.config.suite_files import suite_file
from uavbench.bench.external.program import isolated_trackers
from uavbench.bench.inputs.touched_files import touched_since
from uavbench.bench.runner.estimate import SECONDS, dry_run, remember
from uavbench.bench.runner.executors import Pool, dask_pool, local_pool
from uavbench.bench.runner.extent import (
    current_folders,
    extents,
    problems_of_extents,
    shortfalls,
    table_of_extents,
    unreached_in_flights,
)
from uavbench.bench.runner.graph import NOT_DONE, Job, Outcome, fresh_jobs, run_graph
from uavbench.bench.runner.jobs import plan, plan_flights, plans_of_scores
from uavbench.bench.runner.output_folder import (
    mark_older_pages,
    refuse_foreign_folder,
    remove_verdicts,
    resolved,
    suite_folder,
)
from uavbench.bench.runner.slurm import run_shards
from uavbench.bench.runner.tasks import Figures
from uavbench.bench.said import say
from uavbench.bench.third_party.registry import THIRD_PARTY, absent
from uavbench.reports.run_folder import has_older_report
from uavbench.trajectories.bags.reading import BagTopic
from uavbench.trajectories.errors import UserError, unknown_name
from uavbench.trajectories.files.seals import sealed_kind
from uavbench.trajectories.files.writing import write_text

FAILURES = "failures of jobs"


@dataclass(frozen=True, kw_only=True)
class ExecutionOptions:
    """Options of executing a suite: workers, cluster, shards; see `uavbench run --help`."""

    workers: int = 1
    shard: str = ""
    dask: str = ""
    slurm: int = 0
    slurm_options: tuple[str, ...] = ()
    dry_run: bool = False
    isolate: bool = False
    figures: Figures = "page"
    video: bool = False


def bring_up_to(verb: str, suite_name: str, out: Path | None, where: ExecutionOptions) -> int:
    """Run the missing jobs of a suite up to `verb`.

    The exit code is 0 when all are done, 2 after a mistake in the input, else 1, as for a full disk. A dry run has 2
    when it finds a mistake.
    """
    if where.slurm and where.shard:
        raise UserError(f"--slurm {where.slurm} submits every shard: leave out --shard {where.shard}, or --slurm")
    if where.slurm_options and not where.slurm:
        raise UserError(f"--slurm-option {where.slurm_options[0]}: add --slurm N, or all runs on this machine")
    suite = load_suite(suite_file(suite_name))
    if where.isolate:
        suite = replace(suite, trackers=isolated_trackers(suite.trackers))
    folder = resolved(out or Path("out") / suite.name)
    shard = Shard.parse(where.shard) if where.shard else None
    flown = verb == "fly" or (verb == "report" and bool(suite.loops))
    whole = verb in ("report", "fly")
    of_shard = "video" if flown and where.video else "score"
    last = "report" if whole and shard is None else of_shard if whole else verb
    part = shard.of(suite) if shard else suite
    planned = (
        partial(plan_flights, part, folder, last, where.figures, video=where.video)
        if flown
        else partial(plan, part, folder, last, where.figures)
    )
    jobs = planned()
    if where.dry_run:
        refuse_foreign_folder(folder)
        for job in jobs:
            job.place.refuse_foreign()
        say(dry_run(jobs, folder, where.slurm or where.workers))
        return tell_extents(jobs, "flight" if flown else "sequence")
    if where.slurm:
        refuse_foreign_folder(folder)  # before anything waits in the queue
        run = partial(run_shard, verb, suite_name, folder, isolate=where.isolate, video=where.video)
        run_shards(run, folder, where.slurm, where.slurm_options)
    with suite_folder(folder, suite, shard), disowned_if_ended(jobs, planned), _executor(where, folder) as pool:
        disown_stale_scores(suite, folder, part)
        todo = not_fresh(jobs)
        if any(job.verb == "score" for job in todo):
            remove_verdicts(folder)
        if todo:
            mark_older_pages(folder)  # now, as a run that is killed marks none at its end
        outcome = run_graph(jobs, *pool)
        if changed := disown_touched(jobs, planned, outcome.done):
            say(changed, err=True)
        count_failed_trackers(jobs, outcome)
        tell(outcome, folder, suite_name)
        if last != "report":
            tell_faults(jobs, outcome)
        tell_doubts(jobs, outcome)
        if shard is None:
            with told_at_most(folder / SECONDS):
                remember(outcome, folder)
        for label, why in absent(suite.trackers).items():
            say(f"absent: {label}: {why}", err=True)
        page, table = folder / "index.html", folder / "tables" / ("flights.md" if flown else "summary.md")
        if last == "report" and "report" not in outcome.failed:
            say(table.read_text(encoding="utf-8"))
            say(f"report: {page}")
        elif page.is_file() and (last == "report" or has_older_report(folder)):
            anew = "" if last == "report" else f"; `uavbench report {suite_name} --out {folder}` writes it anew"
            say(f"no report: {page} is that of an earlier run{anew}", err=True)
    return 2 if outcome.users_mistake else 1 if outcome.failed else 0


def tell_extents(jobs: list[Job], what: str) -> int:
    """Report the sequences or flights (`what`) that jobs would make; the exit code is 2 when one cannot be made."""
    found = extents((job.work for job in jobs), current_folders(jobs))
    if not found:
        return 0
    say(table_of_extents(found, what))
    if told := problems_of_extents(found, what):
        say(told, err=True)
        return 2
    return 0


def run_shard(verb: str, suite_name: str, out: Path, shard: str, *, isolate: bool = False, video: bool = False) -> int:
    """Run a shard `i/n` of a suite in this process, without the report, which needs all shards."""
    return bring_up_to(verb, suite_name, out, ExecutionOptions(workers=1, shard=shard, isolate=isolate, video=video))


def disown_stale_scores(suite: Suite, folder: Path, part: Suite) -> None:
    """Let nobody read the scores of earlier inputs as current ones, should the jobs that replace them fail or not run.

    Those of replays and of flights, whichever are made now. part: what this process runs of the suite; other shards may
    be making the rest, of which only scores that were made of other inputs are stale. Scores that no job made, as those
    of `uavbench compare` or of a copy without records, stay as they are. The gate's verdicts on stale ones are removed.
    """
    stale = [
        job
        for jobs in plans_of_scores(part, folder)
        for job in not_fresh(jobs)
        if job.verb == "score" and job.place.record.is_file()
    ]
    here = {spec.name for spec in part.sequences}
    rest = replace(suite, sequences=tuple(spec for spec in suite.sequences if spec.name not in here))
    for job in chain(*plans_of_scores(rest, folder) if rest.sequences else ()):
        if job.verb == "score" and job.place.is_of_other_inputs(job.content_hash):
            stale.append(job)
    for job in stale:
        job.place.disown()
    if stale:
        remove_verdicts(folder)


def not_fresh(jobs: list[Job]) -> list[Job]:
    """Jobs that are to be done; jobs: in topological order."""
    fresh = {job.name for job in fresh_jobs(jobs)}
    return [job for job in jobs if job.name not in fresh]


def disown_touched(jobs: list[Job], planned: Callable[[], list[Job]], done: list[Job]) -> str:
    """Make the jobs done stale whose inputs were written while they ran; a message about it, "" if there are none.

    jobs: as they were planned before; planned: plans them again.
    """
    touched = touched_since(_keys(jobs), lambda: _keys(planned()), [job.name for job in done])
    for job in done:
        if job.name in touched.jobs:
            job.place.disown()
    count = f"the same command does {len(touched.jobs)} of them again"
    return f"changed while jobs that use it ran: {touched}; {count}" if touched.jobs else ""


def _keys(jobs: list[Job]) -> dict[str, str]:
    return {job.name: job.content_hash for job in jobs}


@contextmanager
def disowned_if_ended(jobs: list[Job], planned: Callable[[], list[Job]]) -> Iterator[None]:
    """Context that disowns the jobs whose inputs were written when it ends by an exception, such as an interrupt.

    Enter it before the executor, whose workers may finish jobs until it has ended.
    """
    try:
        yield
    except BaseException:
        disown_touched(jobs, planned, [job for job in jobs if job.fresh])
        raise


def refuse_touched(jobs: list[Job], planned: Callable[[], list[Job]], done: list[Job]) -> None:
    """`disown_touched`, for a command that goes on with the results: UserError when an input was written."""
    if changed := disown_touched(jobs, planned, done):
        raise UserError(changed)


def count_failed_trackers(jobs: list[Job], outcome: Outcome) -> None:
    """Count jobs, including up-to-date ones, as failed when their tracker failed on all frames; results are kept."""
    for job in jobs:
        if job.verb == "track" and job.name not in outcome.failed and job.marker.is_file():
            record = json.loads(job.marker.read_text(encoding="utf-8"))
            if why := record.get("failed"):
                outcome.failed[job.name] = str(why)
    outcome.done = [job for job in outcome.done if job.name not in outcome.failed]
    outcome.fresh = [job for job in outcome.fresh if job.name not in outcome.failed]


def tell_faults(jobs: list[Job], outcome: Outcome) -> None:
    """Report the runs whose trackers broke the protocol on some frames; a report has them in its table."""
    for job in jobs:
        if job.verb == "track" and job.name not in outcome.failed and job.marker.is_file():
            errors = json.loads(job.marker.read_text(encoding="utf-8")).get("errors")
            if errors:
                count = "1 fault" if len(errors) == 1 else f"{len(errors)} faults, first"
                say(f"crashed: {job.name} counts as failed, for {count}: {errors[0]}", err=True)


def tell_doubts(jobs: list[Job], outcome: Outcome) -> None:
    """Report the runs whose poses are far off in the way of another convention."""
    for job in jobs:
        if job.verb == "score" and job.name not in outcome.failed and job.marker.is_file():
            for doubt in json.loads(job.marker.read_text(encoding="utf-8")).get("doubts", ()):
                say(f"doubt: {job.name.removeprefix('score ')}: {doubt}", err=True)


def _executor(where: ExecutionOptions, folder: Path) -> AbstractContextManager[Pool]:
    return dask_pool(where.dask, where.workers, folder) if where.dask else local_pool(where.workers)


def tell(outcome: Outcome, folder: Path, suite: str) -> None:
    """Report on standard error the jobs of a suite done, their time, and the failures with their reasons."""
    count = f"{len(outcome.done)} jobs done, {len(outcome.fresh)} were fresh, {len(outcome.failed)} failed"
    cost = f"{outcome.wall_s:.1f} s, at most {outcome.peak_mb:.0f} MB in all processes"
    say(f"{count}; {cost}", err=True)
    for line in shortfalls(job.marker for job in outcome.done if job.verb == "render"):
        say(line, err=True)
    for line in unreached_in_flights(job.marker for job in outcome.done if job.verb == "fly"):
        say(line, err=True)
    causes = {name: why for name, why in outcome.failed.items() if not why.startswith(NOT_DONE)}
    for name, why in causes.items():
        say(f"FAILED {name} of {suite}: {why}", err=True)
    if after := len(outcome.failed) - len(causes):
        say(f"not done: {after} job{'s that need' if after > 1 else ' that needs'} what failed", err=True)
    path = folder / "failures.txt"
    with told_at_most(path):
        if outcome.tracebacks:
            text = "\n".join(f"{name}\n{text}" for name, text in outcome.tracebacks.items())
            write_text(path, f"{text.rstrip()}\n", kind=FAILURES)
            say(f"details: {path}", err=True)
        elif sealed_kind(path) == FAILURES:
            path.unlink()  # left by an earlier run


@contextmanager
def told_at_most(path: Path) -> Iterator[None]:
    """Context that prints a warning for a file that cannot be written, and continues, since the jobs are done."""
    try:
        yield
    except UserError as error:
        say(f"not written: {error}", err=True)
    except OSError as error:
        say(f"not written: {path}: {error.strerror or error}", err=True)


def track_real(
    kind: str, source: Path | BagTopic, model: Path, camera: Path, init: Path, out: Path, rate_hz: float
) -> None:
    """Run a tracker on the images of a folder, a video or a topic of a bag, and print the path of the estimates."""
    from uavbench.tracker.images.track_images import track_images
    from uavbench.tracker.registry import TRACKERS
    from uavbench.tracker.run import all_failed

    if kind in THIRD_PARTY:
        raise UserError(
            f"tracker {kind!r}: a third-party tracker runs in suites only; name your images as a recording of a "
            f"suite (recordings.NAME), and the tracker there as {{ kind = {kind!r} }}"
        )
    if kind not in TRACKERS:
        raise unknown_name("tracker", kind, list(TRACKERS))
    results = track_images(TRACKERS[kind](), source, model=model, camera=camera, init=init, out=out, rate_hz=rate_hz)
    if why := all_failed(results):
        raise UserError(why)
    for doubt in results.record["doubts"]:
        say(f"doubt: {doubt}", err=True)
    say(f"{results.summary}: {out / f'estimate_{results.frame}.tum'}")


def schema() -> str:
    """JSON Schema of a suite."""
    return json.dumps(suite_model().model_json_schema(), indent=1)
