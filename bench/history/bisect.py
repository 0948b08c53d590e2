"""`uavbench bisect GOOD BAD --metric M`: the commit with which a metric became worse.

The commits between the two are bisected like `git bisect` does: git itself selects the next commit (`git rev-list
--bisect-all`), so that branches and merges are followed; the working tree is not touched. Every commit's tracker runs
from its own tree on the frames of BAD's suite. A commit is worse when its metric, the mean over the flights, is nearer
to that of BAD than to that of GOOD. One that cannot run is skipped, and reported.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from uavbench.bench.gate.versions import commit_of, git
from uavbench.trajectories.errors import UserError

Tell = Callable[[str], None]


@dataclass(frozen=True)
class Measurement:
    """The metric at a commit.

    worse: larger is worse: mean natural log of an error, or minus the mean coverage; text: name, value and unit; share:
    whether it is of a share, whose margin is a difference.
    """

    worse: float
    text: str
    share: bool = False


@dataclass(frozen=True)
class Cannot:
    """Reason why a commit could not be measured."""

    why: str


@dataclass(frozen=True)
class Found:
    """Result of a bisection.

    suspects: the first commit known to be worse, then skipped ones that may be the first instead; verdicts: as text, by
    commit measured.
    """

    suspects: list[str]
    verdicts: Mapping[str, str] = field(default_factory=dict)


def bisect(good: str, bad: str, margin: float, measure: Callable[[str], Measurement | Cannot], tell: Tell) -> Found:
    """The first worse commit after `good`, up to `bad`; both are full hashes.

    margin: relative change of an error, or difference of shares of frames or flights; tell: takes a line of progress.
    UserError when `bad` is not worse than `good` by the margin, or one of them cannot be measured.
    """
    levels = {name: _ends(name, measure, tell) for name in (good, bad)}
    if levels[bad].worse - levels[good].worse <= (margin if levels[bad].share else math.log1p(margin)):
        raise UserError(
            f"{short(bad)} is not worse than {short(good)}: {levels[bad].text} against {levels[good].text}, by less "
            f"than --margin {100 * margin:g}%"
        )
    limit = (levels[good].worse + levels[bad].worse) / 2
    verdicts = {good: f"good {levels[good].text}", bad: f"worse {levels[bad].text}"}
    goods, skipped = [good], set[str]()
    while following := next((c for c in candidates(goods, bad) if c not in skipped), ""):
        found = measure(following)
        if isinstance(found, Cannot):
            skipped.add(following)
            verdicts[following] = f"skipped: {found.why}"
        elif found.worse > limit:
            bad = following
            verdicts[following] = f"worse {found.text}"
        else:
            goods.append(following)
            verdicts[following] = f"good {found.text}"
        tell(f"{short(following)} {verdicts[following]}")
    return Found([bad, *(c for c in candidates(goods, bad) if c in skipped)], verdicts)


def candidates(goods: list[str], bad: str) -> list[str]:
    """Commits that may be the first worse one, without `bad` itself, the best bisection point first."""
    given = git("rev-list", "--bisect-all", bad, *(f"^{good}" for good in goods)).decode().splitlines()
    return [commit for commit in (line.split(" ")[0] for line in given) if commit != bad]


def between(good: str, bad: str) -> tuple[str, str]:
    """Full hashes of two commits; UserError unless both exist and the first is an ancestor of the second."""
    first, last = commit_of(good), commit_of(bad)
    if git("merge-base", first, last).decode().strip() != first:
        raise UserError(f"{good} is not an ancestor of {bad}: give the good commit first, then a descendant of it")
    if first == last:
        raise UserError(f"{good} and {bad} are the same commit")
    return first, last


def short(commit: str) -> str:
    """Abbreviated hash and subject of a commit."""
    return git("show", "--no-patch", "--format=%h %s", commit).decode(errors="replace").strip()


def _ends(commit: str, measure: Callable[[str], Measurement | Cannot], tell: Tell) -> Measurement:
    """Measurement of one of the two given commits; UserError when it cannot be measured."""
    found = measure(commit)
    if isinstance(found, Cannot):
        raise UserError(f"{short(commit)} cannot be measured: {found.why}; give a commit that runs")
    tell(f"{short(commit)} {found.text}")
    return found
