"""What the commands do."""

import json
import signal
from concurrent.futures import Executor
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click

from bench.config import load_suite, suite_model
from bench.estimate import dry_run, remember
from bench.executors import dask_pool, local_pool
from bench.folder import suite_folder
from bench.graph import Outcome, run_graph
from bench.jobs import plan
from bench.peers.registry import absent
from bench.shard import Shard
from bench.slurm import run_shards
from bench.suite_files import suite_file
from bench.works import Figures
from trajectories.errors import unknown_name


@dataclass(frozen=True, kw_only=True)
class Where:
    """Where and how much of a suite is done; see `uavbench run --help`."""

    workers: int = 1
    shard: str = ""
    dask: str = ""
    slurm: int = 0
    slurm_options: tuple[str, ...] = ()
    dry_run: bool = False
    figures: Figures = "page"


def bring_up_to(verb: str, suite_name: str, out: Path | None, where: Where) -> int:
    """Do what is missing of a suite up to `verb`.

    Exit code 0 when all of it is there, 2 after a user's mistake,
    1 when a job failed otherwise.
    """
    suite = load_suite(suite_file(suite_name))
    folder = (out or Path("out") / suite.name).resolve()
    shard = Shard.parse(where.shard) if where.shard else None
    last = "score" if shard and verb == "report" else verb
    jobs = plan(shard.of(suite) if shard else suite, folder, last=last, figures=where.figures)
    if where.dry_run:
        click.echo(dry_run(jobs, folder, where.slurm or where.workers))
        return 0
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    if where.slurm:
        run_shards(verb, suite_name, folder, where.slurm, where.slurm_options)
    with suite_folder(folder, suite, shard), _executor(where, folder) as (executor, progress):
        outcome = run_graph(jobs, executor, progress)
        if shard is None:
            remember(outcome, folder)
        tell(outcome, folder)
        for label, why in absent(suite.trackers).items():
            click.echo(f"absent: {label}: {why}", err=True)
        if last == "report" and "report" not in outcome.failed:
            click.echo((folder / "tables" / "summary.md").read_text(encoding="utf-8"))
            click.echo(f"report: {folder / 'index.html'}")
    return 2 if outcome.users_mistake else 1 if outcome.failed else 0


def _executor(where: Where, folder: Path) -> AbstractContextManager[tuple[Executor, Any]]:
    return dask_pool(where.dask, where.workers, folder) if where.dask else local_pool(where.workers)


def tell(outcome: Outcome, folder: Path) -> None:
    """Say on standard error what was done, how long it took, and what failed and why."""
    count = f"{len(outcome.done)} jobs done, {len(outcome.fresh)} were fresh, {len(outcome.failed)} failed"
    cost = f"{outcome.wall_s:.1f} s, at most {outcome.peak_mb:.0f} MB in all processes together"
    click.echo(f"{count}; {cost}", err=True)
    for name, why in outcome.failed.items():
        click.echo(f"FAILED {name}: {why}", err=True)
    if outcome.tracebacks:
        path = folder / "failures.txt"
        path.write_text("\n".join(f"{name}\n{text}" for name, text in outcome.tracebacks.items()), encoding="utf-8")
        click.echo(f"details: {path}", err=True)


def track_real(kind: str, source: Path, model: Path, camera: Path, init: Path, out: Path, rate_hz: float) -> None:
    """Run a tracker on the images of a folder or a video, and say where the estimates are."""
    from tracker.real import track_images
    from tracker.variants import TRACKERS

    if kind not in TRACKERS:
        raise unknown_name("tracker", kind, list(TRACKERS))
    results = track_images(TRACKERS[kind](), source, model=model, camera=camera, init=init, out=out, rate_hz=rate_hz)
    click.echo(f"{int(results.ok.sum())} of {len(results)} frames with a pose: {out / 'estimate.tum'}")


def schema() -> str:
    """JSON Schema of a suite."""
    return json.dumps(suite_model().model_json_schema(), indent=1)
