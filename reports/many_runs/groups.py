"""Grouping of estimates by tracker, and pairing of runs between trackers."""

import os
import re
from collections.abc import Iterable, Mapping
from collections.abc import Sequence as ListOf
from dataclasses import dataclass
from fnmatch import translate
from glob import glob, has_magic
from pathlib import Path

from uavbench.trajectories.bags.reading import bag_topic
from uavbench.trajectories.errors import UserError

ALL = "estimate"
"""Name of the tracker when no groups are given."""
SPOKEN = 3
"""Most files that an error message names."""


@dataclass(frozen=True)
class Run:
    """One estimate: its tracker, its name among the tracker's runs, and its file."""

    group: str
    name: str
    path: Path


def grouped(estimates: ListOf[Path], groups: ListOf[str]) -> list[Run]:
    """Runs of estimates by groups `NAME=PATTERN`, in the given order of groups and files.

    PATTERN, a glob, matches among the estimates, and may add further files. A run is named by what the wildcards match,
    or by its file. UserError without any estimate, for a malformed group or one without files, for a file that is given
    twice or is in two groups, and for an estimate in no group.
    """
    for k, path in enumerate(estimates):
        if _place(path) in map(_place, estimates[:k]):
            raise UserError(f"{path}: is given twice; a run counts once")
    if not groups:
        if not estimates:
            raise UserError("name at least one estimate, or --group NAME=PATTERN")
        return _named({ALL: [(path, "") for path in estimates]})
    members: dict[str, list[tuple[Path, str]]] = {}
    owner: dict[str, str] = {}
    for spec in groups:
        name, pattern = _parsed(spec)
        found = _matching(pattern, estimates)
        if not found:
            raise UserError(f"--group {spec}: matches no file; patterns are as in a shell, such as 'orb/run*.tum'")
        for path, part in found:
            place = _place(path)
            if owner.setdefault(place, name) != name:
                raise UserError(f"{path}: is in the groups {owner[place]} and {name}; a run belongs to one tracker")
            if all(_place(known) != place for known, _ in members.get(name, ())):
                members.setdefault(name, []).append((path, part))
    left = [path for path in estimates if _place(path) not in owner]
    if left:
        more = f" (and {len(left) - SPOKEN} more)" if len(left) > SPOKEN else ""
        raise UserError(
            f"{', '.join(map(str, left[:SPOKEN]))}{more}: in no group; add --group NAME=PATTERN, or leave the file out"
        )
    return _named(members)


@dataclass(frozen=True)
class Pairing:
    """Runs that trackers have in common; rows: indices of each group's runs, in the same order; how: as a sentence."""

    rows: Mapping[str, ListOf[int]]
    how: str

    @property
    def n(self) -> int:
        """Number of paired runs."""
        return min((len(rows) for rows in self.rows.values()), default=0)


def pairing(names: Mapping[str, ListOf[str]]) -> Pairing:
    """Pairing of the runs of all groups: by equal names, else by order when all groups have as many runs."""
    if len(names) < 2:
        return Pairing({}, "one tracker: nothing to compare")
    common = [name for name in next(iter(names.values())) if all(name in others for others in names.values())]
    if common:
        most = max(len(runs) for runs in names.values())
        some = f"the {counted(len(common))} that all trackers have" if len(common) < most else counted(len(common))
        rows = {group: [runs.index(name) for name in common] for group, runs in names.items()}
        return Pairing(rows, f"{some}, paired by name")
    counts = {len(runs) for runs in names.values()}
    if len(counts) == 1:
        (count,) = counts
        rows = {group: list(range(count)) for group in names}
        return Pairing(rows, f"{counted(count)}, paired in the order given, since their names differ")
    return Pairing({}, "no paired test: the runs of the trackers differ in names and in number")


def counted(runs: int) -> str:
    """A number of runs as text, `1 run`."""
    return f"{runs} run{'s' if runs != 1 else ''}"


def _parsed(spec: str) -> tuple[str, str]:
    name, sign, pattern = (part.strip() for part in spec.partition("="))
    if not (name and sign and pattern):
        raise UserError(f"--group {spec}: write NAME=PATTERN, such as --group ORB='orb/run*.tum'")
    return name, str(Path(pattern.replace("[^", "[!")).expanduser())  # negation as in shells, unlike glob


def _matching(pattern: str, estimates: Iterable[Path]) -> list[tuple[Path, str]]:
    """Estimates and files that match a pattern, with what its wildcards match."""
    shape = re.compile(_expression(_place(Path(pattern))), re.DOTALL)
    chosen = [path for path in estimates if shape.fullmatch(_place(path))]
    known = {_place(path) for path in chosen}
    if has_magic(pattern):
        on_disk = [Path(name) for name in sorted(glob(pattern, recursive=True))]  # noqa: PTH207, absolute ones too
    else:
        there = Path(pattern).exists() or bag_topic(Path(pattern)) is not None
        on_disk = [Path(pattern)] if there else []
    chosen += [path for path in on_disk if _place(path) not in known]
    parts = ((path, shape.fullmatch(_place(path))) for path in chosen)
    return [(path, "-".join(filter(None, found.groups())) if found else "") for path, found in parts]


def _place(path: Path) -> str:
    """Absolute path without `.` and `..`; links are not followed."""
    return os.path.normpath(path.absolute())


def _expression(pattern: str) -> str:
    """Regular expression of a glob pattern, with a group per wildcard; only `**` matches `/`."""
    out = []
    for part in re.split(r"(\*\*/|\*+|\?|\[!?\]?[^\]]*\])", pattern):
        if part == "**/":
            out.append("(?:(.*?)/)?")
        elif part.startswith("*"):
            out.append("(.*?)" if part == "**" else "([^/]*?)")
        elif part == "?":
            out.append("([^/])")
        elif len(part) > 2 and part.startswith("["):
            out.append(f"({_one_of(part)})")
        else:
            out.append(re.escape(part))
    return "".join(out)


def _one_of(part: str) -> str:
    """Regular expression of one `[...]`, with the ranges of `glob`."""
    return translate(part).removeprefix("(?s:")[: -len(r")\Z")]


def _named(members: Mapping[str, ListOf[tuple[Path, str]]]) -> list[Run]:
    """Runs with names that are unique within each group and, if possible, shared between groups.

    Names are the matches of the wildcards, or the file names, or the paths.
    """
    schemes: list[dict[str, list[str]]] = [
        {group: [part for _, part in some] for group, some in members.items()},
        {group: [path.stem or str(path) for path, _ in some] for group, some in members.items()},
        {group: [str(path) for path, _ in some] for group, some in members.items()},
    ]
    plain = [names for names in schemes if all(_differ(of_group) for of_group in names.values())] or schemes[-1:]
    shared = [names for names in plain if set.intersection(*map(set, names.values()))]
    names = (shared or plain)[0]
    return [
        Run(group, name, path)
        for group, some in members.items()
        for name, (path, _) in zip(names[group], some, strict=True)
    ]


def _differ(names: ListOf[str]) -> bool:
    return all(names) and len({*names}) == len(names)
