"""`uavbench gate --record FILE`: add the scores of a commit to a history.

A history holds the flights of one suite, scored in one way and in one environment, so that steps are due to commits.
Scores that differ in any of these are refused. The details of a named environment may change; they are recorded with
each commit.
"""

import fcntl
import math
import os
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from uavbench.bench.gate.paired_scores import Side, read_side
from uavbench.bench.gate.versions import git
from uavbench.bench.history.environment import environment
from uavbench.reports.history.history_file import (
    Commit,
    History,
    Recorded,
    SuiteIdentity,
    read_history,
    rounded,
    write_history,
)
from uavbench.reports.history.series import LEAST_ERROR
from uavbench.reports.statistics.bootstrap import hierarchical_interval
from uavbench.scenes.dataset.table_files import read_json
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.folders import folder_for, make_folder

FREE = ("uavbench",)
"""Details of an environment that are not compared: they change with every commit of uavbench's own repository."""


@dataclass(frozen=True)
class Where:
    """Destination of a record: the history's file, the commit ("" for HEAD), the environment's name ("" for none)."""

    file: Path
    commit: str = ""
    name: str = ""


def record(folder: Path, where: Where) -> None:
    """Add the scores of a suite's folder to a history.

    UserError when a run failed or is missing, the scores are of another suite or environment, the file is not a
    history, or the working tree has uncommitted changes.
    """
    if os.path.lexists(where.file):
        read_history(where.file)  # refuses a file that is not a history before any other error
    side = read_side(folder)
    for key, why in side.faults.items():
        raise UserError(f"not recorded: {key[0]} on {key[1]}, seed {key[2]}: {why}")
    if not side.runs or not side.flights:
        raise UserError(f"{folder}: nothing to record; give a folder of `uavbench run`, `score` or `fly`")
    suite = identity(folder, side)
    entry = entry_of(side, where, environment(folder, side))
    with alone(where.file):
        if where.file.exists():
            history = read_history(where.file)
            expect_same(where, history, suite, entry.environment)
            history = replace(history, name=where.name or history.name)
        else:
            history = History(suite=suite, name=where.name, environment=entry.environment, commits=[])
        write_history(where.file, history.with_commit(entry, _descendants(entry, history)))


def identity(folder: Path, side: Side) -> SuiteIdentity:
    """Identity shared by all commits of a history: the suite's name, its flights, and how they are scored."""
    name = str(read_json(folder / "suite.json").get("suite") or folder.name)
    return SuiteIdentity(name=name, flights=side.flights, how=dict(next(iter(side.runs.values())).how))


def expect_same(where: Where, history: History, suite: SuiteIdentity, details: dict[str, str]) -> None:
    """Raise UserError unless a history is of this suite and environment; details: of the environment, by name."""
    file = where.file
    if history.suite.flights != suite.flights:
        named = f"of the suite {history.suite.name!r}, these results are of {suite.name!r}"
        alike = "of other flights of this suite, which has changed since"
        told = named if history.suite.name != suite.name else alike
        raise UserError(f"{file}: the history is {told}; record into another file, or move this one away")
    if history.suite.how != suite.how:
        raise UserError(f"{file}: the history's numbers were computed in another way; record into another file")
    if history.name and where.name != history.name:
        given = f"not of {where.name!r}" if where.name else "give it to go on in this history"
        raise UserError(f"{file}: the history is of the environment --environment {history.name!r}: {given}")
    other = [
        f"{key} {history.environment.get(key, 'none')} there, {details.get(key, 'none')} here"
        for key in sorted({*history.environment, *details} - {*FREE})
        if history.environment.get(key) != details.get(key)
    ]
    if other and not where.name:
        raise UserError(
            f"{file}: the history is of another environment: {'; '.join(other)}; record into another file, or give "
            "both a name with --environment NAME if these differences are acceptable"
        )


def entry_of(side: Side, where: Where, details: dict[str, str]) -> Commit:
    """Entry of a commit with the scores of a folder: coverage or success, errors in their units, crashes.

    UserError when the working tree has uncommitted changes.
    """
    commit, time, subject = described(where)
    metrics: dict[str, dict[str, Recorded]] = {}
    crashes: dict[str, int] = {}
    for run in sorted({key[0] for key in side.runs}):
        of_run = {(key[1], key[2]): one for key, one in side.runs.items() if key[0] == run}
        metrics[run] = {side.share: _recorded({key: one.coverage for key, one in of_run.items()}, "", bigger=True)}
        for metric, unit in side.units.items():
            values = {key: one.errors.get(metric, math.nan) for key, one in of_run.items()}
            metrics[run][metric] = _recorded(values, unit, bigger=False)
        if crashed := sum(bool(one.crash) for one in of_run.values()):
            crashes[run] = crashed
    return Commit(
        commit=commit, time=time, subject=subject, environment=details, metrics=metrics, crashes=crashes
    )  # fmt: skip


class DescribedCommit(NamedTuple):
    """Full hash, commit time (ISO 8601) and subject of a commit."""

    commit: str
    time: str
    subject: str


def described(where: Where) -> DescribedCommit:
    """The commit that scores are recorded for; UserError when it is unknown, or HEAD with uncommitted changes."""
    if not where.commit and (changed := list(_changed(where.file))):
        raise UserError(
            f"the working tree has uncommitted changes: {changed[0]}; commit them, or name with --commit the commit "
            "that the results are of"
        )
    ref = where.commit or "HEAD"
    shown = git("show", "--no-patch", "--format=%H%x00%cI%x00%s", "--end-of-options", f"{ref}^{{commit}}")
    commit, time, subject = shown.decode(errors="replace").rstrip("\n").split("\0")
    return DescribedCommit(commit, time, subject)


def _descendants(entry: Commit, history: History) -> frozenset[str]:
    """Commits from an entry to the last one of a history; none where they are not of one line, or not known here."""
    if not history.commits:
        return frozenset()
    try:
        span = f"{entry.commit}..{history.commits[-1].commit}"
        return frozenset(git("rev-list", "--ancestry-path", "--end-of-options", span).decode().split())
    except UserError:  # a shallow clone, or a commit that is gone
        return frozenset()


def _changed(file: Path) -> Iterator[str]:
    """Tracked files that differ from HEAD, except the history itself."""
    top = Path(git("rev-parse", "--show-toplevel").decode().rstrip("\n"))
    for name in git("-C", str(top), "diff", "--name-only", "-z", "HEAD").decode(errors="replace").split("\0"):
        if name and (top / name).resolve() != file.resolve():
            yield name


def _recorded(values: dict[tuple[str, int], float], unit: str, *, bigger: bool) -> Recorded:
    """One metric of one tracker, from its values by (sequence, seed); NaN for a run without one.

    bigger: a share, which is better the bigger it is; otherwise an error, whose mean is geometric.
    """
    runs: dict[str, list[float]] = {}
    for sequence, seed in sorted(values):
        runs.setdefault(sequence, []).append(values[sequence, seed])
    known = [np.array(each)[np.isfinite(each)] for each in runs.values()]
    known = [each for each in known if len(each)]
    value, low, high = math.nan, math.nan, math.nan
    if known:
        scaled = known if bigger else [np.log(np.maximum(each, LEAST_ERROR)) for each in known]
        found = hierarchical_interval(scaled)
        value, low, high = (v if bigger else math.exp(v) for v in (found.mean, found.low, found.high))
        low, high = (np.clip([low, high], 0.0, 1.0 if bigger else np.inf)).tolist()
    return Recorded(
        unit=unit, better="bigger" if bigger else "smaller", value=rounded(value), low=rounded(low),
        high=rounded(high), runs={name: [rounded(v) for v in each] for name, each in runs.items()},
    )  # fmt: skip


@contextmanager
def alone(file: Path) -> Iterator[None]:
    """Exclusive lock on the folder of a history: concurrent records would overwrite each other."""
    with ExitStack() as stack, folder_for(file):  # which is removed, if at all, while it is locked
        while not _is_locked(file.parent, stack):
            make_folder(file.parent)
        yield


def _is_locked(folder: Path, stack: ExitStack) -> bool:
    """Whether a folder is locked, until the stack ends; False where a process that failed removed it meanwhile."""
    try:
        handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    except FileNotFoundError:
        return False
    stack.callback(os.close, handle)
    fcntl.flock(handle, fcntl.LOCK_EX)
    try:
        return os.path.samestat(os.fstat(handle), folder.stat())
    except FileNotFoundError:
        return False
