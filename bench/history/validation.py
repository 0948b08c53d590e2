"""False alarms and detection delay of a history's alarms: `python -m uavbench.bench.history.validation`.

RERUNS holds the errors of reruns of one suite by the same code, with other seeds and noise of one grey level added to
each frame: {tracker: {metric: {flight: [error of each rerun]}}}. A series draws a rerun of each flight at every commit,
so every alarm is a false alarm; it is evaluated after every commit, as in CI. For steps, all errors from a known commit
on are scaled up, and the commits until the alarm are counted; for drifts, they grow with every commit by less than a
comparison of two commits detects.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import click
import numpy as np

from uavbench.bench.said import say
from uavbench.reports.history.change_points import LEAST_COMMITS, changes
from uavbench.reports.history.history_file import Commit, History, Recorded, SuiteIdentity
from uavbench.reports.history.series import series_of
from uavbench.scenes.dataset.table_files import read_json
from uavbench.trajectories.pose import Array
from uavbench.trajectories.random_streams import stream

RERUNS = Path(__file__).parents[1] / "baselines" / "gate-small-reruns.json"
NAME = ("tracker", "metric")


@dataclass(frozen=True, kw_only=True)
class Trial:
    """Parameters of the simulation.

    series: number of simulated histories; before: commits before the step; within: commits in which a step must be
    found; step: its relative size; drift: relative growth per commit; looks: commits between evaluations of false
    alarms and drifts; copies: independent draws of each flight per commit.
    """

    series: int = 100
    before: int = 40
    within: int = 5
    step: float = 0.05
    drift: float = 0.002
    looks: int = 1
    copies: int = 1


def resampled(flights: Mapping[str, list[float]], commits: int, rng: np.random.Generator, copies: int = 1) -> Array:
    """Errors (commits, copies * flights), each of a rerun drawn with replacement."""
    return np.array([rng.choice(errors, commits) for _ in range(copies) for errors in flights.values()]).T


def history_of(errors: Array) -> History:
    """History of one tracker and metric with these errors (commits, flights), in m."""
    commits = [
        Commit(commit=f"{k:040x}", time="", subject="", environment={}, metrics={NAME[0]: {NAME[1]: _recorded(row)}})
        for k, row in enumerate(errors)
    ]
    return History(suite=SuiteIdentity(name="", flights="", how={}), name="", environment={}, commits=commits)


def _recorded(row: Array) -> Recorded:
    value = float(np.exp(np.mean(np.log(row)))) if len(row) else None
    return Recorded(unit="m", better="smaller", value=value, low=None, high=None, runs={"all": row.tolist()})


def alarms(errors: Array) -> bool:
    """Whether a change for the worse is found in these errors (commits, flights)."""
    series = series_of(history_of(errors), *NAME)
    return series is not None and any(change.size > 0 for change in changes(series))


def first_alarm(errors: Array, looks: range) -> int | None:
    """The first number of commits among `looks` with an alarm; None without one."""
    return next((n for n in looks if alarms(errors[:n])), None)


def measured(flights: Mapping[str, list[float]], trial: Trial) -> dict[str, float]:
    """Number of series with a false alarm, of steps found in time, and of drifts found; mean delays in commits."""
    false, steps, drifts = 0, [], []
    total = 2 * trial.before
    for number in range(trial.series):
        errors = resampled(flights, total, stream(number, "validate-history"), trial.copies)
        last = range(trial.before, LEAST_COMMITS - 1, -trial.looks)
        false += first_alarm(errors, last[::-1]) is not None
        worse = errors * np.where(np.arange(total) < trial.before, 1.0, 1.0 + trial.step)[:, None]
        steps.append(first_alarm(worse, range(trial.before + 1, trial.before + trial.within + 1)))
        rising = errors * (1.0 + trial.drift) ** np.arange(total)[:, None]
        drifts.append(first_alarm(rising, range(LEAST_COMMITS, total + 1, trial.looks)))
    found = [n - trial.before for n in steps if n is not None]
    drifted = [n for n in drifts if n is not None]
    return {
        "false alarms": false,
        "steps found": len(found),
        "commits until the alarm": float(np.mean(found)) if found else np.nan,
        "drifts found": len(drifted),
        "commits until that": float(np.mean(drifted)) if drifted else np.nan,
    }


@click.command()
@click.argument("reruns", type=click.Path(path_type=Path, exists=True), default=RERUNS)
@click.option("--series", default=Trial.series, show_default=True)
@click.option("--before", default=Trial.before, show_default=True, help="Commits before the change.")
@click.option("--looks", default=Trial.looks, show_default=True, help="Commits between two looks.")
@click.option("--copies", default=Trial.copies, show_default=True, help="How often the flights are there.")
def main(reruns: Path, **numbers: int) -> None:
    """Print a row for each tracker and metric."""
    trial = Trial(**numbers)
    for tracker, metrics in read_json(reruns).items():
        for metric, flights in metrics.items():
            row = measured(flights, trial)
            say(f"| {tracker} {metric} | " + " | ".join(f"{value:.3g}" for value in row.values()) + " |")


if __name__ == "__main__":
    main()
