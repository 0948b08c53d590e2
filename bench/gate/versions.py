"""Checkouts of versions of a git repository, each in its own folder, in which its trackers can run.

Tracked files are those of the version. Untracked ones (environments, weights, build products) are linked from the
working tree into each checkout, so they are the same for all versions; they are reported.
"""

import os
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from uavbench.bench.inputs.file_paths import FREE, names_a_file
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.processes.guard import Guard

WORKING = "."
"""Name of the working tree among versions."""
OWN = Path(__file__).parents[3]
UNTOUCHED = (
    "core.sparseCheckout=false",
    "core.splitIndex=false",
    "core.fsmonitor=false",
    "core.hooksPath=/dev/null",
)
"""Settings of git without which a checkout would be partial, write into the repository, or run its hooks."""
SERVER = Path("src/uavbench/bench/gate/track_server.py")


@dataclass(frozen=True)
class Version:
    """One version: its name, its folder, and the top folder of its repository.

    linked: what is not in git, relative to the top; empty for the working tree itself.
    """

    commit: str
    folder: Path
    top: Path
    linked: tuple[str, ...] = ()

    @property
    def is_ours(self) -> bool:
        """Whether the repository contains uavbench itself."""
        return (self.top / SERVER).is_file()

    def of(self, path: Path) -> Path:
        """The path in this version that corresponds to one of the repository; paths outside of it are unchanged."""
        plain = Path(os.path.normpath(path))
        return self.folder / plain.relative_to(self.top) if plain.is_relative_to(self.top) else path

    def keeps(self, path: Path) -> bool:
        """Whether a path is tracked by git in this version, rather than linked from the working tree."""
        if not path.is_relative_to(self.top) or path.is_relative_to(sys.prefix):
            return False
        return not any(path.is_relative_to(self.top / name) for name in self.linked)

    def environment(self, roots: list[Path]) -> dict[str, str]:
        """Environment in which Python finds this version's modules before those of the working tree.

        roots: further folders from which plug-ins are imported.
        """
        given = [Path(place).absolute() for place in os.environ.get("PYTHONPATH", "").split(os.pathsep) if place]
        paths = [*given, *(Path(place).absolute() for place in sys.path), *roots]
        inside = [path for path in paths if path.is_relative_to(self.top) and not path.is_relative_to(sys.prefix)]
        ours = [self.folder / "src"] if self.is_ours else []
        running = [] if ours or "site-packages" in OWN.parts else [OWN]
        search = [*ours, *map(self.of, inside), *(p for p in given if not p.is_relative_to(self.top)), *running]
        free = [Path(place).resolve() for place in os.environ.get(FREE, "").split(os.pathsep) if place]
        allowed = [self.folder, self.top, *free]
        variables = {"PYTHONPATH": search, FREE: allowed}
        return {
            **os.environ,
            **{name: os.pathsep.join(dict.fromkeys(map(str, each))) for name, each in variables.items()},
        }


@dataclass(frozen=True)
class Placed:
    """A tracker's table with its files replaced by those of a version.

    missing: tracked files of the working tree that are not in the version; own: whether any of its files is tracked.
    """

    table: dict[str, Any]
    missing: tuple[str, ...]
    own: bool


@contextmanager
def version(ref: str) -> Iterator[Version]:
    """A version of the repository that the current folder is in; `.` is the working tree as it stands."""
    top = Path(git("rev-parse", "--show-toplevel").decode().rstrip("\n"))
    if ref == WORKING:
        yield Version("working tree", top, top)
        return
    commit = commit_of(ref, "--short")
    with Guard("uavbench-version-") as guard:
        folder = guard.folder.resolve() / "tree"
        folder.mkdir()
        _check_out(commit, top, folder)
        yield Version(commit, folder, top, tuple(_link_untracked(folder, top)))


def placed(version: Version, table: dict[str, Any], beside: Path) -> Placed:
    """A tracker's table from a file in the folder `beside`, with files that it names replaced by those of a version.

    A word counts as a file if one of this name exists in the working tree or in the version.
    """
    beside = beside.resolve()
    missing: list[str] = []
    own = False

    def word(given: Any) -> Any:
        nonlocal own
        if not isinstance(given, str) or "\0" in given:
            return given
        path = Path(os.path.normpath(beside / given))
        there = version.of(path)
        if not path.is_relative_to(version.top) or not (path.is_file() or there.is_file()):
            return given
        if there.is_file():
            own = own or version.keeps(path)
            return str(there)
        missing.append(str(path.relative_to(version.top)))
        return given

    def walk(value: Any, key: str) -> Any:
        if isinstance(value, dict):
            return {name: walk(inner, name) for name, inner in value.items()}
        if isinstance(value, list):
            return [walk(inner, key) for inner in value]
        return word(value) if names_a_file(key) or key in ("command", "input_files") else value

    return Placed(walk(table, ""), tuple(missing), own)


def _check_out(commit: str, top: Path, folder: Path) -> None:
    """Write all tracked files of a commit into an empty folder; nothing of the repository at `top` changes.

    `git archive` would leave out those with the attribute `export-ignore`, and change those with `export-subst`.
    """
    own = git("-C", str(top), "rev-parse", "--absolute-git-dir").decode().rstrip("\n")
    places = {"GIT_DIR": own, "GIT_WORK_TREE": str(folder), "GIT_INDEX_FILE": str(folder.with_name("index"))}
    settings = [word for setting in UNTOUCHED for word in ("-c", setting)]
    plain = ["read-tree", "--no-recurse-submodules", "-m", "-u", commit]
    git("-C", str(folder), *settings, *plain, environment={**os.environ, **places})


def _link_untracked(folder: Path, top: Path) -> Iterator[str]:
    """Link the untracked files of the working tree into a version's folder; their names."""
    listed = git("-C", str(top), "ls-files", "--others", "--directory", "-z").decode(errors="surrogateescape")
    for name in filter(None, listed.split("\0")):
        path = Path(name)
        if "__pycache__" in path.parts or os.path.lexists(folder / path):
            continue
        with suppress(OSError):  # the version has a file where the working tree has a folder
            (folder / path).parent.mkdir(parents=True, exist_ok=True)
            (folder / path).symlink_to(top / path)
            yield str(path)


def commit_of(ref: str, *options: str) -> str:
    """Hash of the commit that a ref names, with options of `git rev-parse`; UserError when it names none."""
    try:
        return git("rev-parse", *options, "--verify", "--end-of-options", f"{ref}^{{commit}}").decode().strip()
    except UserError:
        git("rev-parse", "--git-dir")  # tells that there is no repository, or no git
        raise UserError(f"{ref!r} is no commit of this repository; `git log --oneline` lists them") from None


def git(*arguments: str, environment: Mapping[str, str] | None = None) -> bytes:
    """Output of git; UserError with git's message when it fails."""
    try:
        done = subprocess.run(["git", *arguments], capture_output=True, check=True, env=environment)
    except FileNotFoundError:
        raise UserError("git is not installed: versions of a repository need it") from None
    except subprocess.CalledProcessError as error:
        words = error.stderr.decode(errors="replace").strip().splitlines()
        shown = (word for word in arguments if word not in ("-C", "-c", *UNTOUCHED) and not word.startswith(os.sep))
        command = " ".join(shown)
        raise UserError(f"git {command}: {words[-1] if words else 'failed'}") from None
    return done.stdout
