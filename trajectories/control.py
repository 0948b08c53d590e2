"""Geometric tracking control on SE(3): Lee, Leok & McClamroch 2010, with feed-forward.

Equation numbers are those of "Geometric Tracking Control of a Quadrotor UAV on SE(3)", CDC 2010. Gains are per
mass and per inertia, so that one set of them suits every airframe.
"""

from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np
from annotated_types import Ge, Gt

from trajectories.kernels import compiled
from trajectories.pose import Array, read_only
from trajectories.quadrotor import GRAVITY_M_S2, STEP_S
from trajectories.rigid_body import Plant, cross, drag_force, rotate, unrotate

REFERENCE_COLUMNS = 17
"""What to be at, at one step: position 0:3, velocity 3:6 and acceleration 6:9 in the world; yaw 9; angular velocity
10:13 and acceleration 13:16 in the reference's own body axes; rate of the specific thrust 16 (m/s^3)."""


@dataclass(frozen=True)
class Geometric:
    """Gains of the tracking controller; the defaults are those of the Crazyflie's firmware (controller_lee.c).

    There the attitude gains are 0.007, 0.007, 0.008 N m and the rate gains 0.00115, 0.00115, 0.002 N m s for an
    inertia of 1.66e-5, 1.66e-5, 2.93e-5 kg m^2. The integral gain is ours: it takes out steady wind.
    """

    position_1_s2: Annotated[float, Gt(0)] = 7.0
    velocity_1_s: Annotated[float, Gt(0)] = 4.0
    integral_1_s3: Annotated[float, Ge(0)] = 2.0
    integral_limit_m_s2: Annotated[float, Gt(0)] = 3.0
    attitude_1_s2: tuple[float, float, float] = (422.0, 422.0, 273.0)
    rate_1_s: tuple[float, float, float] = (69.0, 69.0, 68.0)

    def gains(self) -> "Gains":
        """The numbers as the compiled law reads them."""
        return Gains(
            self.position_1_s2,
            self.velocity_1_s,
            self.integral_1_s3,
            self.integral_limit_m_s2,
            read_only(self.attitude_1_s2),
            read_only(self.rate_1_s),
        )


class Gains(NamedTuple):
    """Gains of `Geometric` for the compiled law."""

    position: float
    velocity: float
    integral: float
    integral_limit: float
    attitude: Array
    rate: Array


@compiled
def thrust_commands(
    plant: Plant,
    gains: Gains,
    reference: Array,
    position: Array,
    velocity: Array,
    R: Array,
    omega: Array,
    rotor_speed_sum: float,
    integral: Array,
) -> Array:
    """Commanded thrust (4,) of the rotors, N, within their limits; moves `integral` (3,), m/s^2, on by one step.

    R is world_from_body, omega (3,) the angular velocity in the body. The drag that the reference's own motion makes
    is fed forward, and so is the thrust that the motors' lag would swallow.
    """
    e_x = position - reference[0:3]
    e_v = velocity - reference[3:6]
    for k in range(3):
        moved = integral[k] - gains.integral * e_x[k] * STEP_S
        integral[k] = min(gains.integral_limit, max(-gains.integral_limit, moved))
    drag = drag_force(plant, R, reference[3:6], rotor_speed_sum)
    force = plant.mass * (reference[6:9] - gains.position * e_x - gains.velocity * e_v + integral) - drag  # (12)
    force[2] += plant.mass * GRAVITY_M_S2
    R_d = attitude(force, reference[9])
    thrust = force[0] * R[0, 2] + force[1] * R[1, 2] + force[2] * R[2, 2]  # (15)
    thrust += plant.mass * plant.lag * reference[16]
    omega_d = unrotate(R, rotate(R_d, reference[10:13]))
    alpha_d = unrotate(R, rotate(R_d, reference[13:16]))
    e_R = attitude_error(R, R_d)  # (10)
    e_omega = omega - omega_d  # (11)
    alpha = alpha_d - cross(omega, omega_d) - gains.attitude * e_R - gains.rate * e_omega
    torque = rotate(plant.inertia, alpha) + cross(omega, rotate(plant.inertia, omega))  # (16)
    return allocate(plant, thrust, torque)


@compiled
def attitude(force: Array, yaw: float) -> Array:
    """Rotation (3, 3) whose z axis lies along `force` and whose x axis looks towards `yaw`: (14) and below."""
    size = np.sqrt(force[0] ** 2 + force[1] ** 2 + force[2] ** 2)
    b3 = force / size
    heading = np.array([np.cos(yaw), np.sin(yaw), 0.0])
    b2 = cross(b3, heading)
    b2 /= np.sqrt(b2[0] ** 2 + b2[1] ** 2 + b2[2] ** 2)
    b1 = cross(b2, b3)
    R = np.empty((3, 3))
    R[:, 0], R[:, 1], R[:, 2] = b1, b2, b3
    return R


@compiled
def attitude_error(R: Array, R_d: Array) -> Array:
    """Half the vector (3,) of R_d' R - R' R_d."""
    out = np.empty(3)
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        ji = R_d[0, j] * R[0, i] + R_d[1, j] * R[1, i] + R_d[2, j] * R[2, i]
        ij = R_d[0, i] * R[0, j] + R_d[1, i] * R[1, j] + R_d[2, i] * R[2, j]
        out[k] = 0.5 * (ji - ij)
    return out


@compiled
def allocate(plant: Plant, thrust: float, torque: Array) -> Array:
    """Thrusts (4,) that make a collective thrust and a torque, each within its limits.

    Where they do not fit, the collective gives way before roll and pitch do: losing height is mended, toppling is not.
    """
    wanted = np.empty(4)
    for i in range(4):
        wanted[i] = (
            plant.unmix[i, 0] * thrust
            + plant.unmix[i, 1] * torque[0]
            + plant.unmix[i, 2] * torque[1]
            + plant.unmix[i, 3] * torque[2]
        )
    over = max(0.0, wanted.max() - plant.max_thrust)
    under = max(0.0, plant.min_thrust - wanted.min())
    if over > 0.0 and under == 0.0:
        wanted -= min(over, max(0.0, wanted.min() - plant.min_thrust))
    if under > 0.0 and over == 0.0:
        wanted += min(under, max(0.0, plant.max_thrust - wanted.max()))
    return np.minimum(plant.max_thrust, np.maximum(plant.min_thrust, wanted))


CONTROLS: dict[str, type[Geometric]] = {"geometric": Geometric}
