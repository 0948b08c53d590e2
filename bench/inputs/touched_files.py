"""Files that were written while jobs ran that use them: nobody knows which content they used."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from uavbench.trajectories.source_files import told_apart, touched

Keys = Callable[[], Mapping[str, str]]
"""Computes the content hash of every job, by name."""
MOST_NAMED = 3


@dataclass(frozen=True)
class Touched:
    """Files that were written since jobs were planned, and the names of the jobs that they are inputs of."""

    files: tuple[Path, ...] = ()
    jobs: frozenset[str] = frozenset()

    def __str__(self) -> str:
        """The names of the first files."""
        names = ", ".join(path.name for path in self.files[:MOST_NAMED])
        return names + (f" and {len(self.files) - MOST_NAMED} more" if len(self.files) > MOST_NAMED else "")


def touched_since(planned: Mapping[str, str], keys: Keys, done: Iterable[str]) -> Touched:
    """The jobs among those done whose inputs were written since `planned`; keys: computes these hashes again.

    A file that was changed and changed back counts, too.
    """
    files = touched()
    if not files:
        return Touched()
    now = keys()
    with told_apart(files):
        apart = keys()
    jobs = frozenset(name for name in done if not planned[name] == now[name] == apart[name])
    return Touched(tuple(sorted(files)), jobs) if jobs else Touched()
