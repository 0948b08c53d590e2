"""Runs trackers for `uavbench compare`, one for each line of JSON that comes in: `python -m bench.track_server`.

Each version of the repository runs its own; what goes in and out must stay readable by the next.
"""

import json
import os
import sys
from pathlib import Path
from typing import Any

from bench.config import tracker_of
from bench.models import own_plugins
from bench.works import Track
from tracker.results import Results


def track(ask: dict[str, Any]) -> dict[str, Any]:
    """Run one tracker and write its results; wall time of each frame in ms."""
    tracker = tracker_of(ask["tracker"], Path(ask["suite"]), own_plugins(ask["tracker"]))
    out = Path(ask["out"])
    work = Track(ask["label"], tracker, ask["rate_hz"], ask["seed"], Path(ask["sequence"]), out)
    work(ask["content_hash"], lambda done, total: None)
    return {"total_ms": [row.stage_ms.get("total") for row in Results.load(out).rows]}


def main() -> None:
    """Answer line by line; what trackers print goes to standard error."""
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    for line in sys.stdin:
        try:
            answer = track(json.loads(line))
        except Exception as error:  # told to the other side, which goes on with the next
            answer = {"error": f"{type(error).__name__}: {error}"}
        answers.write(json.dumps(answer) + "\n")
        answers.flush()


if __name__ == "__main__":
    main()
