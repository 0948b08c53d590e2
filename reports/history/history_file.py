"""The file of a history: one suite, one environment, one line for each commit.

{"format": "uavbench history 1", "suite": {...}, "environment": {...}, "commits": [
 {"commit": "1f3a...", "time": "2026-03-01T12:00:00+00:00", "subject": "...", "environment": {...}, "metrics": {...}},
...]}

Numbers carry six significant digits. The order of the lines is that in which the commits were first recorded, but for
those recorded after a descendant, which stand before it.
"""

import json
import math
from collections import Counter
from collections.abc import Set
from dataclasses import asdict, dataclass, field
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal

from annotated_types import Interval
from pydantic import TypeAdapter, ValidationError

from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.limits import JSON
from uavbench.trajectories.files.origin import owning
from uavbench.trajectories.files.reading import read_json
from uavbench.trajectories.files.writing import write_text

FORMAT = "uavbench history 1"
STRICT: Any = {"extra": "forbid", "allow_inf_nan": False}
LARGEST = 1e12
"""Largest absolute value of a recorded number, in its unit: far beyond any error or time."""
MOST_COMMITS = 10_000
"""Most commits of a history: one each working day for thirty years and more."""
Number = Annotated[float, Interval(ge=-LARGEST, le=LARGEST)]


@dataclass(frozen=True, kw_only=True)
class Recorded:
    """One metric of one tracker at one commit.

    value: mean over sequences of the mean over seeds, geometric where smaller is better; low, high: its 95 % interval
    over sequences and seeds; runs: values by sequence and seed, None for a run without one. All are in `unit`.
    """

    __pydantic_config__ = STRICT

    unit: str
    better: Literal["smaller", "bigger"]
    value: Number | None
    low: Number | None
    high: Number | None
    runs: dict[str, list[Number | None]]


@dataclass(frozen=True, kw_only=True)
class Commit:
    """Metrics of one commit by tracker and name, and the environment in which they were measured.

    time: of the commit, ISO 8601; crashes: number of crashed runs by tracker.
    """

    __pydantic_config__ = STRICT

    commit: str
    time: str
    subject: str
    environment: dict[str, str]
    metrics: dict[str, dict[str, Recorded]]
    crashes: dict[str, int] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class SuiteIdentity:
    """The suite of a history: its name, the hash of its flights (`flights`), and how it is scored (`how`)."""

    __pydantic_config__ = STRICT

    name: str
    flights: str
    how: dict[str, Any]


@dataclass(frozen=True, kw_only=True)
class History:
    """The commits of one suite in one environment.

    name: the user's name for the environment, "" when its details must be equal; environment: its details.
    """

    __pydantic_config__ = STRICT

    suite: SuiteIdentity
    name: str
    environment: dict[str, str]
    commits: list[Commit]

    def with_commit(self, entry: Commit, descendants: Set[str] = frozenset()) -> "History":
        """The history with this entry: in place of the same commit, else before its first descendant, or last."""
        names = [each.commit for each in self.commits]
        if entry.commit in names:
            place = names.index(entry.commit)
            after = self.commits[place + 1 :]
        else:
            place = next((k for k, name in enumerate(names) if name in descendants), len(names))
            after = self.commits[place:]
        commits = [*self.commits[:place], entry, *after]
        return History(suite=self.suite, name=self.name, environment=self.environment, commits=commits)


def read_history(path: Path) -> History:
    """The history in a file.

    UserError naming file and key when it is missing, not a history, invalid, too long, or lists a commit twice.
    """
    advice = "restore the file of an earlier run, or start a new one"
    try:
        body = read_json(path, limit=JSON)
    except UserError as error:
        raise UserError(f"{error}; {advice}" if path.is_file() else f"{error}") from None
    if body.pop("format", None) != FORMAT:
        raise UserError(f"{path}: is not a history of `uavbench gate --record` (no format {FORMAT!r}); {advice}")
    try:
        history = _adapter().validate_python(body)
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(map(str, first["loc"]))
        raise UserError(f"{path}: this history is invalid at `{place}`: {first['msg']}; {advice}") from None
    if len(history.commits) > MOST_COMMITS:
        raise UserError(
            f"{path}: has {len(history.commits):,} commits, at most {MOST_COMMITS:,} are read; start a new one"
        )
    counts = Counter(entry.commit for entry in history.commits)
    if twice := next((name for name, count in counts.items() if count > 1), ""):
        raise UserError(f"{path}: this history lists commit {twice} twice; {advice}")
    return history


def write_history(path: Path, history: History) -> None:
    """Write a history atomically; UserError when `path` exists and is not a history."""
    ours = [path] if path.is_file() and read_history(path) else []
    head = {"format": FORMAT, **asdict(history)}
    lines = [json.dumps(entry, allow_nan=False) for entry in head.pop("commits")]
    text = json.dumps(head, allow_nan=False)[:-1] + ', "commits": [\n ' + ",\n ".join(lines) + "\n]}\n"
    with owning(ours):
        write_text(path, text)


def rounded(value: float) -> float | None:
    """A number rounded to six significant digits, finer than any margin; None when it is not finite."""
    return float(f"{value:.6g}") if math.isfinite(value) else None


@cache
def _adapter() -> "TypeAdapter[History]":
    return TypeAdapter(History)
