"""Geometric tracking control on SE(3): Lee, Leok & McClamroch 2010, with feed-forward.

Equation numbers are those of "Geometric Tracking Control of a Quadrotor UAV on SE(3)", CDC 2010. Gains are per
mass and per inertia, so that one set of them suits every airframe.
"""

from dataclasses import dataclass
from math import cos, inf, sin
from typing import Annotated, NamedTuple

from annotated_types import Interval

from uavbench.trajectories.geometry.vectors import (
    Matrix,
    Vector,
    add,
    cross,
    dot,
    length,
    matrix,
    multiply,
    rotate,
    scale,
    subtract,
    transpose,
    vector,
)
from uavbench.trajectories.kernels.compiled import compiled
from uavbench.trajectories.pose import Array, read_only
from uavbench.trajectories.vehicle.quadrotor import GRAVITY_M_S2, STEP_S
from uavbench.trajectories.vehicle.rigid_body import Plant, drag_force

REFERENCE_COLUMNS = 17
"""Reference of one step: position 0:3, velocity 3:6 and acceleration 6:9 in the world; yaw 9; angular velocity
10:13 and acceleration 13:16 in the reference's own body axes; rate of the specific thrust 16 (m/s^3)."""


FASTEST_1_S = 500.0
"""Largest gain of a rate, 1/s: it takes an error away within one step of 2 ms."""
AttitudeGain = Annotated[float, Interval(gt=0, le=FASTEST_1_S**2)]
RateGain = Annotated[float, Interval(gt=0, le=FASTEST_1_S)]


@dataclass(frozen=True)
class Geometric:
    """Gains of the tracking controller; the defaults are those of the Crazyflie's firmware (controller_lee.c).

    There the attitude gains are 0.007, 0.007, 0.008 N m and the rate gains 0.00115, 0.00115, 0.002 N m s for an
    inertia of 1.66e-5, 1.66e-5, 2.93e-5 kg m^2. The integral gain is an addition: it compensates for steady wind.
    """

    position_1_s2: Annotated[float, Interval(gt=0, le=1000)] = 7.0
    velocity_1_s: Annotated[float, Interval(gt=0, le=FASTEST_1_S)] = 4.0
    integral_1_s3: Annotated[float, Interval(ge=0, le=1000)] = 2.0
    integral_limit_m_s2: Annotated[float, Interval(gt=0, le=100)] = 3.0
    attitude_1_s2: tuple[AttitudeGain, AttitudeGain, AttitudeGain] = (422.0, 422.0, 273.0)
    rate_1_s: tuple[RateGain, RateGain, RateGain] = (69.0, 69.0, 68.0)

    def gains(self) -> "Gains":
        """Gains for the compiled control law."""
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


class BodyState(NamedTuple):
    """Motion that the control law reacts to.

    position (m) and velocity (m/s) in the world, R world_from_body, omega the angular velocity in the body (rad/s),
    speed_sum of the four rotors (rad/s).
    """

    position: Vector
    velocity: Vector
    R: Matrix
    omega: Vector
    speed_sum: float


@compiled
def thrust_commands(
    plant: Plant, gains: Gains, reference: Array, state: BodyState, integral: Array, command: Array
) -> None:
    """Fill `command` (4,) with thrusts of the rotors, N, within their limits; update `integral` (3,), m/s^2.

    The drag of the reference motion is fed forward, and the thrust is corrected for the motors' lag.
    """
    R, omega = state.R, state.omega
    x_d, v_d, a_d = vector(reference[0:3]), vector(reference[3:6]), vector(reference[6:9])
    e_x, e_v = subtract(state.position, x_d), subtract(state.velocity, v_d)
    for k in range(3):
        moved = integral[k] - gains.integral * e_x[k] * STEP_S
        integral[k] = min(gains.integral_limit, max(-gains.integral_limit, moved))
    feedback = add(add(scale(-gains.position, e_x), scale(-gains.velocity, e_v)), vector(integral))
    wanted = add(add(a_d, feedback), (0.0, 0.0, GRAVITY_M_S2))
    force = subtract(scale(plant.mass, wanted), drag_force(plant, R, v_d, state.speed_sum))  # (12)
    R_d = attitude(force, reference[9])
    thrust = dot(force, (R[0][2], R[1][2], R[2][2])) + plant.mass * plant.lag * reference[16]  # (15)
    body_from_world = transpose(R)
    omega_d = rotate(body_from_world, rotate(R_d, vector(reference[10:13])))
    alpha_d = rotate(body_from_world, rotate(R_d, vector(reference[13:16])))
    e_R = attitude_error(R, R_d)  # (10)
    e_omega = subtract(omega, omega_d)  # (11)
    feedback = add(multiply(vector(gains.attitude), e_R), multiply(vector(gains.rate), e_omega))
    alpha = subtract(subtract(alpha_d, cross(omega, omega_d)), feedback)
    J = matrix(plant.inertia)
    torque = add(rotate(J, alpha), cross(omega, rotate(J, omega)))  # (16)
    allocate(plant, thrust, torque, command)


@compiled
def attitude(force: Vector, yaw: float) -> Matrix:
    """Rotation whose z axis lies along `force` and whose x axis looks towards `yaw`: (14) and below."""
    b3 = scale(1.0 / length(force), force)
    side = cross(b3, (cos(yaw), sin(yaw), 0.0))
    b2 = scale(1.0 / length(side), side)
    return transpose((cross(b2, b3), b2, b3))


@compiled
def attitude_error(R: Matrix, R_d: Matrix) -> Vector:
    """Half the vector of the skew matrix R_d' R - R' R_d."""
    A, B = transpose(R), transpose(R_d)
    return (
        0.5 * (dot(B[2], A[1]) - dot(A[2], B[1])),
        0.5 * (dot(B[0], A[2]) - dot(A[0], B[2])),
        0.5 * (dot(B[1], A[0]) - dot(A[1], B[0])),
    )


@compiled
def allocate(plant: Plant, thrust: float, torque: Vector, command: Array) -> None:
    """Fill `command` (4,) with thrusts that make a collective thrust and a torque, each within its limits.

    On saturation the collective thrust is reduced before the torques: attitude has priority over height.
    """
    lowest, highest = inf, -inf
    for i in range(4):
        row = plant.unmix[i]
        command[i] = row[0] * thrust + row[1] * torque[0] + row[2] * torque[1] + row[3] * torque[2]
        lowest, highest = min(lowest, command[i]), max(highest, command[i])
    over, under = max(0.0, highest - plant.max_thrust), max(0.0, plant.min_thrust - lowest)
    shift = 0.0
    if over > 0.0 and under == 0.0:
        shift = -min(over, lowest - plant.min_thrust)
    elif under > 0.0 and over == 0.0:
        shift = min(under, plant.max_thrust - highest)
    for i in range(4):
        command[i] = min(plant.max_thrust, max(plant.min_thrust, command[i] + shift))
