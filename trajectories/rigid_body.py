"""The vehicle's equations of motion: rotor drag, and the accelerations that follow from the forces.

MuJoCo integrates the motion; the same equations give the accelerations of the record exactly at its stamps.
"""

from typing import NamedTuple

import numpy as np

from trajectories.kernels import compiled
from trajectories.pose import Array, read_only
from trajectories.quadrotor import GRAVITY_M_S2, Quadrotor


class Plant(NamedTuple):
    """Numbers of a `Quadrotor` for compiled functions."""

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


def plant(vehicle: Quadrotor) -> Plant:
    """Numbers of a vehicle for compiled functions."""
    return Plant(
        vehicle.mass_kg,
        vehicle.motor_time_constant_s,
        vehicle.min_thrust_n,
        vehicle.max_thrust_n,
        vehicle.thrust_map_n,
        vehicle.rotor_drag_kg,
        vehicle.body_drag_kg_m,
        vehicle.inertia_kg_m2,
        read_only(np.linalg.inv(vehicle.inertia_kg_m2)),
        vehicle.allocation,
        read_only(np.linalg.inv(vehicle.allocation)),
    )


@compiled
def cross(a: Array, b: Array) -> Array:
    """Cross product (3,)."""
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


@compiled
def rotate(R: Array, v: Array) -> Array:
    """R v."""
    return np.array(
        [
            R[0, 0] * v[0] + R[0, 1] * v[1] + R[0, 2] * v[2],
            R[1, 0] * v[0] + R[1, 1] * v[1] + R[1, 2] * v[2],
            R[2, 0] * v[0] + R[2, 1] * v[1] + R[2, 2] * v[2],
        ]
    )


@compiled
def unrotate(R: Array, v: Array) -> Array:
    """R' v."""
    return np.array(
        [
            R[0, 0] * v[0] + R[1, 0] * v[1] + R[2, 0] * v[2],
            R[0, 1] * v[0] + R[1, 1] * v[1] + R[2, 1] * v[2],
            R[0, 2] * v[0] + R[1, 2] * v[1] + R[2, 2] * v[2],
        ]
    )


@compiled
def rotation(q: Array) -> Array:
    """Rotation matrix of a unit quaternion wxyz."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


@compiled
def rotor_speed_sum(plant: Plant, thrusts: Array) -> float:
    """Sum of the rotor speeds, rad/s, that make the thrusts (4,): positive roots of the thrust map."""
    c0, c1, c2 = plant.thrust_map[0], plant.thrust_map[1], plant.thrust_map[2]
    total = 0.0
    for i in range(4):
        total += (np.sqrt(max(0.0, c1 * c1 - 4.0 * c2 * (c0 - thrusts[i]))) - c1) / (2.0 * c2)
    return total


@compiled
def drag_force(plant: Plant, R: Array, airspeed: Array, speed_sum: float) -> Array:
    """Drag (3,) in the world, N, at an airspeed (3,) in the world.

    By body axis: that of the rotors, -d sum(w) u (Foerster 2015, eq. of the drag), and that of the body, -c |u| u.
    """
    u = unrotate(R, airspeed)
    size = np.sqrt(u[0] ** 2 + u[1] ** 2 + u[2] ** 2)
    return rotate(R, -(plant.rotor_drag * speed_sum + plant.body_drag * size) * u)


@compiled
def accelerations(plant: Plant, R: Array, omega: Array, thrusts: Array, drag: Array) -> tuple[Array, Array]:
    """Acceleration (3,) of the body's origin in the world and angular acceleration (3,) in the body (Newton, Euler)."""
    wrench = np.zeros(4)
    for i in range(4):
        for j in range(4):
            wrench[i] += plant.mix[i, j] * thrusts[j]
    linear = (R[:, 2] * wrench[0] + drag) / plant.mass
    linear[2] -= GRAVITY_M_S2
    spin = wrench[1:4] - cross(omega, rotate(plant.inertia, omega))
    return linear, rotate(plant.inverse_inertia, spin)
