"""The sides of a comparison: one version's trackers, from its own tree, and the process that runs them."""

import json
import os
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from uavbench.bench.config.plugin_models import import_plugin
from uavbench.bench.config.suite import load_suite
from uavbench.bench.config.suite_files import SUITES
from uavbench.bench.gate.versions import Version, placed
from uavbench.bench.inputs.command_files import editable_folders
from uavbench.bench.inputs.content_hash import content_hash
from uavbench.bench.runner.executors import PACKAGES
from uavbench.trajectories.errors import UserError, plain
from uavbench.trajectories.files.reading import read_toml
from uavbench.trajectories.processes.guard import Talk, talk
from uavbench.trajectories.sources.digests import digest

MOST_TOLD = 8
"""Most names of untracked files that are reported; the rest are counted."""


@dataclass(frozen=True)
class Side:
    """One version to compare: its trackers' tables by label, and why others cannot run.

    suite: the file of its suite; foreign: labels of trackers whose program or plug-in is not in git.
    """

    version: Version
    suite: Path
    tables: Mapping[str, dict[str, Any]]
    unknown: Mapping[str, str]
    foreign: tuple[str, ...]
    server: Talk

    def track(self, label: str, ask: dict[str, Any]) -> dict[str, Any]:
        """The server's answer to a request to run a tracker; UserError when it has ended or cannot do this."""
        commit = self.version.commit
        asked = {**ask, "label": label, "suite": str(self.suite), "tracker": self.tables[label]}
        if self.version.folder != self.version.top:
            asked["not_from"] = str(self.version.top)
        try:
            self.server.asks.write(json.dumps(asked, default=str) + "\n")
            self.server.asks.flush()
            answer: dict[str, Any] = json.loads(self.server.answers.readline())
        except (OSError, ValueError):
            raise UserError(
                f"version {commit} cannot run trackers for comparison: it ended, or has no bench/gate/track_server.py"
            ) from None
        if "start" in ask and "error" not in answer and not answer.get("started"):
            raise UserError(f"version {commit} is too old for a suite with `start`; leave it out to compare with it")
        if "error" in answer:
            answer["error"] = plain(str(answer["error"]))
        return answer


@contextmanager
def at_work(version: Version, file: Path, labels: list[str]) -> Iterator[Side]:
    """Context with a version's server process for these trackers of the suite, of its own `file` if it has one."""
    suite = file_of(version, file)
    tables = trackers_in(suite)
    mine = {label: placed(version, tables[label], file.parent) for label in labels if label in tables}
    unknown = {label: f"{suite}: no tracker of this name" for label in labels if label not in tables}
    unknown |= {label: f"{each.missing[0]} is not in {version.commit}" for label, each in mine.items() if each.missing}
    roots = {label: _roots(tables[label], each.table) for label, each in mine.items()}
    places = [root for found in roots.values() for root in found]
    external = {label for label, each in mine.items() if each.table.get("kind") == "external"}
    own = {label for label, found in roots.items() if any(map(version.keeps, found))}
    own |= {label for label in external if mine[label].own}
    foreign = tuple(label for label, found in roots.items() if (found or label in external) and label not in own)
    placed_tables = {label: each.table for label, each in mine.items()}
    command = [sys.executable, "-P", "-m", "uavbench.bench.gate.track_server"]
    with talk(command, version.environment(places), version.folder) as server:
        yield Side(version, suite, placed_tables, unknown, foreign, server)


def file_of(version: Version, file: Path) -> Path:
    """A version's own copy of a file; the given file if the version has none."""
    own = version.of(file)
    return own if own.is_file() else file


def keys_of(versions: Mapping[str, Version], file: Path) -> dict[str, str]:
    """Hash of what each tracker of the suite is made of in the working tree, if that is one of the versions."""
    working = [each for each in versions.values() if each.folder == each.top]
    keys: dict[str, str] = {}
    for each in working[:1]:
        ours = [path for name in PACKAGES for path in (each.top / name).rglob("*.py")] if each.is_ours else []
        code = digest(ours)
        keys = {label: content_hash(tracker, code) for label, tracker in load_suite(file).trackers.items()}
    return keys


def trackers_in(suite: Path) -> dict[str, dict[str, Any]]:
    """The tables of a suite's trackers, not validated; UserError naming an unreadable file."""
    try:
        tables: dict[str, dict[str, Any]] = read_toml(suite)["trackers"]
        assert all(isinstance(table, dict) for table in tables.values())
    except (KeyError, AttributeError, AssertionError) as error:
        raise UserError(f"{suite}: not a readable suite: {error}") from None
    return tables


def _roots(table: Mapping[str, Any], there: Mapping[str, Any]) -> list[Path]:
    """Folders from which a tracker's plug-in, or editable installs of its program's Python, are imported here.

    there: the table with its files replaced by those of a version.
    """
    if table.get("kind") != "external":
        return [root] if (root := plugin_root(table)) else []
    words = there.get("command")
    is_command = isinstance(words, list) and all(isinstance(word, str) for word in words)
    return editable_folders(words) if words and is_command else []


def plugin_root(table: Mapping[str, Any]) -> Path | None:
    """Folder from which a user's plug-in is imported here; None for uavbench's trackers, or if the import fails."""
    kind = table.get("kind")
    if not isinstance(kind, str) or ":" not in kind:
        return None
    with suppress(UserError):
        import_plugin(kind)
    module = sys.modules.get(kind.partition(":")[0].partition(".")[0])
    places = [*getattr(module, "__path__", ())] or [getattr(module, "__file__", None)]
    return Path(os.path.normpath(Path(places[0]).absolute())).parent if places[0] else None


def statements(sides: Mapping[str, Side], file: Path) -> Iterator[str]:
    """A line for each input that both sides share although it might be expected to differ between versions."""
    for name, side in sides.items():
        commit, top = side.version.commit, side.version.top
        if file.is_relative_to(top) and side.suite == file and side.version.folder != top:
            yield f"{name} {commit} has no {file.relative_to(top)}: its trackers are those of the working tree"
    linked = sorted({name for side in sides.values() for name in side.version.linked})
    if linked:
        more = f" and {len(linked) - MOST_TOLD} more" if len(linked) > MOST_TOLD else ""
        yield f"not in git, and so the same on both sides: {', '.join(linked[:MOST_TOLD])}{more}"
    if not any(file.is_relative_to(side.version.top) for side in sides.values()) and file.parent != SUITES:
        yield f"{file} lies outside of the repository: its tables are the same on both sides"
    for label in dict.fromkeys(label for side in sides.values() for label in side.foreign):
        yield f"{label}: nothing of its program or plug-in is in git: it is the same on both sides"
