"""Runs trackers for `uavbench compare`, one for each line of JSON: `python -m uavbench.bench.gate.track_server`.

Each version of the repository runs its own server, so the protocol must stay compatible with later versions.
"""

import json
import os
import sys
from pathlib import Path
from typing import Any

from uavbench.bench.config.plugin_models import Extra, own_plugins
from uavbench.bench.config.suite import start_of, tracker_of
from uavbench.bench.runner.tasks import Track
from uavbench.tracker.results import Results
from uavbench.tracker.run import KNOWN
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.sources.dependencies import sources


def track(ask: dict[str, Any]) -> dict[str, Any]:
    """Run one tracker and write its results; wall-clock time of each frame in ms, and that `start` was applied."""
    suite, out = Path(ask["suite"]), Path(ask["out"])
    plugins = own_plugins(ask["tracker"])
    if "not_from" in ask:
        expect_elsewhere(plugins, Path(ask["not_from"]))
    tracker = tracker_of(ask["tracker"], suite, plugins)
    start = start_of(ask["start"], suite, own_plugins(ask["start"])) if "start" in ask else KNOWN
    work = Track(ask["label"], tracker, ask["rate_hz"], ask["seed"], Path(ask["sequence"]), out, start)
    work(ask["content_hash"], lambda done, total: None)
    return {"total_ms": [row.stage_ms.get("total") for row in Results.load(out).rows], "started": True}


def expect_elsewhere(plugins: Extra, folder: Path) -> None:
    """UserError when a plug-in of this version was imported from a folder that is not this version's."""
    for kind, cls in plugins:
        for path in sorted(sources(cls.__module__)):
            if path.is_relative_to(folder):
                raise UserError(
                    f"{kind} is not this version's: {path} was imported; give its folder on PYTHONPATH, so that each "
                    "version's own can be found"
                )


def main() -> None:
    """Answer requests line by line; output of trackers goes to standard error."""
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    for line in sys.stdin:
        try:
            answer = track(json.loads(line))
        except Exception as error:  # reported to the other side, which goes on with the next
            answer = {"error": f"{type(error).__name__}: {error}"}
        answers.write(json.dumps(answer) + "\n")
        answers.flush()


if __name__ == "__main__":
    main()
