"""Shards of a suite as jobs of Slurm, submitted with submitit."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from uavbench.bench.said import say
from uavbench.trajectories.errors import UserError

POLL_S = 5.0
LINE = "----------------------"
"""What submitit writes before and after a traceback."""


def run_shards(
    run_shard: Callable[[str], int], out: Path, shards: int, options: tuple[str, ...], *, cluster: str | None = None
) -> int:
    """Run each shard as a Slurm job and wait for all; returns the number of failures. An interrupt cancels the jobs.

    run_shard: picklable function from `i/n` to an exit code. out: logs are written to its subfolder `slurm`.
    options: `key=value` of submitit (`slurm_partition=short`, `timeout_min=600`). UserError when submitit or Slurm is
    not installed, an option is invalid, or the queue refuses the jobs.
    """
    try:
        import submitit  # type: ignore[import-not-found, unused-ignore]
    except ImportError:
        raise UserError("--slurm needs submitit: pip install 'uavbench[slurm]'") from None
    logs = out.resolve() / "slurm"
    try:
        executor = submitit.AutoExecutor(folder=logs, cluster=cluster)
        if executor.cluster == "local" and cluster is None:
            raise UserError("--slurm: sbatch is not installed on this machine; run this on a submit node of Slurm")
        executor.update_parameters(**{"cpus_per_task": 1, "timeout_min": 24 * 60, **_parsed(options)})
        with executor.batch():
            jobs = [executor.submit(run_shard, f"{i}/{shards}") for i in range(1, shards + 1)]
    except (NameError, TypeError, ValueError, AssertionError, RuntimeError) as error:  # the last one of sbatch
        raise UserError(f"--slurm: {'; '.join(str(error).splitlines()) or type(error).__name__}") from None
    say(f"{shards} shards submitted; logs: {logs}", err=True)
    try:
        while not all(job.done() for job in jobs):
            time.sleep(POLL_S)
    except KeyboardInterrupt:
        for job in jobs:
            job.cancel()
        raise
    return sum(_failed(job, f"{i}/{shards}") for i, job in enumerate(jobs, start=1))


def _failed(job: Any, shard: str) -> bool:
    error = job.exception()
    if error is not None:
        say(f"FAILED shard {shard}, job {job.job_id}: {_why(error)} (log: {job.paths.stderr})", err=True)
        return True
    return bool(job.result())


def _why(error: Exception) -> str:
    """The line of submitit's message that tells why a job failed: the last one of its traceback, or the job's state."""
    head, *parts = str(error).split(LINE)
    lines = [line for line in (parts[0] if "with trace" in head and parts else head).splitlines() if line.strip()]
    states = [line for line in lines if "state:" in line]
    return (states or lines or [type(error).__name__])[-1].strip()


def _parsed(options: tuple[str, ...]) -> dict[str, Any]:
    table: dict[str, Any] = {}
    for option in options:
        key, equals, value = option.partition("=")
        if not equals:
            raise UserError(f"--slurm-option {option}: write key=value")
        table[key] = int(value) if value.isdecimal() else value
    return table
