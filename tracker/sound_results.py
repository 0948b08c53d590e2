"""Validation of results before scoring: frames with invalid poses count as lost and are reported."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from uavbench.tracker.protocol import TrackResult
from uavbench.tracker.results import Results
from uavbench.tracker.run import within_reach
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.limits import LARGEST_COORDINATE_M
from uavbench.trajectories.pose import Array

MAX_REPORTED = 5
"""Most frames that are reported individually."""


class SoundResults(NamedTuple):
    """Valid results, and messages on what was removed, by frame."""

    results: Results
    left_out: tuple[str, ...]


def sound(results: Results) -> SoundResults:
    """The results without invalid poses and covariances, and messages on what was removed, by frame.

    A frame whose pose is not finite or beyond LARGEST_COORDINATE_M is lost; a covariance that is not finite, beyond the
    square of that, or has a negative variance is removed. UserError when the record lacks a key that scoring needs.
    """
    if missing := [key for key in ("tracker", "rate_hz", "seed", "cam_from_body") if key not in results.record]:
        raise UserError(f"record.json: `{missing[0]}` is missing; track again")
    messages: list[str] = []
    rows: list[TrackResult] = []
    for frame, row in zip(results.frames.tolist(), results.rows, strict=True):
        if row.cam_from_world is not None and not within_reach(row.cam_from_world):
            messages.append(
                f"frame {frame}: its pose is not finite or beyond {LARGEST_COORDINATE_M:g} m: counted as lost"
            )
            row = TrackResult(status="lost", stage_ms=row.stage_ms)
        elif row.covariance is not None and not is_covariance(row.covariance):
            messages.append(f"frame {frame}: its covariance is not finite, too large or negative: left out")
            row = replace(row, covariance=None)
        rows.append(row)
    more = (f"and {len(messages) - MAX_REPORTED} more such frames",) if len(messages) > MAX_REPORTED else ()
    return SoundResults(
        (replace(results, rows=tuple(rows)) if messages else results), (*messages[:MAX_REPORTED], *more)
    )


def is_covariance(covariance: Array) -> bool:
    """Whether a matrix (6, 6) can be a covariance; it may be singular."""
    return bool(np.abs(covariance).max() <= LARGEST_COORDINATE_M**2 and (np.diag(covariance) >= 0).all())
