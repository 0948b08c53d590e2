"""Files that were written while jobs or commands used them: nobody knows which content they used."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from uavbench.trajectories.errors import UserError
from uavbench.trajectories.sources.digests import stamp, told_apart, touched

Keys = Callable[[], Mapping[str, str]]
"""Computes the content hash of every job, by name."""
MOST_NAMED = 3


@dataclass(frozen=True)
class Touched:
    """Files that were written since jobs were planned, and the names of the jobs that they are inputs of."""

    files: tuple[Path, ...] = ()
    jobs: frozenset[str] = frozenset()

    def __str__(self) -> str:
        return first_names(self.files)


@dataclass(frozen=True)
class Stamps:
    """Stamps of files that a command reads, taken before it does."""

    stamps: Mapping[Path, tuple[int, ...]]

    @classmethod
    def of(cls, paths: Iterable[Path]) -> "Stamps":
        """Those of the files among paths."""
        return cls({path: stamp(path) for path in paths if path.is_file()})

    def expect_unchanged(self, therefore: str) -> None:
        """UserError when a file was written or removed since, with what follows from it."""
        changed = sorted(path for path, then in self.stamps.items() if not path.is_file() or stamp(path) != then)
        if changed:
            raise UserError(f"changed while it was in use: {first_names(changed)}; {therefore}")


def first_names(files: Sequence[Path]) -> str:
    """Names of the first files, and the number of the others."""
    names = ", ".join(path.name for path in files[:MOST_NAMED])
    return names + (f" and {len(files) - MOST_NAMED} more" if len(files) > MOST_NAMED else "")


def touched_since(planned: Mapping[str, str], keys: Keys, done: Iterable[str]) -> Touched:
    """The jobs among those done whose inputs were written since `planned`; keys: computes these hashes again.

    A file that was changed and changed back counts, too. Files of other work of this process, as an earlier suite of a
    script, are not named.
    """
    files = touched()
    if not files:
        return Touched()
    now = keys()
    with told_apart(files) as asked:
        apart = keys()
    jobs = frozenset(name for name in done if not planned[name] == now[name] == apart[name])
    return Touched(tuple(sorted(asked or files)), jobs) if jobs else Touched()
