"""Likely mistakes in true poses of one's own that they tell by themselves: their times, and rows nobody measured."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from uavbench.reports.evaluation.doubts.plausibility import (
    FASTEST_NS,
    MARKERS_LOST,
    MOVED,
    REPEATED,
    SECOND_NS,
    SLOWEST_NS,
    doubts_of_origin,
)
from uavbench.reports.evaluation.gaps import usual_step_ns
from uavbench.tracker.images.image_names import doubts_of_counts, doubts_of_order
from uavbench.tracker.images.image_times import doubts_of_own_times
from uavbench.trajectories.trajectory import Trajectory


def doubts_of_poses(name: str, poses: Trajectory) -> Iterator[str]:
    """A sentence where poses fall back to the origin, or stay at one pose and go on elsewhere; name: of their file."""
    yield from doubts_of_origin(f"ground truth {name}", poses, MARKERS_LOST)
    rows = np.hstack([poses.positions_m, poses.quaternions_wxyz])
    starts = np.r_[0, np.flatnonzero((rows[1:] != rows[:-1]).any(axis=1)) + 1]
    counts = np.diff(np.r_[starts, len(rows)])
    steps_m = np.linalg.norm(np.diff(poses.positions_m[starts], axis=0), axis=1)  # from each pose to the next other one
    if not len(steps_m):
        return
    held = (counts[:-1] > REPEATED) & poses.positions_m[starts[:-1]].any(axis=1)
    lost = np.flatnonzero(held & (steps_m > MOVED * np.median(steps_m)))
    if len(lost):
        yield (
            f"the ground truth {name} stays at one pose, to the last digit, in {counts[lost].sum()} of {len(rows)} "
            f"poses, and goes on elsewhere, as from {poses.stamps_ns[starts[lost[0]]] / SECOND_NS:.3f} s on: "
            f"{MARKERS_LOST}? Remove these rows"
        )


def doubts_of_stamps(
    name: str, images: tuple[Path, ...], stamps_ns: NDArray[np.int64], rate_hz: float | None
) -> Iterator[str]:
    """A sentence where stamps (n,) of poses, by which images in order are stamped, are not likely to be theirs.

    rate_hz: that of the images where it is given, which tells that their unit is right.
    """
    step_ns = usual_step_ns(stamps_ns)
    if rate_hz is None and not FASTEST_NS < step_ns < SLOWEST_NS and len(stamps_ns) > 1:
        yield (
            f"{name}: its poses are {step_ns / SECOND_NS:.2g} s apart, and so are the images: are its stamps in "
            "another unit than that of their format (TUM: seconds, EuRoC: nanoseconds)? Correct them, or give rate_hz"
        )
    elif rate_hz is None and len(stamps_ns) > 2 and (np.diff(stamps_ns) == SECOND_NS).all():
        yield (
            f"{name}: its poses are a second apart, and so are the images: are its stamps numbers of frames? Write "
            "their times, or give rate_hz"
        )
    yield from doubts_of_order(images) or doubts_of_counts(images, stamps_ns, name)
    yield from doubts_of_own_times(images[0].parent, stamps_ns, name)
