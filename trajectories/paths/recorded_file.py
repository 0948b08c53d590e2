"""Plausibility of a recorded flight: the unit of its stamps, the order of its quaternions, the axes of its body."""

from pathlib import Path

import numpy as np

from uavbench.trajectories.errors import UserError
from uavbench.trajectories.pose import Array
from uavbench.trajectories.trajectory import Trajectory
from uavbench.trajectories.trajectory_files.formats import TUM_VALUES
from uavbench.trajectories.trajectory_files.named_columns import names_all_columns
from uavbench.trajectories.trajectory_files.number_lines import cells_of, comments, first_lines

LEAST_GAP_NS = 100_000
"""Median gap of stamps below which they are in another unit: no system records poses at more than 10,000 Hz."""
FASTEST_M_S = 200.0
"""Speed between two poses from which positions are in another unit, or one of them is an outlier: the fastest
quadrotors reach 160 m/s."""
LARGEST_TILT = {"body": np.radians(90.0), "camera": np.radians(120.0)}
"""Largest median tilt in rad, by `frame`, of a vehicle that flies: one whose camera looks down may have no mount."""
DOUBTFUL_TILT, UPRIGHT = np.radians(30.0), 1 / 3
"""Median tilt in rad of a body from which, with the quaternions in the other order, this fraction of it is believed."""


def check_order_is_known(file: Path) -> None:
    """UserError for a file recognized as EuRoC's by its stamps alone, since its quaternions may be w last as in TUM's.

    Tools write nanoseconds before the poses of a TUM file, too: eight values, separated by blanks.
    """
    line = first_lines(file, 1)[0][1]
    if len(cells_of(line)) == TUM_VALUES and "," not in line and not names_all_columns(comments(file)):
        raise UserError(
            f"{file}: its stamps are nanoseconds, as in EuRoC's format, whose quaternions are w first: set "
            'format = "euroc" if these are, else write the stamps in seconds, as in TUM\'s format'
        )


def check_stamps(file: Path, format: str, given: Trajectory) -> None:
    """UserError for stamps so close together that they are in another unit than the format has them."""
    gap_ns = int(np.median(np.diff(given.stamps_ns)))
    if gap_ns < LEAST_GAP_NS:
        unit = {"tum": "seconds", "euroc": "nanoseconds"}.get(format, "times")
        raise UserError(
            f"{file}: its poses would be {gap_ns:,} ns apart, their stamps read as {unit} of the format {format}; "
            "write seconds (tum) or nanoseconds (euroc)"
        )


def check_speed(file: Path, given: Trajectory) -> None:
    """UserError for poses between which no vehicle moves, as of a tracking system that lost its markers."""
    moved_m = np.linalg.norm(np.diff(given.positions_m, axis=0), axis=1)
    took_s = np.diff(given.stamps_ns) / 1e9
    row = int(np.argmax(moved_m / took_s))
    if moved_m[row] > FASTEST_M_S * took_s[row]:
        raise UserError(
            f"{file}: from pose {row} to pose {row + 1}, counted from 0, it moves {moved_m[row]:.3g} m in "
            f"{took_s[row]:.3g} s, faster than any vehicle; write metres, and leave out poses that are outliers"
        )


def check_upright(file: Path, frame: str, body: Trajectory) -> None:
    """UserError for poses of a body that is upside down, or upright only with its quaternions in the other order."""
    q = body.quaternions_wxyz
    tilt = _median_tilt(q)
    otherwise = min(_median_tilt(q[:, [1, 2, 3, 0]]), _median_tilt(q[:, [3, 0, 1, 2]]))
    doubtful = frame == "body" and tilt > DOUBTFUL_TILT and otherwise < UPRIGHT * tilt
    if tilt > LARGEST_TILT[frame] or doubtful:
        raise UserError(
            f"{file}: the vehicle is tilted by {np.degrees(tilt):.0f} degrees (median); quaternions are w last in tum, "
            "w first in euroc, a body's z axis points up, a camera's forward; convert the poses, or give the mount of "
            "the camera, of one that is upside down roll_deg = 180"
        )


def _median_tilt(quaternions_wxyz: Array) -> float:
    """Median angle in rad between the z axes of rotations (n, 4) and of the world."""
    return float(np.median(2 * np.arcsin(np.clip(np.hypot(*quaternions_wxyz[:, 1:3].T), 0.0, 1.0))))
