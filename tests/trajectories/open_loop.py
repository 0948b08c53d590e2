"""Flights without a controller, for tests against closed forms."""

import numpy as np

from uavbench.trajectories.camera_mount import Mount
from uavbench.trajectories.geometry.vectors import rotation
from uavbench.trajectories.vehicle.quadrotor import Quadrotor, compile_mjcf, physics
from uavbench.trajectories.vehicle.registry import AirframeSpec
from uavbench.trajectories.vehicle.rigid_body import drag_force, plant, rotor_speed_sum


def coast(
    airframe: AirframeSpec,
    commands: np.ndarray,
    thrusts: float = 0.0,
    wind: tuple[float, float, float] = (0.0, 0.0, 0.0),
    spin: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> np.ndarray:
    """State (n + 1, 17) under commanded thrusts (n, 4): position, quaternion, velocity, body rates, thrusts."""
    vehicle = Quadrotor.from_mjcf(airframe.build(Mount()))
    numbers = plant(vehicle)
    mujoco = physics()
    model = compile_mjcf(vehicle.xml)
    data = mujoco.MjData(model)
    data.qpos[:] = [0, 0, 100, 1, 0, 0, 0]
    data.qvel[3:] = spin
    data.act[:] = thrusts
    states = [np.concatenate([data.qpos, data.qvel, data.act])]
    for command in commands:
        speeds = rotor_speed_sum(numbers, data.act)
        airspeed = tuple(data.qvel[:3] - wind)
        data.xfrc_applied[1, :3] = drag_force(numbers, rotation(data.qpos[3:7]), airspeed, speeds)
        data.ctrl[:] = command
        mujoco.mj_step(model, data)
        states.append(np.concatenate([data.qpos, data.qvel, data.act]))
    return np.array(states)
