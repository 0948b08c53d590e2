"""What a run saw and gave, as a hash: equal for runs that only repeat each other."""

import hashlib
import json

from uavbench.reports.scoring.score import Score

TIMED = ("latency", "deadline_misses", "replay")
"""Parts of a score that differ from run to run of the same program on the same frames."""
NAMES = ("label", "rate_hz", "seed", "sequence", "errors", "record")


def seen(score: Score) -> str | None:
    """Hash of a score's frames and numbers; None where the digests of its images are unknown."""
    images = score.record.get("sequence", {}).get("images")
    numbers = {name: value for name, value in score.to_json().items() if name not in (*TIMED, *NAMES)}
    text = json.dumps([images, numbers], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest() if images else None
