"""How often the history's alarms are wrong: `python -m uavbench.bench.history.validation`.

RERUNS holds the errors of reruns of one suite by the same code, with other random numbers and noise of one grey level
added to each frame: {tracker: {metric: {flight: [error of each rerun]}}}. A series takes of each flight another rerun
at every commit, so whatever alarms is a false alarm; it is looked at after every commit, as a CI does. Then every error
from a known commit on is made larger, and the commits until the alarm are counted; or it grows a little with every
commit, less than any two commits tell.
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
    """A number of series of `before` commits, then `within` that are worse by a share `step`; or by `drift` with each.

    looks: commits between two looks for false alarms; copies: how often the flights are there, each drawn on its own.
    """

    series: int = 100
    before: int = 40
    within: int = 5
    step: float = 0.05
    drift: float = 0.002
    looks: int = 1
    copies: int = 1


def resampled(flights: Mapping[str, list[float]], commits: int, rng: np.random.Generator, copies: int = 1) -> Array:
    """Errors (commits, copies * flights), each of a rerun drawn at random."""
    return np.array([rng.choice(errors, commits) for _ in range(copies) for errors in flights.values()]).T


def history_of(errors: Array) -> History:
    """A history of one tracker and metric with these errors (commits, flights)."""
    commits = [
        Commit(commit=f"{k:040x}", time="", subject="", environment={}, metrics={NAME[0]: {NAME[1]: _recorded(row)}})
        for k, row in enumerate(errors)
    ]
    return History(suite=SuiteIdentity(name="", flights="", how={}), name="", environment={}, commits=commits)


def _recorded(row: Array) -> Recorded:
    value = float(np.exp(np.mean(np.log(row)))) if len(row) else None
    return Recorded(unit="m", better="smaller", value=value, low=None, high=None, runs={"all": row.tolist()})


def alarms(errors: Array) -> bool:
    """Whether the history of these errors (commits, flights) has become worse."""
    series = series_of(history_of(errors), *NAME)
    return series is not None and any(change.size > 0 for change in changes(series))


def first_alarm(errors: Array, looks: range) -> int | None:
    """The first number of commits among `looks` at which the history alarms."""
    return next((n for n in looks if alarms(errors[:n])), None)


def measured(flights: Mapping[str, list[float]], trial: Trial) -> dict[str, float]:
    """Series with a false alarm, steps that are found in time with their mean delay, and drifts with theirs."""
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
