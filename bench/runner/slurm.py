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
    """Run every shard as a job of its own and wait for them; how many failed. An interrupt cancels them.

    run_shard: gets `i/n`, returns an exit code; it is pickled. Logs lie in `slurm` under out.
    options: `key=value` of submitit (`slurm_partition=short`, `timeout_min=600`). UserError when submitit is not
    installed, there is no Slurm, or an option is wrong.
    """
    try:
        import submitit  # type: ignore[import-not-found, unused-ignore]
    except ImportError:
        raise UserError("--slurm needs submitit: pip install 'uavbench[slurm]'") from None
    logs = out.resolve() / "slurm"
    try:
        executor = submitit.AutoExecutor(folder=logs, cluster=cluster)
        if executor.cluster == "local" and cluster is None:
            raise UserError("--slurm: there is no sbatch on this machine; run it where Slurm's commands are")
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
