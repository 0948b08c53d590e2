"""Airframes: parameters of quadrotors with their sources, each of which makes an MJCF model."""

import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from annotated_types import Ge, Gt

from uavbench.trajectories.camera_mount import Mount
from uavbench.trajectories.errors import UserError

Positive = Annotated[float, Gt(0)]
STRICT: Any = {"strict": True, "allow_inf_nan": False}
"""As tables of a suite: neither texts nor booleans are numbers."""
Sign = Literal[-1, 1]
Planar = tuple[float, float]
Triple = tuple[float, float, float]

TEMPLATE = Path(__file__).with_name("quadrotor.xml")


def x_layout(arm_m: float) -> tuple[Planar, Planar, Planar, Planar]:
    """Rotor positions (x, y) of a symmetric X, metres: front right, back right, back left, front left."""
    d = round(arm_m / np.sqrt(2.0), 9)
    return ((d, -d), (-d, -d), (-d, d), (d, d))


@dataclass(frozen=True)
class Crazyflie:
    """Crazyflie 2.0 as identified by Foerster, System Identification of the Crazyflie 2.0, ETH Zurich 2015.

    Mass, inertia, torque per thrust, motor lag and rotor drag are of that report. thrust_map_n holds c0, c1, c2 of
    T = c0 + c1 w + c2 w^2 (N, w in rad/s): its quadratic of the 16-bit command, with the command replaced by
    its own line w = 0.04077 c + 380.8. The drag of the rotors is -drag * sum(w) * airspeed, by body axis. Rotors are
    counted clockwise from front right; yaw_signs is the sign of each one's reaction torque about z. radius_m is
    that of the sphere that must stay clear of everything. ValueError unless min_thrust_n is below max_thrust_n, and
    for moments of inertia that no body has.
    """

    __pydantic_config__ = STRICT

    mass_kg: Positive = 0.027
    inertia_kg_m2: tuple[Positive, Positive, Positive] = (1.657e-5, 1.666e-5, 2.926e-5)
    rotors_m: tuple[Planar, Planar, Planar, Planar] = x_layout(0.046)
    yaw_signs: tuple[Sign, Sign, Sign, Sign] = (-1, 1, -1, 1)
    torque_per_thrust_m: Positive = 0.00596
    motor_time_constant_s: Positive = 0.065
    min_thrust_n: Annotated[float, Ge(0)] = 0.0
    max_thrust_n: Positive = 0.12
    thrust_map_n: Triple = (-7.2393e-3, 1.55672e-5, 1.281918e-8)
    rotor_drag_kg: Triple = (9.1785e-7, 9.1785e-7, 1.0311e-6)
    body_drag_kg_m: Triple = (0.0, 0.0, 0.0)
    radius_m: Positive = 0.07

    def __post_init__(self) -> None:
        if self.min_thrust_n >= self.max_thrust_n:
            raise ValueError(
                f"min_thrust_n {self.min_thrust_n:g} is not below max_thrust_n {self.max_thrust_n:g}; swap them"
            )
        *less, largest = sorted(self.inertia_kg_m2)
        if not largest <= sum(less) * (1 + 1e-9):
            raise ValueError(
                f"inertia_kg_m2: {largest:g} is larger than the sum of the other two, {sum(less):g}, as of no body; "
                "check the numbers and their order x, y, z"
            )

    def build(self, mount: Mount) -> str:
        """MJCF of the vehicle with a camera on this mount."""
        root = ElementTree.parse(TEMPLATE).getroot()

        def put(tag: str, name: str, **values: object) -> None:
            node = root.find(f".//{tag}[@name='{name}']" if name else f".//{tag}")
            assert node is not None, f"quadrotor.xml has no {tag} {name}"
            node.attrib.update({key: _text(value) for key, value in values.items()})

        put("inertial", "", mass=self.mass_kg, diaginertia=self.inertia_kg_m2)
        put("geom", "frame", size=(0.7 * self.radius_m, 0.7 * self.radius_m, 0.15 * self.radius_m))
        for i, ((x, y), sign) in enumerate(zip(self.rotors_m, self.yaw_signs, strict=True), start=1):
            put("site", f"rotor_{i}", pos=(x, y, 0.0))
            put(
                "general",
                f"motor_{i}",
                gear=(0, 0, 1, 0, 0, sign * self.torque_per_thrust_m),
                dynprm=self.motor_time_constant_s,
                ctrlrange=(self.min_thrust_n, self.max_thrust_n),
            )
        put("numeric", "thrust_map", data=self.thrust_map_n)
        put("numeric", "rotor_drag", data=self.rotor_drag_kg)
        put("numeric", "body_drag", data=self.body_drag_kg_m)
        put("numeric", "radius", data=self.radius_m)
        return with_camera(root, mount)


@dataclass(frozen=True)
class CrazyflieGym(Crazyflie):
    """Crazyflie 2.x in X layout as in gym-pybullet-drones (cf2x.urdf; Panerati et al. 2021).

    Mass, inertia, arm, torque per thrust (7.94e-12 / 3.16e-10), thrust per squared speed (3.16e-10 N/rpm^2) and the
    thrust to weight ratio 2.25; motor lag and drag are Foerster's, since it gives none in that form.
    """

    inertia_kg_m2: tuple[Positive, Positive, Positive] = (1.40e-5, 1.40e-5, 2.17e-5)
    rotors_m: tuple[Planar, Planar, Planar, Planar] = x_layout(0.0397)
    torque_per_thrust_m: Positive = 0.0251
    max_thrust_n: Positive = 0.149
    thrust_map_n: Triple = (0.0, 0.0, 2.882e-8)


@dataclass(frozen=True)
class CrazyflieRotorPy(Crazyflie):
    """Crazyflie 2.x as in RotorPy (crazyflie_params.py; Folk, Paulos & Kumar 2023).

    Thrust 2.3e-8 N s^2 up to 2500 rad/s, moment 7.8e-10 N m s^2, so 0.0339 m. Its Izz of 2.89e-5 exceeds Ixx + Iyy,
    which is physically impossible; here Izz is that sum, 1 % less.
    """

    mass_kg: Positive = 0.030
    inertia_kg_m2: tuple[Positive, Positive, Positive] = (1.43e-5, 1.43e-5, 2.86e-5)
    rotors_m: tuple[Planar, Planar, Planar, Planar] = x_layout(0.043)
    torque_per_thrust_m: Positive = 0.0339
    motor_time_constant_s: Positive = 0.072
    max_thrust_n: Positive = 0.14375
    thrust_map_n: Triple = (0.0, 0.0, 2.3e-8)
    rotor_drag_kg: Triple = (1.02506e-6, 1.02506e-6, 7.553e-7)


@dataclass(frozen=True)
class CrazyflieMenagerie(Crazyflie):
    """Crazyflie 2.x with the mass and inertia of MuJoCo Menagerie's cf2.xml; all else is Foerster's."""

    inertia_kg_m2: tuple[Positive, Positive, Positive] = (2.3951e-5, 2.3951e-5, 3.2347e-5)


@dataclass(frozen=True)
class CrazyflieBrushless(Crazyflie):
    """Crazyflie 2.1 brushless as in drone-models (cf21B_500, University of Toronto); drag is Foerster's.

    Its thrust map is per rpm (2.6713e-6 and 2.9911e-10), here per rad/s.
    """

    mass_kg: Positive = 0.04338
    inertia_kg_m2: tuple[Positive, Positive, Positive] = (2.5e-5, 2.8e-5, 4.9e-5)
    rotors_m: tuple[Planar, Planar, Planar, Planar] = x_layout(0.050)
    torque_per_thrust_m: Positive = 0.00594
    motor_time_constant_s: Positive = 0.08
    min_thrust_n: Annotated[float, Ge(0)] = 0.03
    max_thrust_n: Positive = 0.18
    thrust_map_n: Triple = (0.0, 2.5509e-5, 2.7275e-8)


@dataclass(frozen=True)
class Iris(Crazyflie):
    """3DR Iris, 1.5 kg, as in PX4's Gazebo simulation (sitl_gazebo, iris.sdf; the motor model is RotorS', Furrer 2016).

    Thrust 5.84e-6 N s^2 up to 1100 rad/s, moment 0.06 m, rotor drag 1.75e-4 kg; the motor lag is the slower of the
    two that it gives (speeding up: 0.0125 s). The back rotors are 4 cm closer together than the front ones.
    """

    mass_kg: Positive = 1.5
    inertia_kg_m2: tuple[Positive, Positive, Positive] = (0.029125, 0.029125, 0.055225)
    rotors_m: tuple[Planar, Planar, Planar, Planar] = ((0.13, -0.22), (-0.13, -0.20), (-0.13, 0.20), (0.13, 0.22))
    torque_per_thrust_m: Positive = 0.06
    motor_time_constant_s: Positive = 0.025
    max_thrust_n: Positive = 7.066
    thrust_map_n: Triple = (0.0, 0.0, 5.84e-6)
    rotor_drag_kg: Triple = (1.75e-4, 1.75e-4, 0.0)
    radius_m: Positive = 0.38


def with_camera(root: ElementTree.Element, mount: Mount) -> str:
    """MJCF text of a model whose camera named `camera` is set on this mount; MuJoCo's cameras look along -z, y up."""
    camera = root.find(".//camera[@name='camera']")
    if camera is None:
        body = root.find("./worldbody/body")
        if body is None:
            raise UserError("the MJCF has no body in its worldbody; see quadrotor.xml for the shape of an airframe")
        camera = ElementTree.SubElement(body, "camera", name="camera")
    body_from_cam = mount.cam_from_body.inverse()
    for key in ("quat", "euler", "axisangle", "zaxis"):
        camera.attrib.pop(key, None)
    camera.set("pos", _text(body_from_cam.translation))
    camera.set("xyaxes", _text([*body_from_cam.rotation[:, 0], *-body_from_cam.rotation[:, 1]]))
    return ElementTree.tostring(root, encoding="unicode")


def _text(value: object) -> str:
    return " ".join(f"{float(v):.9g}" for v in np.ravel(np.asarray(value, dtype=np.float64)))


PRESETS: dict[str, type[Crazyflie]] = {
    "crazyflie": Crazyflie,
    "crazyflie-gym": CrazyflieGym,
    "crazyflie-rotorpy": CrazyflieRotorPy,
    "crazyflie-menagerie": CrazyflieMenagerie,
    "crazyflie-brushless": CrazyflieBrushless,
    "iris": Iris,
}
