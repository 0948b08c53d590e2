"""The flight loop: guidance, control, motors and aerodynamics, integrated by MuJoCo."""

import math
from typing import Any

import numpy as np

from uavbench.trajectories.geometry.vectors import add, rotation, scale, subtract, vector
from uavbench.trajectories.kernels.compiled import compiled
from uavbench.trajectories.obstacles import ObstacleMesh
from uavbench.trajectories.paths.reference import Guidance, VehicleState
from uavbench.trajectories.pose import Array
from uavbench.trajectories.record_columns import RECORD_COLUMNS
from uavbench.trajectories.vehicle.geometric_control import (
    REFERENCE_COLUMNS,
    BodyState,
    Gains,
    thrust_commands,
)
from uavbench.trajectories.vehicle.quadrotor import STEP_S, Quadrotor, compile_mjcf, physics
from uavbench.trajectories.vehicle.rigid_body import (
    PLANT_NUMBERS,
    Plant,
    accelerations,
    drag_force,
    plant,
    plant_of,
    rotor_speed_sum,
)
from uavbench.trajectories.wind.air import Air

BLOCK = 10
"""Control steps between updates of the guidance: 50 Hz."""


def simulate(simulation: "Simulation") -> Array:
    """Record (n, 30) of a flight on its true state, its columns as in `RECORD`; row k is the state at step k."""
    while not simulation.is_over:
        simulation.observe()
        simulation.command(simulation.qpos, simulation.qvel)
        simulation.advance()
    return simulation.record


class Simulation:
    """A vehicle in flight, one control step at a time: `observe`, `command`, `advance`.

    step counts from -warm_up of the guidance; record (n, 30) and reference (n, 17) hold a row of each step from 0 on.
    qpos (7,) position and quaternion wxyz, qvel (6,) velocity in the world and angular velocity in the body, as MuJoCo
    has them: the true state. commanded (17,) is the reference row of the latest command.
    """

    def __init__(self, vehicle: Quadrotor, gains: Gains, guidance: Guidance, air: Air, obstacles: ObstacleMesh) -> None:
        mujoco = physics()
        self._advance = mujoco.mj_step
        self._model = compile_mjcf(vehicle.xml)
        self._data: Any = mujoco.MjData(self._model)
        self._guidance, self._air, self._warm_up = guidance, air, guidance.warm_up
        body = plant(vehicle)
        self._vehicle = np.concatenate([np.ravel(field) for field in (*body, *gains)])
        self._obstacles = obstacles
        first = guidance.rows(-guidance.warm_up, 1, None)[0]
        hover = vehicle.hover_thrust_n
        self._data.qpos[:] = *first[0:3], math.cos(first[9] / 2), 0.0, 0.0, math.sin(first[9] / 2)
        self._data.act[:] = hover
        integral = trim(body, gains, air.mean_m_s[0], 4 * float(vehicle.rotor_speeds(np.array(hover))))
        self.qpos: Array = self._data.qpos
        self.qvel: Array = self._data.qvel
        self._thrusts: Array = self._data.act
        self._commands: Array = self._data.ctrl
        self._integral = integral
        self._push = self._data.xfrc_applied[1]
        self.step, self.steps = -guidance.warm_up, guidance.steps
        self.record = np.zeros((guidance.steps, RECORD_COLUMNS))
        self.reference = np.zeros((guidance.steps, REFERENCE_COLUMNS))
        self.commanded = np.zeros(REFERENCE_COLUMNS)
        self._spare = np.zeros(RECORD_COLUMNS)
        self._rows = self._winds = np.zeros((0, 3))

    def warm_up(self) -> None:
        """Fly on the true state up to the first row of the record, and fill that row."""
        while self.step < 0:
            self.observe()
            self.command(self.qpos, self.qvel)
            self.advance()
        self.observe()

    @property
    def is_over(self) -> bool:
        """Whether every row of the record is filled."""
        return self.step >= self.steps

    def observe(self) -> None:
        """Fill the record's row of this step except for the commands, and apply the aerodynamic drag."""
        at = (self.step + self._warm_up) % BLOCK
        if at == 0:
            first = self.step + self._warm_up
            count = min(BLOCK, self.steps - self.step)
            self._winds = self._air.at(first, count, self.qpos[:3], self._obstacles)
        _observe(self._vehicle, self._winds[at], self.qpos, self.qvel, self._thrusts, self._push, self._row)

    def command(self, qpos: Array, qvel: Array) -> None:
        """Set the thrusts that guidance and controller command for an estimated state, given as qpos and qvel."""
        at = (self.step + self._warm_up) % BLOCK
        if at == 0:
            believed = VehicleState(qpos[:3].copy(), qvel[:3].copy(), _yaw(qpos))
            self._rows = self._guidance.rows(self.step, min(BLOCK, self.steps - self.step), believed)
        self.commanded = self._rows[at]
        if self.step >= 0:
            self.reference[self.step] = self.commanded
        row = self._row
        _command(self._vehicle, self.commanded, qpos, qvel, self._thrusts, self._integral, row)
        self._commands[:] = row[19:23]

    def advance(self) -> None:
        """Integrate one control step."""
        self._advance(self._model, self._data)
        self.step += 1

    @property
    def _row(self) -> Array:
        return self.record[self.step] if self.step >= 0 else self._spare


def trim(plant: Plant, gains: Gains, wind_m_s: Array, speed_sum: float) -> Array:
    """State (3,) of the controller's integral, m/s^2, that holds a level vehicle against a steady wind."""
    level = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
    x, y, z = wind_m_s.tolist()
    push = np.array(drag_force(plant, level, (-x, -y, -z), speed_sum))
    return np.asarray(np.clip(-push / plant.mass, -gains.integral_limit, gains.integral_limit))


@compiled
def gains_of(numbers: Array) -> Gains:
    """The gains whose fields are the numbers of an array, in their order."""
    return Gains(numbers[0], numbers[1], numbers[2], numbers[3], numbers[4:7], numbers[7:10])


@compiled("f1 f1 f1 f1 f1 f1! f1!")
def _observe(vehicle: Array, wind: Array, qpos: Array, qvel: Array, act: Array, push: Array, record: Array) -> None:
    """Drag of one step, from the true state at its start; fills the record's row of that state.

    vehicle: the numbers of plant and gains: with the tuples of their parts a call takes 2.5 us, with an array 1.0 us.
    """
    plant = plant_of(vehicle)
    R = rotation(qpos[3:7])
    velocity, omega = vector(qvel[0:3]), vector(qvel[3:6])
    speed_sum = rotor_speed_sum(plant, act)
    drag = drag_force(plant, R, subtract(velocity, vector(wind)), speed_sum)
    linear, angular = accelerations(plant, R, omega, act, drag)
    # MuJoCo holds a force for a whole step, so it gets the drag of the step's midpoint.
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
        record[23 + k] = act[k]


@compiled("f1 f1 f1 f1 f1 f1! f1!")
def _command(
    vehicle: Array, reference: Array, qpos: Array, qvel: Array, act: Array, integral: Array, record: Array
) -> None:
    """Thrusts of one step into its record, for an estimated state; rotor speeds are taken as measured."""
    plant, gains = plant_of(vehicle), gains_of(vehicle[PLANT_NUMBERS:])
    speed_sum = rotor_speed_sum(plant, act)
    velocity, omega = vector(qvel[0:3]), vector(qvel[3:6])
    state = BodyState(vector(qpos[0:3]), velocity, rotation(qpos[3:7]), omega, speed_sum)
    thrust_commands(plant, gains, reference, state, integral, record[19:23])


def _yaw(qpos: Array) -> float:
    w, x, y, z = qpos[3:7].tolist()
    return math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
