"""The verdict on a history: every series with its changes, and which of them raise an alarm."""

from dataclasses import dataclass

import numpy as np

from uavbench.reports.history.change_points import Change, changes
from uavbench.reports.history.history_file import Commit, History
from uavbench.reports.history.series import Series, all_series
from uavbench.trajectories.errors import UserError

SHORT = 9
"""Characters of an abbreviated hash."""


@dataclass(frozen=True)
class Trend:
    """A series with its changes; alarms: those for the worse that were neither recovered since nor accepted."""

    series: Series
    changes: list[Change]
    alarms: list[Change]

    def said(self, change: Change) -> str:
        """A change as a sentence."""
        commits = self.series.commits
        worse = "worse" if change.size > 0 else "better"
        share = f"{100 * abs(change.size):.1f} %" + (" of all frames or flights" if self.series.bigger else "")
        if change.kind == "drift":
            first, last = (short(commits[k]) for k in (change.first, change.last))
            return f"{self.series.name}: {share} {worse} by drift from {first} to {last}"
        return f"{self.series.name}: {share} {worse} with {short(commits[change.at])} ({commits[change.at].subject})"


def trends(history: History, margin: float, since: str = "") -> list[Trend]:
    """The trend of every metric of every tracker; changes before the commit `since`, a hash or its start, are accepted.

    margin: least size of a change, as in `changes`. UserError when the history has no commits, none or several that
    match `since`, or ruptures is not installed.
    """
    names = [entry.commit for entry in history.commits]
    begin = _place(names, since) if since else 0
    if not names:
        raise UserError("the history has no commits: record one with `uavbench gate RESULTS --record FILE`")
    found = []
    for series in all_series(history):
        accepted = {entry.commit for entry in history.commits[:begin]}
        every = changes(series, margin)
        alarms = [
            change
            for k, change in enumerate(every)
            if change.size > 0
            and series.commits[change.at].commit not in accepted
            and _left(series, every[k:]) >= margin
        ]
        found.append(Trend(series, every, alarms))
    return found


def short(commit: Commit) -> str:
    """Abbreviated hash of a commit."""
    return commit.commit[:SHORT]


def _left(series: Series, every: list[Change]) -> float:
    """Remaining size of the first of these changes at the best commit since."""
    sizes = np.array([change.size for change in every])
    together = np.cumsum(sizes) if series.bigger else np.cumprod(1 + sizes) - 1
    return float(together.min())


def _place(names: list[str], since: str) -> int:
    found = [k for k, name in enumerate(names) if name.startswith(since)]
    if len(found) != 1:
        many = "no commit" if not found else "more than one commit"
        raise UserError(f"--since {since}: the history has {many} whose hash begins with it")
    return found[0]
