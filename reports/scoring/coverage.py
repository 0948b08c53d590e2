"""Coverage, success, failures and recovery of a tracker.

Conventions: a frame is a success within 5 cm and 5 deg; a failure begins at a frame without success after a success (or
at the first frame), and ends at the next success.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.reports.metrics.frame_errors import FrameErrors, ended_s
from uavbench.trajectories.pose import Array

AUC_LIMIT_M = 0.10


@dataclass(frozen=True, kw_only=True)
class Tracking:
    """Coverage, success and failures of a run; shares of all expected frames, from 0 to 1.

    coverage: frames with a pose; success: frames within 5 cm and 5 deg; success_auc: area under the success curve from
    0 to 10 cm, over 10 cm. time_to_first_loss_s: None without a failure; time_to_recover_s: mean over the failures that
    end, None without any.
    """

    frames: int
    with_pose: int
    coverage: float
    success: float
    success_auc: float
    failures: int
    failures_per_minute: float
    time_to_first_loss_s: float | None
    time_to_recover_s: float | None
    longest_failure_s: float
    duration_s: float = 0.0


def tracking(errors: FrameErrors) -> Tracking:
    """Tracking measures of a run."""
    success, seconds = errors.success, errors.seconds
    begins, ends = failures(success)
    ended = ends < len(success)
    until = np.append(seconds, ended_s(seconds))
    lasted = until[ends] - seconds[begins]
    duration_s = float(until[-1] - seconds[0])
    return Tracking(
        frames=len(errors),
        with_pose=int(errors.ok.sum()),
        coverage=float(errors.ok.mean()),
        success=float(success.mean()),
        success_auc=success_auc(errors.translation_m),
        failures=len(begins),
        failures_per_minute=60.0 * len(begins) / duration_s if duration_s > 0 else float(len(begins)),
        time_to_first_loss_s=float(seconds[begins[0]]) if len(begins) else None,
        time_to_recover_s=float(lasted[ended].mean()) if ended.any() else None,
        longest_failure_s=float(lasted.max(initial=0.0)),
        duration_s=duration_s,
    )


class Failures(NamedTuple):
    """Rows of failures (k,): first one of each, and that of the success that ends it (n where none does)."""

    first: NDArray[np.int64]
    ended: NDArray[np.int64]


def failures(success: NDArray[np.bool_]) -> Failures:
    """Failures of a run, from the success (n,) of its frames."""
    edge = np.diff(np.concatenate([[False], ~success, [False]]).astype(np.int8))
    return Failures(np.flatnonzero(edge == 1), np.flatnonzero(edge == -1))


def success_curve(translation_m: Array, limits_m: Array) -> Array:
    """Share (k,) of all frames with an error (n,) within each limit (k,); errors are infinite without a pose."""
    return np.searchsorted(np.sort(translation_m), limits_m, side="right") / len(translation_m)


def success_auc(translation_m: Array, limit_m: float = AUC_LIMIT_M) -> float:
    """Area under the success curve from 0 to a limit, over the limit, from 0 to 1 (best)."""
    return float(np.clip(1.0 - translation_m / limit_m, 0.0, 1.0).mean())
