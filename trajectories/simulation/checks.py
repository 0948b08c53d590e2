"""Feasibility checks of a flight: plan, collisions, saturated motors."""

import numpy as np

from uavbench.trajectories import reproducible_math as exact
from uavbench.trajectories.camera_mount import Mount
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.obstacles import ObstacleMesh
from uavbench.trajectories.paths.reference import Planned
from uavbench.trajectories.pose import Array, rotation_from_quaternion
from uavbench.trajectories.record_columns import RECORD
from uavbench.trajectories.vehicle.quadrotor import GRAVITY_M_S2, STEP_S, Quadrotor

STRIDE = 10
"""Stride in control steps at which a plan is checked: 20 ms."""
THRUST_SHARE = 0.9
"""Fraction of the maximum thrust that a plan may require; the rest is reserved for control."""
FARTHEST_M = 1e5
"""Largest coordinate of a plan, m: distances from meshes lose their digits beyond."""
ASTRAY_M = 0.1
"""Distance in m from its planned place from which a crash is told with it: the clearance that a plan keeps."""
OUT_OF_CONTROL = "lower the speed or wind, or check the airframe (lag, thrust, rotors) and the gains of `control`"


def check_plan(
    plan: Planned, vehicle: Quadrotor, obstacles: ObstacleMesh, mean_wind_m_s: Array, clearance_m: float
) -> None:
    """UserError when a plan leads too far, violates the clearance, or needs more thrust than the vehicle has."""
    places = plan.table[::STRIDE, 0:3]
    far = ~(np.abs(places) <= FARTHEST_M).all(axis=1)
    if far.any():
        step = int(np.argmax(far))
        x, y, z = places[step]
        raise UserError(
            f"t = {step * STRIDE * STEP_S:.2f} s, at ({x:.6g}, {y:.6g}, {z:.6g}) m: the plan leads farther than "
            f"{FARTHEST_M:g} m from the origin; give heights, distances and offsets in metres"
        )
    room = obstacles.clearance(places) - vehicle.radius_m
    worst = int(np.argmin(room))
    if room[worst] < clearance_m:
        at, what = _at(places[worst], worst * STRIDE), _obstacle(places[worst], obstacles)
        raise UserError(
            f"{at}: the vehicle (radius {vehicle.radius_m} m) has {room[worst]:.3f} m to {what}, "
            f"less than clearance_m = {clearance_m}; plan it further away"
        )
    needed = needed_thrusts(plan, vehicle, mean_wind_m_s)
    worst = int(np.argmax(needed))
    available = THRUST_SHARE * 4 * vehicle.max_thrust_n
    if not needed[worst] <= available:
        speed = float(np.linalg.norm(plan.table[worst, 3:6]))
        raise UserError(
            f"{_at(plan.table[worst, 0:3], worst)}: unreachable speed: {speed:.2f} m/s there, with its acceleration "
            f"and the mean wind, needs {needed[worst]:.3g} N of thrust, but {available:.3g} N is {THRUST_SHARE:.0%} of "
            "what the vehicle has; lower the speed, acceleration or wind"
        )


def needed_thrusts(plan: Planned, vehicle: Quadrotor, mean_wind_m_s: Array) -> Array:
    """Collective thrust (n,), N, that each row of a plan needs against gravity, inertia and drag.

    The drag is evaluated at the rotor speed of hover.
    """
    speeds = 4 * vehicle.rotor_speeds(np.array(vehicle.hover_thrust_n))
    airspeed = plan.table[:, 3:6] - mean_wind_m_s
    size = np.linalg.norm(airspeed, axis=1, keepdims=True)
    drag = -(vehicle.rotor_drag_kg.max() * speeds + vehicle.body_drag_kg_m.max() * size) * airspeed
    force = vehicle.mass_kg * (plan.table[:, 6:9] + np.array([0.0, 0.0, GRAVITY_M_S2])) - drag
    return np.asarray(np.linalg.norm(force, axis=1))


def crash_step(record: Array, vehicle: Quadrotor, obstacles: ObstacleMesh) -> int | None:
    """First row of a record at which the vehicle touches floor or structure, or is not finite; None for no crash."""
    places = record[:, RECORD["positions_m"]]
    found = np.asarray(np.isfinite(record).all(axis=1) & (np.abs(places) < 1e6).all(axis=1))
    touching = ~found
    touching[found] = np.minimum(obstacles.distance(places[found]), places[found, 2]) < vehicle.radius_m
    if obstacles.inside(places[:1])[0]:
        return 0
    return int(np.argmax(touching)) if touching.any() else None


def check_camera(positions_m: Array, quaternions_wxyz: Array, mount: Mount, obstacles: ObstacleMesh) -> None:
    """UserError when the camera's centre is inside the structure or under the floor at any row of a flight."""
    offset = mount.cam_from_body.inverse().translation
    turned = exact.product(rotation_from_quaternion(quaternions_wxyz[::STRIDE]), offset)
    centres = positions_m[::STRIDE] + turned
    inside = obstacles.inside(centres) | (centres[:, 2] <= 0)
    if inside.any():
        step = int(np.argmax(inside))
        raise UserError(
            f"{_at(centres[step], step * STRIDE)}: the camera is inside {_obstacle(centres[step], obstacles)}; "
            "move the path or the mount's offset_m"
        )


def check_saturation(record: Array, vehicle: Quadrotor, share: float) -> None:
    """UserError when a motor is saturated for more than this share of the time."""
    commands = record[:, RECORD["thrust_commands_n"]]
    full = ((commands >= vehicle.max_thrust_n) | (commands <= vehicle.min_thrust_n)).any(axis=1).mean()
    if not full <= share:
        raise UserError(
            f"motors saturated {full:.1%} of the time, more than saturation_share = {share}: the vehicle cannot fly "
            "this; lower the speed, acceleration or wind"
        )


def crash_error(record: Array, step: int, obstacles: ObstacleMesh, planned: Array | None) -> UserError:
    """Error for a flight that crashed at a row of its record; planned: the place (3,) where its guidance wanted it."""
    if not np.isfinite(record[step]).all():
        return UserError(f"t = {step * STEP_S:.2f} s: the vehicle lost control; {OUT_OF_CONTROL}")
    place = record[step, RECORD["positions_m"]]
    crash = f"{_at(place, step)}: crash into {_obstacle(place, obstacles)}"
    if planned is not None and (off_m := float(np.linalg.norm(place - planned))) > ASTRAY_M:
        return UserError(
            f"{crash}, {off_m:.2f} m from its planned place; {OUT_OF_CONTROL}, or plan the path further away"
        )
    return UserError(f"{crash}; plan the path further away")


def _at(place: Array, step: int) -> str:
    return f"t = {step * STEP_S:.2f} s, at ({place[0]:.2f}, {place[1]:.2f}, {place[2]:.2f}) m"


def _obstacle(place: Array, obstacles: ObstacleMesh) -> str:
    near_floor = place[2] <= obstacles.distance(place[None])[0] and not obstacles.inside(place[None])[0]
    return "the floor" if near_floor else "the structure"
