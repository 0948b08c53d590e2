"""Estimated run time of a plan: reference times, corrected by those measured in this folder."""

import json
from collections.abc import Iterable
from pathlib import Path

from uavbench.bench.runner.graph import Job, Outcome, fresh_jobs
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.reading import read_json
from uavbench.trajectories.files.writing import write_text

SECONDS = "seconds.json"


def remember(outcome: Outcome, folder: Path) -> None:
    """Store the time of each job in s, for the next estimate."""
    if outcome.seconds:
        table = {"seconds": {**remembered(folder), **outcome.seconds}}
        write_text(folder / SECONDS, json.dumps(table, indent=1) + "\n", kind="times of jobs")


def remembered(folder: Path) -> dict[str, float]:
    """Seconds of the jobs done in this folder, by name; empty when the file is missing or incomplete."""
    try:
        table = read_json(folder / SECONDS)["seconds"]
        return {str(name): float(seconds) for name, seconds in table.items()}
    except (UserError, ValueError, KeyError, AttributeError, TypeError, OverflowError):
        return {}


def kind(job: Job) -> str:
    """Kind of a job (step, tracker and rate), within which time is proportional to the job's weight."""
    return f"track {job.name.split()[-1]}" if job.verb == "track" else job.verb


def dry_run(jobs: Iterable[Job], folder: Path, workers: int) -> str:
    """Table of fresh and pending jobs, with the estimated time."""
    jobs = list(jobs)
    fresh = {id(job) for job in fresh_jobs(jobs)}
    took = remembered(folder)
    measured: dict[str, list[tuple[float, float]]] = {}
    for job in jobs:
        if job.name in took:
            measured.setdefault(kind(job), []).append((took[job.name], job.weight))
    lines = [f"{'kind of job':<36} {'jobs':>7} {'fresh':>7} {'to do':>7} {'seconds':>10}  from"]
    total_s = longest_s = 0.0
    for name in dict.fromkeys(map(kind, jobs)):
        same = [job for job in jobs if kind(job) == name]
        todo = [job for job in same if id(job) not in fresh]
        known = measured.get(name, [])
        scale = sum(s for s, _ in known) / sum(w for _, w in known) if known else 1.0
        times = [scale * job.weight for job in todo]
        total_s += sum(times)
        longest_s = max([longest_s, *times])
        source = f"{len(known)} measured here" if known else "reference figures"
        counts = f"{len(same):>7} {len(same) - len(todo):>7} {len(todo):>7}"
        lines.append(f"{name:<36} {counts} {sum(times):>10.1f}  {source}")
    wall_s = max(total_s / workers, longest_s)
    lines.append(f"about {duration_text(wall_s)} with {workers} workers, {duration_text(total_s)} of one core")
    return "\n".join(lines)


def duration_text(seconds: float) -> str:
    """A duration in s as text."""
    if seconds < 120:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 7200 else f"{seconds / 3600:.1f} h"
