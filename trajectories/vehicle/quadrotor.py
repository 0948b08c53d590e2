"""The simulated quadrotor: a MuJoCo model, and its parameters for control and aerodynamics.

Only MuJoCo's physics is used, never its renderer: with MUJOCO_GL=egl in the environment its import loads OpenGL
and crashes together with the image renderer, so the variable is set to `disable` for that import.
"""

import os
from collections.abc import Iterator
from dataclasses import dataclass
from types import ModuleType
from typing import Any

import numpy as np

from uavbench.trajectories import reproducible_math as exact
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.pose import Array, read_only, rotation_from_quaternion

STEP_NS = 2_000_000
"""Time of one step of control and physics: 500 Hz, the rate of the Crazyflie's attitude loop."""
STEP_S = STEP_NS / 1e9
GRAVITY_M_S2 = 9.80665
"""Standard gravity (ISO 80000-3)."""
MASS_KG = (1e-4, 1e4)
"""Plausible masses of an airframe in kg: from robots of the size of insects (0.1 g) beyond the largest air taxis."""
INERTIA_KG_M2 = (1e-10, 1e6)
"""Plausible principal moments of inertia in kg m^2: MASS_KG at radii of gyration from 1 mm to 10 m."""
LAG_S = (STEP_S, 2.0)
"""Motor lags in s: those below a step of the simulation are integrated wrongly; large multicopters have 0.1 to 0.5."""
LARGEST_RADIUS = 100.0
"""Most radii of gyration in radius_m: vehicles have 2 to 4, a wide berth some more; a radius in cm has hundreds."""
MOST_THRUST_TO_WEIGHT = 50.0
"""Largest ratio of thrust to weight: three times that of racing drones, and far below a unit of grams for newtons."""
SLOWEST_ROTOR_RAD_S, FASTEST_ROTOR_RAD_S = 10.0, 1e4
"""Slowest and fastest rotor, 95 and 95,000 rpm: those of helicopters have 200 and more; the fastest is beyond motors
of the smallest racing drones (25,000 rpm/V, 3.8 V) under load."""
LEAST_ARM = 0.05
"""Least distance of a rotor from the middle in radii of gyration: vehicles have 1 to 2."""
LEAST_TORQUE = 1e-3
"""Least torque of a rotor for each newton of thrust, in radius_m: vehicles have 0.08 to 0.5."""
MOST_ROTOR_DRAG_1_S = 100.0
"""Largest deceleration by the rotors' drag in hover for each m/s: vehicles have 0.2 to 0.5, and steps of 2 ms."""
MOST_BODY_DRAG_KG_M3 = 38.5
"""Largest body_drag_kg_m over radius_m^2: ten times that of a plate as large as the vehicle's sphere."""


def physics() -> ModuleType:
    """MuJoCo, imported without any OpenGL; the environment is left as it was.

    Its warnings, which it appends to MUJOCO_LOG.TXT in the current folder, are dropped unless the program has a handler
    of its own: what they tell of a flight, its checks tell by name.
    """
    before = os.environ.get("MUJOCO_GL")
    os.environ["MUJOCO_GL"] = "disable"
    try:
        import mujoco
    finally:
        if before is None:
            del os.environ["MUJOCO_GL"]
        else:
            os.environ["MUJOCO_GL"] = before
    if mujoco.get_mju_user_warning() is None:
        mujoco.set_mju_user_warning(lambda text: None)
    module: ModuleType = mujoco
    return module


@dataclass(frozen=True, eq=False)
class Quadrotor:
    """One rigid body with four thrust sites, read from MJCF.

    mass_kg; inertia_kg_m2 (3, 3) about the body's origin and axes; allocation (4, 4) maps the four thrusts (N) to
    collective thrust (N) and body torque (N m); min_thrust_n, max_thrust_n per rotor; thrust_map_n c0 c1 c2 of
    thrust over rotor speed; rotor_drag_kg and body_drag_kg_m by body axis; radius_m of the sphere to keep clear.
    """

    xml: str
    mass_kg: float
    inertia_kg_m2: Array
    allocation: Array
    motor_time_constant_s: float
    min_thrust_n: float
    max_thrust_n: float
    thrust_map_n: Array
    rotor_drag_kg: Array
    body_drag_kg_m: Array
    radius_m: float

    @classmethod
    def from_mjcf(cls, xml: str) -> "Quadrotor":
        """Vehicle of an MJCF text; UserError naming what is missing or invalid."""
        if not isinstance(xml, str):
            raise UserError(f"build of an airframe gives a {type(xml).__name__}; it takes a text in MJCF")
        model = compile_mjcf(xml)
        if not (model.nbody == 2 and model.nq == 7 and model.nu == 4):
            raise UserError("an airframe's MJCF must be one body on one free joint with four actuators")
        _check_plausible("mass", "kg", np.array(model.body_mass[1:]), MASS_KG)
        _check_plausible("moments of inertia", "kg m^2", np.array(model.body_inertia[1]), INERTIA_KG_M2)
        if np.abs(model.body_ipos[1]).max() > 1e-9:
            raise UserError("an airframe's centre of mass must be its body's origin: move the body's inertial pos to 0")
        axes = rotation_from_quaternion(np.array(model.body_iquat[1]))
        rows = [_wrench(model, i) for i in range(4)]
        ranges = np.array(model.actuator_ctrlrange)
        lags = np.array(model.actuator_dynprm[:, 0])
        if not (model.actuator_dyntype == physics().mjtDyn.mjDYN_FILTER).all() or np.ptp(lags) > 0 or lags[0] <= 0:
            raise UserError('an airframe\'s actuators need dyntype="filter" and one common dynprm > 0, in seconds')
        if np.ptp(ranges, axis=0).max() > 0 or not 0 <= ranges[0, 0] < ranges[0, 1]:
            raise UserError("an airframe's actuators need one common ctrlrange, from 0 or more newtons upward")
        allocation = np.column_stack(rows)
        if not np.isfinite(allocation).all():
            raise UserError("an airframe's rotors need finite places, and finite torques per newton of thrust")
        vehicle = cls(
            xml=xml,
            mass_kg=float(model.body_mass[1]),
            inertia_kg_m2=read_only(exact.product(axes * np.array(model.body_inertia[1]), axes.T)),
            allocation=read_only(allocation),
            motor_time_constant_s=float(lags[0]),
            min_thrust_n=float(ranges[0, 0]),
            max_thrust_n=float(ranges[0, 1]),
            thrust_map_n=_numeric(model, "thrust_map", 3),
            rotor_drag_kg=_numeric(model, "rotor_drag", 3),
            body_drag_kg_m=_numeric(model, "body_drag", 3),
            radius_m=float(_numeric(model, "radius", 1)[0]),
        )
        _refuse_impossible(vehicle)
        return vehicle

    def rotor_speeds(self, thrusts_n: Array) -> Array:
        """Rotor speeds, rad/s, of steady thrusts: the positive root of the thrust map."""
        c0, c1, c2 = self.thrust_map_n
        root = np.sqrt(np.maximum(c1 * c1 - 4 * c2 * (c0 - thrusts_n), 0.0))
        return np.asarray((root - c1) / (2 * c2))

    @property
    def hover_thrust_n(self) -> float:
        """Thrust of each rotor in hover in still air, N."""
        return self.mass_kg * GRAVITY_M_S2 / 4


def compile_mjcf(xml: str) -> Any:
    """MuJoCo model of an MJCF text at this simulator's step, gravity and integrator; UserError when it is not valid."""
    mujoco = physics()
    try:
        model = mujoco.MjModel.from_xml_string(xml)
    except ValueError as error:
        raise UserError(f"the airframe's MJCF is not valid: {error}") from None
    model.opt.timestep = STEP_S
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    model.opt.gravity[:] = 0.0, 0.0, -GRAVITY_M_S2
    model.opt.density = model.opt.viscosity = 0.0
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    return model


def _check_plausible(what: str, unit: str, values: Array, limits: tuple[float, float]) -> None:
    """UserError when a value of an airframe is not within limits, beyond which its flight cannot be computed."""
    low, high = limits
    if not ((values >= low) & (values <= high)).all():
        given = ", ".join(f"{value:g}" for value in values)
        raise UserError(f"an airframe's {what} must be from {low:g} to {high:g} {unit}, not {given}; check its units")


def _wrench(model: Any, actuator: int) -> Array:
    """Collective thrust and torque (4,) of one newton of an actuator at its site."""
    site = model.actuator_trnid[actuator, 0]
    axes = rotation_from_quaternion(np.array(model.site_quat[site]))
    force = exact.product(axes, np.array(model.actuator_gear[actuator, :3]))
    torque = exact.product(axes, np.array(model.actuator_gear[actuator, 3:])) + np.cross(model.site_pos[site], force)
    if np.abs(force - [0, 0, 1]).max() > 1e-9:
        raise UserError("an airframe's rotors must push along the body's z axis: gear 0 0 1 0 0 k")
    return np.array([1.0, *torque])


def _numeric(model: Any, name: str, size: int) -> Array:
    """Numbers of a <numeric> element under <custom>."""
    index = physics().mj_name2id(model, physics().mjtObj.mjOBJ_NUMERIC, name)
    if index < 0 or model.numeric_size[index] != size:
        raise UserError(f'an airframe\'s MJCF needs <custom><numeric name="{name}"> with {size} numbers')
    start = model.numeric_adr[index]
    return read_only(model.numeric_data[start : start + size])


def _refuse_impossible(vehicle: Quadrotor) -> None:
    """UserError naming all numbers of an airframe that no vehicle can have, and their units."""
    independent = np.linalg.matrix_rank(vehicle.allocation) == 4
    found = [*_of_size(vehicle), *(_of_motors(vehicle) if independent else ()), *_of_drag(vehicle)]
    if not independent and not found:
        found = [
            "four rotors must reach thrust, roll, pitch and yaw independently: in an X, rotors beside each other have "
            "opposite signs of yaw"
        ]
    if found:
        raise UserError("; ".join(f"an airframe's {each}" for each in found))


def _of_size(vehicle: Quadrotor) -> Iterator[str]:
    """Rotors and masses lie within the sphere to keep clear; the torque of a rotor is that of forces within it."""
    _, y_m, x_m, lever_m = np.abs(vehicle.allocation)
    radius_m = vehicle.radius_m
    if not (arm_m := float(np.hypot(x_m, y_m).max())) <= radius_m:
        yield (
            f"rotors lie up to {arm_m:g} m from its middle, outside of its radius of {radius_m:g} m, the sphere "
            "that is kept clear of everything: give rotors_m and radius_m in metres, the radius with the propellers"
        )
        return
    if not LEAST_TORQUE * radius_m <= lever_m.max() < radius_m:
        yield (
            f"torque_per_thrust_m {lever_m.max():g} is not below radius_m {radius_m:g}, or less than "
            f"{LEAST_TORQUE:g} of it; give the torque of a rotor in N m for each newton of its thrust"
        )
    largest = float(np.linalg.eigvalsh(vehicle.inertia_kg_m2)[-1])
    gyration_m = float(np.sqrt(largest / vehicle.mass_kg))
    if not largest <= vehicle.mass_kg * radius_m * radius_m:
        yield (
            f"moment of inertia of {largest:g} kg m^2 is larger than that of its whole mass of {vehicle.mass_kg:g} kg "
            f"at radius_m {radius_m:g}; check the units of inertia_kg_m2 (1 g cm^2 is 1e-7), mass_kg and radius_m"
        )
    elif not radius_m <= LARGEST_RADIUS * gyration_m:
        yield (
            f"radius_m {radius_m:g} is more than {LARGEST_RADIUS:g} times {gyration_m:.3g} m, at which its mass of "
            f"{vehicle.mass_kg:g} kg would have its moment of inertia of {largest:g} kg m^2; give radius_m in metres, "
            "and check the units of inertia_kg_m2 (1 g cm^2 is 1e-7) and mass_kg"
        )

    elif not min(x_m.max(), y_m.max()) >= LEAST_ARM * gyration_m:
        yield (
            f"rotors lie up to {x_m.max():g} m before and {y_m.max():g} m beside its middle, less than {LEAST_ARM:g} "
            f"of {gyration_m:.3g} m, at which its mass of {vehicle.mass_kg:g} kg would have its moment of inertia of "
            f"{largest:g} kg m^2: it hardly turns; give rotors_m in metres, and check inertia_kg_m2 and mass_kg"
        )


def _of_motors(vehicle: Quadrotor) -> Iterator[str]:
    """Rotors hold the weight, within the speeds of motors, and follow their commands."""
    least_n, most_n, weight_n = 4 * vehicle.min_thrust_n, 4 * vehicle.max_thrust_n, vehicle.mass_kg * GRAVITY_M_S2
    if not (least_n < weight_n < most_n <= MOST_THRUST_TO_WEIGHT * weight_n):
        yield (
            f"four rotors give {least_n:.4g} to {most_n:.4g} N, and its weight is {weight_n:.4g} N, which must lie "
            f"between them, and be at least 1 / {MOST_THRUST_TO_WEIGHT:g} of the most; check mass_kg (kg), "
            "min_thrust_n and max_thrust_n (N of each rotor)"
        )
    hover_n = np.linalg.solve(vehicle.allocation, np.array([weight_n, 0.0, 0.0, 0.0]))
    if least_n < weight_n < most_n and not (4 * hover_n.min() >= least_n and 4 * hover_n.max() <= most_n):
        yield (
            f"rotors would have to give {', '.join(f'{each:.4g}' for each in hover_n)} N to hover without turning, and "
            f"give {vehicle.min_thrust_n:g} to {vehicle.max_thrust_n:g} N each; check rotors_m, which lie around its "
            "middle, and yaw_signs, each in the order of the other"
        )
    if not LAG_S[0] <= vehicle.motor_time_constant_s <= LAG_S[1]:
        yield (
            f"motor_time_constant_s {vehicle.motor_time_constant_s:g} is not between {LAG_S[0]:g} and {LAG_S[1]:g}; "
            f"give it in seconds, for motors without lag a step of the simulation, {LAG_S[0]:g}"
        )
    rising = np.isfinite(vehicle.thrust_map_n).all() and vehicle.thrust_map_n[2] > 0
    speeds = vehicle.rotor_speeds(np.array([weight_n / 4, vehicle.max_thrust_n])) if rising else np.full(2, np.nan)
    if not (speeds[0] >= SLOWEST_ROTOR_RAD_S and speeds[1] <= FASTEST_ROTOR_RAD_S):
        yield (
            f"thrust_map_n {vehicle.thrust_map_n.tolist()} has rotor speeds of {speeds[0]:.4g} rad/s in hover and "
            f"{speeds[1]:.4g} at max_thrust_n, not {SLOWEST_ROTOR_RAD_S:g} or more and at most "
            f"{FASTEST_ROTOR_RAD_S:g}; give c0, c1, c2 of thrust in N over rad/s (of rpm: c1 times 9.549, c2 times "
            "91.19), c2 above 0"
        )


def _of_drag(vehicle: Quadrotor) -> Iterator[str]:
    """Drag brakes, and no more than air can."""
    speed = 4 * float(vehicle.rotor_speeds(np.array(vehicle.hover_thrust_n))) if vehicle.thrust_map_n[2] > 0 else 0.0
    most = {
        "rotor_drag_kg": MOST_ROTOR_DRAG_1_S * vehicle.mass_kg / speed if speed > 0 else np.inf,
        "body_drag_kg_m": MOST_BODY_DRAG_KG_M3 * vehicle.radius_m * vehicle.radius_m,
    }
    for key in ("rotor_drag_kg", "body_drag_kg_m"):
        drag = getattr(vehicle, key)
        if not ((drag >= 0) & np.isfinite(drag)).all():
            yield f"{key} {drag.tolist()} has a number below 0 or none; write drag as positive numbers, which brake"
        elif drag.max() > most[key]:
            yield (
                f"{key} {drag.tolist()} has more than {most[key]:.3g}, at which air of its speed and size would brake "
                "many times less; give newtons over m/s and the rad/s of all rotors together (rotor_drag_kg), or over "
                "(m/s)^2 (body_drag_kg_m)"
            )
