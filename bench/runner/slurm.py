"""Shards of a suite as jobs of Slurm, submitted with submitit."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from uavbench.bench.said import say
from uavbench.trajectories.errors import UserError

POLL_S = 5.0


def run_shards(
    run_shard: Callable[[str], int], out: Path, shards: int, options: tuple[str, ...], *, cluster: str | None = None
) -> int:
    """Run each shard as a Slurm job and wait for all; returns the number of failures. An interrupt cancels the jobs.

    run_shard: picklable function from `i/n` to an exit code. out: logs are written to its subfolder `slurm`.
    options: `key=value` of submitit (`slurm_partition=short`, `timeout_min=600`). UserError when submitit or Slurm is
    not installed, or an option is invalid.
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
    except (NameError, TypeError, ValueError, AssertionError) as error:
        raise UserError(f"--slurm: {error}") from None
    say(f"{shards} shards submitted; logs: {logs}", err=True)
    try:
        while not all(job.done() for job in jobs):
            time.sleep(POLL_S)
    except KeyboardInterrupt:
        for job in jobs:
            job.cancel()
        raise
    return sum(_failed(job) for job in jobs)


def _failed(job: Any) -> bool:
    error = job.exception()
    if error is not None:
        say(f"FAILED shard, job {job.job_id}: {(str(error).splitlines() or [type(error).__name__])[0]}", err=True)
        return True
    return bool(job.result())


def _parsed(options: tuple[str, ...]) -> dict[str, Any]:
    table: dict[str, Any] = {}
    for option in options:
        key, equals, value = option.partition("=")
        if not equals:
            raise UserError(f"--slurm-option {option}: write key=value")
        table[key] = int(value) if value.isdecimal() else value
    return table
