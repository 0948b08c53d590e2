"""File lists of folders written by uavbench: names and digests in a sealed JSON file of the folder, its marker.

A marker alone is no proof: it may have been copied to another folder, and a file edited since.
"""

import hashlib
import json
import stat
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from os import scandir
from pathlib import Path
from typing import Any

from uavbench.trajectories.files.seals import seal, sealed_kind

KEYS = ("files", "sha256", "before")
"""Keys of a marker that hold digests by name: its own list, a manifest, and the list that it replaces."""
SEALED = "sealed"
"""Placeholder for the digest of a file with its own seal, whose bytes may differ between runs."""


@dataclass(frozen=True)
class Marker:
    """The name of the JSON file that lists the files of a folder, and the kind of the folder, as in a seal."""

    name: str
    kind: str


@dataclass(frozen=True)
class Listed:
    """Content of a sealed marker: by name, the digests that a file may have, and the targets of links; its kind."""

    files: Mapping[str, frozenset[str]] = field(default_factory=dict)
    links: Mapping[str, str] = field(default_factory=dict)
    kind: str = ""

    @classmethod
    def of(cls, folder: Path, marker: Marker) -> "Listed":
        """The list of a folder; empty where the seal of its marker is invalid or of another kind."""
        path = folder / marker.name
        return cls.read(path) if sealed_kind(path) == marker.kind else cls()

    @classmethod
    def read(cls, path: Path) -> "Listed":
        """The list of a marker of any kind; empty where its seal is invalid."""
        kind = sealed_kind(path)
        if kind is None:
            return cls()
        about = json.loads(path.read_text(encoding="utf-8"))
        tables = [
            {name: digest for name, digest in about[key].items() if isinstance(digest, str)}  # stamps are no digests
            for key in KEYS
            if isinstance(about.get(key), dict)
        ]
        names = {name for table in tables for name in table}
        files = {name: frozenset(table[name] for table in tables if name in table) for name in names}
        return cls(files, about.get("links", {}), kind)

    def holds(self, folder: Path, name: str) -> bool:
        """Whether the file of a name in the folder is unchanged since it was written."""
        path = folder / name
        try:
            if path.is_symlink():
                return self.links.get(name) == str(path.readlink())
            if name not in self.files or not stat.S_ISREG(path.lstat().st_mode):
                return False
            digests = self.files[name]
            return (SEALED in digests and sealed_kind(path) == self.kind) or file_digest(path) in digests
        except OSError:  # missing, or not readable by this user
            return False


def mark(folder: Path, marker: Marker) -> None:
    """List the files of a folder in its marker, and seal it."""
    path = folder / marker.name
    about: dict[str, Any] = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    names = [name for name in tree(folder) if name != marker.name]
    about.pop("made_by", None)
    if "sha256" not in about:
        own = (name for name in names if not (folder / name).is_symlink())
        about["files"] = {
            name: SEALED if sealed_kind(folder / name) == marker.kind else file_digest(folder / name) for name in own
        }
    if links := {name: str((folder / name).readlink()) for name in names if (folder / name).is_symlink()}:
        about["links"] = links
    path.write_text(json.dumps(about, indent=1, sort_keys=True) + "\n", encoding="utf-8", newline="\n")
    seal(path, marker.kind)


def tree(folder: Path, under: str = "") -> Iterator[str]:
    """Relative names of everything but folders in a folder and below, sorted; links are not followed."""
    with scandir(folder) as entries:
        here = sorted(entries, key=lambda entry: entry.name)
    for entry in here:
        if entry.is_dir(follow_symlinks=False):
            yield from tree(Path(entry.path), f"{under}{entry.name}/")
        else:
            yield under + entry.name


def is_file_of(path: Path, digest: str) -> bool:
    """Whether this is a regular file with this digest."""
    return stat.S_ISREG(path.lstat().st_mode) and file_digest(path) == digest


def file_digest(path: Path) -> str:
    """sha256 of a file, in hexadecimal."""
    with path.open("rb") as handle:
        return hashlib.file_digest(handle, "sha256").hexdigest()
