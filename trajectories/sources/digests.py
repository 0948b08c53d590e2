"""Digests of files by their content, and which files a digest was asked of: what a result was made of."""

import hashlib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path

_digested: dict[Path, tuple[int, ...]] = {}
"""Every file of which a digest was asked, with its stamp at that time."""

_asking: list[set[Path]] = []
"""Files of which a digest was asked since, for each context that collects them."""

_told_apart: dict[Path, set[Path]] = {}
"""Files whose digests are told apart, with the set of those that were asked for since."""


def digest(files: Iterable[Path]) -> str:
    """sha256 over the names and contents of files and the names of their folders, not over the tree's location."""
    each = sorted(("/".join(path.parts[-2:]), _content(path)) for path in files)
    return hashlib.sha256(repr(each).encode()).hexdigest()


def file_digest(path: Path) -> str:
    """sha256 of a file's content, read again only when the file has changed; OSError when it cannot be read."""
    ask((path,))
    now = stamp(path)
    _digested[path] = now
    found = _digest(path, now)
    if path in _told_apart:
        _told_apart[path].add(path)
        return f"{found} told apart"
    return found


def touched() -> frozenset[Path]:
    """Files that were written or removed since their last digest, even where they have the same content again."""
    return frozenset(path for path, then in _digested.items() if _stamp_or_none(path) != then)


@contextmanager
def told_apart(paths: Iterable[Path]) -> Iterator[set[Path]]:
    """Context in which the digests of these files differ from those of their content: those that are asked for in it.

    A file that was removed has no digest, and is not among these.
    """
    asked: set[Path] = set()
    _told_apart.update(dict.fromkeys(paths, asked))
    try:
        yield asked
    finally:
        _told_apart.clear()


@contextmanager
def asked_for() -> Iterator[set[Path]]:
    """Context that collects the files of which a digest is asked in it."""
    _asking.append(set())
    try:
        yield _asking[-1]
    finally:
        _asking.pop()


def ask(paths: Iterable[Path]) -> None:
    """Count files as asked for, whose digests are known from before."""
    for asked in _asking:
        asked.update(paths)


def stamp(path: Path) -> tuple[int, ...]:
    """Stamp that changes with a file: modification times, size and inode."""
    about = path.stat()
    return about.st_mtime_ns, about.st_ctime_ns, about.st_size, about.st_ino, about.st_dev


def _stamp_or_none(path: Path) -> tuple[int, ...] | None:
    try:
        return stamp(path)
    except OSError:
        return None


def _content(path: Path) -> str:
    try:
        return file_digest(path)
    except OSError:
        return "not readable"


@lru_cache(maxsize=100_000)
def _digest(path: Path, _: tuple[int, ...]) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
