from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tests.trajectories.open_loop import coast
from tests.trajectories.scene import BOX
from uavbench.trajectories.camera_mount import Mount
from uavbench.trajectories.paths.around import FigureEight
from uavbench.trajectories.pose import rotation_from_quaternion
from uavbench.trajectories.simulation.flight import FlightSpec, fly
from uavbench.trajectories.vehicle.airframes import Crazyflie, Iris
from uavbench.trajectories.vehicle.quadrotor import GRAVITY_M_S2, STEP_S, Quadrotor
from uavbench.trajectories.wind.winds import Dryden

NO_DRAG = replace(Crazyflie(), rotor_drag_kg=(0.0, 0.0, 0.0))
OFF = np.zeros((1000, 4))


def test_free_fall() -> None:
    states = coast(NO_DRAG, OFF)
    t = np.arange(1001) * STEP_S
    np.testing.assert_allclose(states[:, 2], 100 - GRAVITY_M_S2 * t**2 / 2, atol=1e-10)
    np.testing.assert_allclose(states[:, 9], -GRAVITY_M_S2 * t, atol=1e-10)


@pytest.mark.parametrize("airframe", [Crazyflie(), Iris()])
def test_hover_thrust_holds_the_vehicle(airframe: Crazyflie) -> None:
    thrust = airframe.mass_kg * GRAVITY_M_S2 / 4
    states = coast(airframe, np.full((1000, 4), thrust), thrusts=thrust)
    np.testing.assert_allclose(states[-1, :3], [0, 0, 100], atol=1e-9)
    assert Quadrotor.from_mjcf(airframe.build(Mount())).hover_thrust_n == pytest.approx(thrust)


def test_yaw_torque_turns_at_the_closed_form_rate() -> None:
    hover, more = NO_DRAG.mass_kg * GRAVITY_M_S2 / 4, 0.005
    commands = np.tile(hover + more * np.array(NO_DRAG.yaw_signs), (500, 1))
    states = coast(NO_DRAG, commands, thrusts=hover)
    t, lag = np.arange(501) * STEP_S, NO_DRAG.motor_time_constant_s
    torque = 4 * more * NO_DRAG.torque_per_thrust_m
    expected = torque / NO_DRAG.inertia_kg_m2[2] * (t - lag * (1 - np.exp(-t / lag)))
    np.testing.assert_allclose(states[:, 12], expected, rtol=2e-3, atol=1e-3)
    np.testing.assert_allclose(states[:, 10:12], 0, atol=1e-12)


def test_front_right_thrust_rolls_left_and_pitches_up() -> None:
    hover = NO_DRAG.mass_kg * GRAVITY_M_S2 / 4
    commands = np.tile([hover + 0.002, hover, hover, hover], (5, 1))
    omega = coast(NO_DRAG, commands, thrusts=hover)[-1, 10:13]
    assert omega[0] < 0 and omega[1] < 0 and omega[2] < 0  # right side up, nose up, counter-clockwise rotor


def test_motor_step_response() -> None:
    states = coast(NO_DRAG, np.full((200, 4), 0.1))
    t = np.arange(201) * STEP_S
    expected = 0.1 * (1 - np.exp(-t / NO_DRAG.motor_time_constant_s))
    np.testing.assert_allclose(states[:, 13:], np.repeat(expected[:, None], 4, axis=1), rtol=1e-7, atol=1e-12)


def test_terminal_speed_of_body_drag() -> None:
    falling = replace(NO_DRAG, body_drag_kg_m=(0.0, 0.0, 0.01))
    states = coast(falling, np.zeros((2000, 4)))
    t = np.arange(2001) * STEP_S
    terminal = np.sqrt(falling.mass_kg * GRAVITY_M_S2 / 0.01)
    np.testing.assert_allclose(states[:, 9], -terminal * np.tanh(GRAVITY_M_S2 * t / terminal), atol=5e-3)
    assert states[-1, 9] == pytest.approx(-terminal, rel=1e-6)


def test_rotor_drag_takes_the_vehicle_along_with_the_wind() -> None:
    frame = Crazyflie()
    hover = frame.mass_kg * GRAVITY_M_S2 / 4
    states = coast(frame, np.full((2000, 4), hover), thrusts=hover, wind=(3.0, -2.0, 0.0))
    speeds = 4 * Quadrotor.from_mjcf(frame.build(Mount())).rotor_speeds(np.array(hover))
    assert frame.rotor_drag_kg[0] * speeds == pytest.approx(6.8e-3, rel=0.02)  # N per m/s, as Foerster measured
    rate = frame.rotor_drag_kg[0] * speeds / frame.mass_kg
    share = 1 - np.exp(-rate * np.arange(2001) * STEP_S)
    np.testing.assert_allclose(states[:, 7:9], share[:, None] * [3.0, -2.0], atol=2e-3)


def test_a_spinning_body_keeps_its_angular_momentum() -> None:
    states = coast(NO_DRAG, np.zeros((1000, 4)), spin=(8.0, -3.0, 5.0))
    momentum = np.einsum(
        "nij,nj->ni", rotation_from_quaternion(states[:, 3:7]), states[:, 10:13] * np.array(NO_DRAG.inertia_kg_m2)
    )
    np.testing.assert_allclose(
        momentum, np.tile(momentum[0], (1001, 1)), rtol=0, atol=1e-6 * np.linalg.norm(momentum[0])
    )


def test_another_integrator_gives_the_same_flight() -> None:
    """The record's commands and winds, integrated by scipy from equations written out again, meet its states."""
    frame = Crazyflie()
    spec = FlightSpec(path=FigureEight(loops=1), airframe=frame, wind=Dryden(w20_m_s=4.0))
    flight = fly(spec, Mount(), BOX, seed=3)
    J, d, (c0, c1, c2) = np.array(frame.inertia_kg_m2), np.array(frame.rotor_drag_kg), frame.thrust_map_n
    xy = np.array(frame.rotors_m)
    torque_of = np.array([xy[:, 1], -xy[:, 0], frame.torque_per_thrust_m * np.array(frame.yaw_signs)])

    def motion(t: float, s: np.ndarray, command: np.ndarray, wind: np.ndarray) -> np.ndarray:
        v, (w, x, y, z), omega, thrust = s[3:6], s[6:10] / np.linalg.norm(s[6:10]), s[10:13], s[13:17]
        R = np.array(
            [
                [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
                [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
                [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z],
            ]
        )
        rotors = ((np.sqrt(c1**2 - 4 * c2 * (c0 - thrust)) - c1) / (2 * c2)).sum()
        a = (R @ ([0, 0, thrust.sum()] - rotors * d * (R.T @ (v - wind)))) / frame.mass_kg - [0, 0, GRAVITY_M_S2]
        q_dot = 0.5 * np.array(
            [
                -x * omega[0] - y * omega[1] - z * omega[2],
                w * omega[0] + y * omega[2] - z * omega[1],
                w * omega[1] + z * omega[0] - x * omega[2],
                w * omega[2] + x * omega[1] - y * omega[0],
            ]
        )
        alpha = (torque_of @ thrust - np.cross(omega, J * omega)) / J
        return np.concatenate([v, a, q_dot, alpha, (command - thrust) / frame.motor_time_constant_s])

    begin, end = 2000, 3000  # two seconds in the middle of the eight
    rows = np.column_stack(
        [
            flight.positions_m,
            flight.velocities_m_s,
            flight.quaternions_wxyz,
            flight.angular_velocities_rad_s,
            flight.thrusts_n,
        ]
    )
    state = rows[begin]
    for k, _ in pairwise(range(begin, end + 1)):
        inputs = (flight.thrust_commands_n[k], flight.winds_m_s[k])
        state = solve_ivp(motion, (0, STEP_S), state, "RK45", args=inputs, rtol=1e-9, atol=1e-12).y[:, -1]
    np.testing.assert_allclose(state[:3], rows[end, :3], atol=5e-5)
    np.testing.assert_allclose(state[3:6], rows[end, 3:6], atol=1e-4)
    np.testing.assert_allclose(state[6:10], rows[end, 6:10], atol=1e-9)
