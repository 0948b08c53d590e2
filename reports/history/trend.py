"""The verdict on a history: every series with its changes, and which of them raise an alarm."""

import math
from dataclasses import dataclass

from uavbench.reports.history.change_points import LEAST_COMMITS, Change, changes
from uavbench.reports.history.history_file import Commit, History
from uavbench.reports.history.series import Series, all_series
from uavbench.trajectories.errors import UserError

SHORT = 9
"""Characters of a commit's hash that people read."""


@dataclass(frozen=True)
class Trend:
    """A series with its changes, and those that alarm: worse, not made good since, and not accepted."""

    series: Series
    changes: list[Change]
    alarms: list[Change]

    def said(self, change: Change) -> str:
        """A change in a sentence."""
        commits = self.series.commits
        worse = "worse" if change.size > 0 else "better"
        share = f"{100 * abs(change.size):.1f} %" + (" of all frames or flights" if self.series.bigger else "")
        if change.kind == "drift":
            first, last = (short(commits[k]) for k in (change.first, change.last))
            return f"{self.series.name}: {share} {worse} by drift from {first} to {last}"
        return f"{self.series.name}: {share} {worse} with {short(commits[change.at])} ({commits[change.at].subject})"


def trends(history: History, margin: float, since: str = "") -> list[Trend]:
    """The trend of every metric; changes before the commit `since` are accepted.

    UserError when the history has no such commit, or too few for any trend.
    """
    names = [entry.commit for entry in history.commits]
    begin = _place(names, since) if since else 0
    if len(names) < LEAST_COMMITS:
        raise UserError(f"the history has {len(names)} commits; a trend needs {LEAST_COMMITS}: record more")
    found = []
    for series in all_series(history):
        accepted = {entry.commit for entry in history.commits[:begin]}
        every = changes(series, margin)
        alarms = [
            change
            for k, change in enumerate(every)
            if change.size > 0
            and series.commits[change.at].commit not in accepted
            and _net(series, every[k:]) >= margin
        ]
        found.append(Trend(series, every, alarms))
    return found


def short(commit: Commit) -> str:
    """The hash that people read."""
    return commit.commit[:SHORT]


def _net(series: Series, every: list[Change]) -> float:
    """What is left of changes at the end."""
    if series.bigger:
        return sum(change.size for change in every)
    return math.prod(1 + change.size for change in every) - 1


def _place(names: list[str], since: str) -> int:
    found = [k for k, name in enumerate(names) if name.startswith(since)]
    if len(found) != 1:
        many = "no commit" if not found else "more than one commit"
        raise UserError(f"--since {since}: the history has {many} whose hash begins so")
    return found[0]
