"""The vehicle's equations of motion: rotor drag, and the accelerations that follow from the forces.

MuJoCo integrates the motion; the same equations give the accelerations of the record exactly at its stamps.
"""

from math import sqrt
from typing import NamedTuple

from uavbench.trajectories import reproducible_math as exact
from uavbench.trajectories.geometry.vectors import (
    Matrix,
    Vector,
    cross,
    length,
    matrix,
    rotate,
    subtract,
    transpose,
    vector,
)
from uavbench.trajectories.kernels.argument_types import named_tuple
from uavbench.trajectories.kernels.compiled import compiled
from uavbench.trajectories.pose import Array, read_only
from uavbench.trajectories.vehicle.quadrotor import GRAVITY_M_S2, Quadrotor


class Plant(NamedTuple):
    """Parameters of a `Quadrotor` for compiled functions."""

    mass: float
    lag: float
    min_thrust: float
    max_thrust: float
    thrust_map: Array
    rotor_drag: Array
    body_drag: Array
    inertia: Array
    inverse_inertia: Array
    mix: Array
    unmix: Array


PLANT = named_tuple(Plant, "f0 f0 f0 f0 f1 f1 f1 f2 f2 f2 f2")


def plant(vehicle: Quadrotor) -> Plant:
    """Parameters of a vehicle for compiled functions."""
    return Plant(
        vehicle.mass_kg,
        vehicle.motor_time_constant_s,
        vehicle.min_thrust_n,
        vehicle.max_thrust_n,
        vehicle.thrust_map_n,
        vehicle.rotor_drag_kg,
        vehicle.body_drag_kg_m,
        vehicle.inertia_kg_m2,
        read_only(exact.inverse(vehicle.inertia_kg_m2)),
        vehicle.allocation,
        read_only(exact.inverse(vehicle.allocation)),
    )


PLANT_NUMBERS = 63
"""Length of a `Plant` as one array."""


@compiled
def plant_of(numbers: Array) -> Plant:
    """The plant whose fields are the first PLANT_NUMBERS of an array, in their order."""
    return Plant(
        numbers[0],
        numbers[1],
        numbers[2],
        numbers[3],
        numbers[4:7],
        numbers[7:10],
        numbers[10:13],
        numbers[13:22].reshape(3, 3),
        numbers[22:31].reshape(3, 3),
        numbers[31:47].reshape(4, 4),
        numbers[47:63].reshape(4, 4),
    )


@compiled
def rotor_speed_sum(plant: Plant, thrusts: Array) -> float:
    """Sum of the rotor speeds, rad/s, that make the thrusts (4,): positive roots of the thrust map."""
    c0, c1, c2 = vector(plant.thrust_map)
    total = 0.0
    for i in range(4):
        total += (sqrt(max(0.0, c1 * c1 - 4.0 * c2 * (c0 - thrusts[i]))) - c1) / (2.0 * c2)
    return total


@compiled("Plant ((f0 f0 f0) (f0 f0 f0) (f0 f0 f0)) (f0 f0 f0) f0", Plant=PLANT)
def drag_force(plant: Plant, R: Matrix, airspeed: Vector, speed_sum: float) -> Vector:
    """Drag in the world, N, at an airspeed in the world.

    Per body axis: rotor drag -d sum(w) u (Foerster 2015, aerodynamic drag) and body drag -c |u| u.
    """
    u = rotate(transpose(R), airspeed)
    size = length(u)
    return rotate(
        R,
        (
            -(plant.rotor_drag[0] * speed_sum + plant.body_drag[0] * size) * u[0],
            -(plant.rotor_drag[1] * speed_sum + plant.body_drag[1] * size) * u[1],
            -(plant.rotor_drag[2] * speed_sum + plant.body_drag[2] * size) * u[2],
        ),
    )


@compiled
def accelerations(plant: Plant, R: Matrix, omega: Vector, thrusts: Array, drag: Vector) -> tuple[Vector, Vector]:
    """Acceleration of the body's origin in the world, and angular acceleration in the body (Newton, Euler)."""
    thrust = thrusts[0] + thrusts[1] + thrusts[2] + thrusts[3]
    linear = (
        (R[0][2] * thrust + drag[0]) / plant.mass,
        (R[1][2] * thrust + drag[1]) / plant.mass,
        (R[2][2] * thrust + drag[2]) / plant.mass - GRAVITY_M_S2,
    )
    torque = (rotor_torque(plant, thrusts, 1), rotor_torque(plant, thrusts, 2), rotor_torque(plant, thrusts, 3))
    spin = subtract(torque, cross(omega, rotate(matrix(plant.inertia), omega)))
    return linear, rotate(matrix(plant.inverse_inertia), spin)


@compiled
def rotor_torque(plant: Plant, thrusts: Array, row: int) -> float:
    """Torque about body axis `row` (1 x, 2 y, 3 z) of the thrusts (4,)."""
    total = 0.0
    for j in range(4):
        total += plant.mix[row, j] * thrusts[j]
    return total
