"""Checks of what users' paths plan: a vehicle that follows it, or a replayed record that is one motion."""

from copy import deepcopy
from typing import Any

import numpy as np

from uavbench.trajectories.camera_mount import Mount
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.obstacles import ObstacleMesh
from uavbench.trajectories.paths.reference import Guidance, Planned, Replay, VehicleState
from uavbench.trajectories.paths.registry import PATHS, PathSpec
from uavbench.trajectories.pose import Array
from uavbench.trajectories.record_columns import RECORD, RECORD_COLUMNS
from uavbench.trajectories.vehicle.geometric_control import REFERENCE_COLUMNS
from uavbench.trajectories.vehicle.quadrotor import STEP_S

MOST_YAW_RAD, FASTEST_RAD_S = 100.0, 2.0
"""Largest yaw of a plan in rad, 16 turns, unless it was wound up at this mean rate or slower; degrees have more."""
BLOCK, UNLIKE = 100, 0.3
"""Rows over which rates of a record are averaged, and the part of them by which the poses' may differ, and 1 cm/s.

Differences from row to row, as of poses between which a log was interpolated, are not those of smoothed rates.
"""
FEWEST = 2
COMPARED = 10
"""Rows of guidance step by step that are compared before the flight, the vehicle at rest; in flight all of them are."""
OF_THE_SEED = (
    "take all random numbers from the `rng` that it is given, and nothing from the clock, the order of a set, or an "
    "earlier call"
)


def plan(path: PathSpec, obstacles: ObstacleMesh, mount: Mount, rng: np.random.Generator) -> Guidance | Replay:
    """What a path plans; UserError for a user's plan that is not finite, not in rad, or not one motion.

    And for one that is another one each time, as then is each run of one seed.
    """
    if type(path) in PATHS.values():
        return path.plan(obstacles, mount, rng)
    found, again = (path.plan(obstacles, mount, deepcopy(rng)) for _ in range(2))
    _check(found)
    if type(found) is not type(again) or _bytes(found) != _bytes(again):
        raise UserError(f"plan gives another plan each time; {OF_THE_SEED}")
    if isinstance(found, Planned | Replay):
        return found
    return _GuidedTwice(*(path.plan(obstacles, mount, deepcopy(rng)) for _ in range(2)))


class _GuidedTwice:
    """A user's guidance step by step, whose rows are compared with those of a second plan throughout the flight."""

    def __init__(self, guidance: Any, again: Any) -> None:
        self._guidance, self._again = guidance, again
        self.warm_up: int = guidance.warm_up
        self.steps: int = guidance.steps

    def rows(self, first: int, count: int, state: VehicleState | None) -> Array:
        """Rows (count, 17) of the guidance; UserError where a second plan has others for the same states."""
        found = np.asarray(self._guidance.rows(first, count, state))
        if not np.array_equal(found, np.asarray(self._again.rows(first, count, state)), equal_nan=True):
            raise UserError(f"rows of its plan gives others each time, at {first * STEP_S:.3f} s; {OF_THE_SEED}")
        return found


def _bytes(found: Guidance | Replay) -> bytes:
    """Content of the table of a plan or a record, and of the first rows of an object that guides step by step."""
    if isinstance(found, Replay):
        return found.record.tobytes()
    if isinstance(found, Planned):
        return found.table.tobytes()
    start = np.asarray(found.rows(-found.warm_up, 1, None))
    if start.shape != (1, REFERENCE_COLUMNS):
        raise UserError(f"rows of its plan gives {start.shape} for 1 row; it takes (1, {REFERENCE_COLUMNS})")
    count = min(COMPARED, found.warm_up + found.steps)
    at_rest = VehicleState(start[0, :3].copy(), np.zeros(3), float(start[0, 9]))
    return start.tobytes() + np.asarray(found.rows(-found.warm_up, count, at_rest)).tobytes()


def _check(found: Any) -> None:
    if isinstance(found, Planned):
        table = _table("table of Planned", found.table, REFERENCE_COLUMNS)
        _check_yaw(table[:, 9])
    elif isinstance(found, Replay):
        _check_motion(_table("record of Replay", found.record, RECORD_COLUMNS))
    elif not all(hasattr(found, name) for name in ("warm_up", "steps", "rows")):
        raise UserError(
            f"plan gives a {type(found).__name__}; it takes a Planned, a Replay, or an object with warm_up, steps, rows"
        )


def _check_yaw(yaws: Array) -> None:
    """UserError for yaws (n,) that are in degrees; many turns, one after another, are yaws in rad."""
    most, wound = np.abs(yaws).max(), np.abs(yaws - yaws[0]).max()
    if most > MOST_YAW_RAD and (abs(yaws[0]) > MOST_YAW_RAD or wound > FASTEST_RAD_S * STEP_S * len(yaws)):
        raise UserError(f"its yaw reaches {most:.4g} rad; a plan has radians")


def _table(what: str, rows: Any, columns: int) -> Array:
    if not isinstance(rows, np.ndarray) or rows.ndim != 2 or rows.shape[1] != columns or len(rows) < FEWEST:
        shape = rows.shape if isinstance(rows, np.ndarray) else type(rows).__name__
        raise UserError(
            f"the {what} is {shape}; it takes (n, {columns}), n at least {FEWEST}, {1 / STEP_S:g} rows a second"
        )
    if not np.isfinite(rows).all():
        row = int(np.argmin(np.isfinite(rows).all(axis=1)))
        raise UserError(f"the {what} is not finite at row {row}, {row * STEP_S:.3f} s")
    return np.asarray(rows)


def _check_motion(record: Array) -> None:
    """UserError for a record whose velocities, accelerations or rates are not those of its poses."""
    q = record[:, RECORD["quaternions_wxyz"]]
    off = np.abs(np.linalg.norm(q, axis=1) - 1)
    if off.max() > 1e-3:
        row = int(np.argmax(off))
        raise UserError(f"the quaternion of row {row}, {row * STEP_S:.3f} s, is not of unit norm (1e-3)")
    turn = _times(_conjugate(q[:-1]), q[1:])  # in the body's axes, as rates are
    turned = 2 * turn[:, 1:] * np.sign(turn[:, :1]) / STEP_S
    for name, of, derived in (
        ("velocities_m_s", "positions", _differences(record[:, RECORD["positions_m"]])),
        ("accelerations_m_s2", "velocities", _differences(record[:, RECORD["velocities_m_s"]])),
        ("angular_velocities_rad_s", "quaternions", turned),
    ):
        given = record[:, RECORD[name]]
        between = (given[1:] + given[:-1]) / 2
        size, unlike = (float(np.sqrt(np.mean(np.sum(_smooth(v) ** 2, axis=1)))) for v in (derived, derived - between))
        if unlike > UNLIKE * size + 0.01:
            raise UserError(
                f"{name} of its record are not the derivatives of its {of}: {unlike:.3g} off (rms), of {size:.3g}; "
                "sensors and blur would contradict the poses"
            )


def _smooth(values: Array) -> Array:
    """Means of values (n, 3) over blocks of rows; those of the last, shorter one are left out."""
    rows = min(BLOCK, len(values))
    return np.asarray(values[: len(values) // rows * rows].reshape(-1, rows, 3).mean(axis=1))


def _differences(values: Array) -> Array:
    return np.asarray(np.diff(values, axis=0) / STEP_S)


def _conjugate(q: Array) -> Array:
    return q * [1.0, -1.0, -1.0, -1.0]


def _times(a: Array, b: Array) -> Array:
    """Products (n, 4) of quaternions wxyz (n, 4)."""
    (w, v), (s, u) = ((q[:, :1], q[:, 1:]) for q in (a, b))
    return np.hstack([w * s - np.sum(v * u, axis=1, keepdims=True), w * u + s * v + np.cross(v, u)])
