"""The flight loop: guidance, control, motors and air, integrated by MuJoCo."""

import math

import numpy as np

from uavbench.trajectories.geometry.vectors import add, rotation, scale, subtract, vector
from uavbench.trajectories.kernels.compiled import compiled
from uavbench.trajectories.obstacles import ObstacleMesh
from uavbench.trajectories.paths.reference import Guidance, VehicleState
from uavbench.trajectories.pose import Array
from uavbench.trajectories.record_columns import RECORD_COLUMNS
from uavbench.trajectories.vehicle.geometric_control import GAINS, Gains, thrust_commands
from uavbench.trajectories.vehicle.quadrotor import STEP_S, Quadrotor, compile_mjcf, physics
from uavbench.trajectories.vehicle.rigid_body import PLANT, Plant, accelerations, drag_force, plant, rotor_speed_sum
from uavbench.trajectories.wind.air import Air

BLOCK = 10
"""Control steps between updates of the guidance: 50 Hz."""


def simulate(vehicle: Quadrotor, gains: Gains, guidance: Guidance, air: Air, obstacles: ObstacleMesh) -> Array:
    """Record (n, 30) of a flight, its columns as in `RECORD`; row k is the state at step k."""
    mujoco = physics()
    model = compile_mjcf(vehicle.xml)
    data = mujoco.MjData(model)
    numbers = plant(vehicle)
    first = guidance.rows(-guidance.warm_up, 1, None)[0]
    data.qpos[:] = *first[0:3], math.cos(first[9] / 2), 0.0, 0.0, math.sin(first[9] / 2)
    data.act[:] = vehicle.hover_thrust_n
    integral = trim(numbers, gains, air.mean_m_s[0], 4 * float(vehicle.rotor_speeds(np.array(vehicle.hover_thrust_n))))
    record = np.zeros((guidance.steps, RECORD_COLUMNS))
    spare = np.zeros(RECORD_COLUMNS)
    advance = mujoco.mj_step
    qpos, qvel, act, ctrl, push = data.qpos, data.qvel, data.act, data.ctrl, data.xfrc_applied[1]
    for begin in range(-guidance.warm_up, guidance.steps, BLOCK):
        end = min(begin + BLOCK, guidance.steps)
        rows = guidance.rows(begin, end - begin, VehicleState(qpos[:3].copy(), qvel[:3].copy(), _yaw(qpos)))
        winds = air.at(begin + guidance.warm_up, end - begin, qpos[:3], obstacles)
        for k in range(end - begin):
            step = begin + k
            out = record[step] if step >= 0 else spare
            _step(numbers, gains, rows[k], winds[k], qpos, qvel, act, integral, ctrl, push, out)
            advance(model, data)
    return record


def trim(plant: Plant, gains: Gains, wind_m_s: Array, speed_sum: float) -> Array:
    """State (3,) of the controller's integral, m/s^2, that holds a level vehicle against a steady wind."""
    level = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
    x, y, z = wind_m_s.tolist()
    push = np.array(drag_force(plant, level, (-x, -y, -z), speed_sum))
    return np.asarray(np.clip(-push / plant.mass, -gains.integral_limit, gains.integral_limit))


@compiled("Plant Gains f1 f1 f1 f1 f1 f1! f1! f1! f1!", Plant=PLANT, Gains=GAINS)
def _step(
    plant: Plant,
    gains: Gains,
    reference: Array,
    wind: Array,
    qpos: Array,
    qvel: Array,
    act: Array,
    integral: Array,
    ctrl: Array,
    push: Array,
    record: Array,
) -> None:
    """Commands and drag of one step, from the state at its start; fills the record's row of that state."""
    R = rotation(qpos[3:7])
    velocity, omega = vector(qvel[0:3]), vector(qvel[3:6])
    speed_sum = rotor_speed_sum(plant, act)
    drag = drag_force(plant, R, subtract(velocity, vector(wind)), speed_sum)
    thrust_commands(plant, gains, reference, vector(qpos[0:3]), velocity, R, omega, speed_sum, integral, ctrl)
    linear, angular = accelerations(plant, R, omega, act, drag)
    # MuJoCo holds the push for a whole step, so it gets the drag of the step's middle.
    halfway = add(subtract(velocity, vector(wind)), scale(STEP_S / 2, linear))
    held = drag_force(plant, R, halfway, speed_sum)
    for k in range(3):
        push[k] = held[k]
        record[k] = qpos[k]
        record[7 + k] = velocity[k]
        record[10 + k] = linear[k]
        record[13 + k] = omega[k]
        record[16 + k] = angular[k]
        record[27 + k] = wind[k]
    for k in range(4):
        record[3 + k] = qpos[3 + k]
        record[19 + k] = ctrl[k]
        record[23 + k] = act[k]


def _yaw(qpos: Array) -> float:
    w, x, y, z = qpos[3:7]
    return math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
