import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pytest

from tests.trajectories.scene import BOX
from uavbench.trajectories.camera_mount import Mount
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.paths.around import Hover
from uavbench.trajectories.simulation.flight import FlightSpec, fly
from uavbench.trajectories.vehicle.airframe_file import AirframeFile
from uavbench.trajectories.vehicle.airframes import PRESETS, TEMPLATE, Crazyflie, Iris
from uavbench.trajectories.vehicle.quadrotor import Quadrotor, compile_mjcf, physics


def test_the_mjcf_stands_on_its_own_and_is_the_crazyflie() -> None:
    mujoco = physics()
    alone = mujoco.MjModel.from_xml_path(str(TEMPLATE))
    assert (alone.nu, alone.ncam, alone.nsite) == (4, 1, 4)
    made = compile_mjcf(Crazyflie().build(Mount()))
    for field in ("body_mass", "body_inertia", "site_pos", "actuator_gear", "actuator_ctrlrange", "numeric_data"):
        np.testing.assert_allclose(getattr(alone, field), getattr(made, field), rtol=1e-6, atol=1e-12, err_msg=field)
    np.testing.assert_allclose(alone.cam_quat, made.cam_quat, atol=1e-12)
    assert alone.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4 and alone.opt.timestep == 0.002
    data = mujoco.MjData(alone)
    data.ctrl[:] = data.act[:] = 0.027 * 9.80665 / 4
    for _ in range(500):
        mujoco.mj_step(alone, data)
    np.testing.assert_allclose(data.qpos[:3], [0, 0, 0.5], atol=1e-6)


@pytest.mark.parametrize("name", PRESETS)
def test_every_preset_hovers_with_thrust_to_spare_and_names_its_source(name: str) -> None:
    kind = PRESETS[name]
    vehicle = Quadrotor.from_mjcf(kind().build(Mount()))
    assert 1.5 < 4 * vehicle.max_thrust_n / (vehicle.mass_kg * 9.81) < 4.0
    assert any(year in (kind.__doc__ or "") for year in ("2015", "2021", "2023", "2016", "Menagerie", "drone-models"))
    spec = FlightSpec(path=Hover(duration_s=1.0, distance_m=2.0), airframe=kind())
    assert fly(spec, Mount(), BOX, 0).status == "completed"


def test_the_camera_of_the_model_sits_on_its_mount() -> None:
    mount = Mount(pitch_deg=-20.0, yaw_deg=15.0, offset_m=(0.03, 0.0, -0.01))
    model = compile_mjcf(Iris().build(mount))
    data = physics().MjData(model)
    data.qpos[3:7] = [1, 0, 0, 0]
    physics().mj_forward(model, data)
    body_from_cam = mount.cam_from_body.inverse()
    np.testing.assert_allclose(data.cam_xpos[0] - data.xpos[1], body_from_cam.translation, atol=1e-9)
    looking = -data.cam_xmat[0].reshape(3, 3)[:, 2]
    np.testing.assert_allclose(looking, body_from_cam.rotation[:, 2], atol=1e-9)


def test_a_vehicle_of_ones_own_from_toml(tmp_path: Path) -> None:
    path = tmp_path / "heavy.toml"
    path.write_text('like = "iris"\nmass_kg = 1.9\ninertia_kg_m2 = [0.03, 0.03, 0.05]\n')
    vehicle = Quadrotor.from_mjcf(AirframeFile(str(path)).build(Mount()))
    assert vehicle.mass_kg == 1.9 and vehicle.max_thrust_n == Iris().max_thrust_n
    np.testing.assert_allclose(np.diag(vehicle.inertia_kg_m2), [0.03, 0.03, 0.05])
    spec = FlightSpec(path=Hover(duration_s=1.0, distance_m=3.0), airframe=AirframeFile(str(path)))
    assert fly(spec, Mount(), BOX, 0).status == "completed"


def test_a_vehicle_of_ones_own_from_mjcf(tmp_path: Path) -> None:
    root = ElementTree.fromstring(TEMPLATE.read_text())
    body = root.find(".//body")
    assert body is not None
    body.find("inertial").attrib.update(mass="0.03", euler="0.1 0.2 0.3")  # type: ignore[union-attr]
    body.remove(body.find("camera"))  # type: ignore[arg-type]
    path = tmp_path / "mine.xml"
    path.write_text(ElementTree.tostring(root, encoding="unicode"))
    vehicle = Quadrotor.from_mjcf(AirframeFile(str(path)).build(Mount(pitch_deg=-10.0)))
    assert vehicle.mass_kg == 0.03
    np.testing.assert_allclose(np.linalg.eigvalsh(vehicle.inertia_kg_m2), [1.657e-5, 1.666e-5, 2.926e-5])
    assert np.abs(vehicle.inertia_kg_m2[0, 2]) > 1e-7
    spec = FlightSpec(path=Hover(duration_s=1.0), airframe=AirframeFile(str(path)))
    assert fly(spec, Mount(), BOX, 0).status == "completed"


@pytest.mark.parametrize(
    ("name", "text", "told"),
    [
        ("a.toml", "mass = 1.0\n", r"a\.toml: unknown key 'mass'; did you mean 'mass_kg'"),
        ("a.toml", "mass_kg = -1.0\n", r"a\.toml: mass_kg: .*greater than 0"),
        ("a.toml", "mass_kg = \n", r"a\.toml: not valid TOML"),
        ("a.toml", 'like = "iriss"\n', r"unknown airframe `like` 'iriss'; did you mean 'iris'"),
        (
            "a.toml",
            "inertia_kg_m2 = [1e-5, 1e-5, 9e-5]\n",
            r"a\.toml: inertia_kg_m2: 9e-05 is larger than the sum of the other two, 2e-05",
        ),
        (
            "a.toml",
            "rotors_m = [[0.03, -0.03], [0.03, -0.03], [-0.03, 0.03], [0.03, 0.03]]\n",
            r"a\.toml: .*rotors would have to give .* N to hover without turning.*check rotors_m",
        ),
        ("a.toml", "yaw_signs = [1, 1, 1, 1]\n", r"a\.toml: .*independently"),
        ("a.toml", "mass_kg = 27.0\n", r"a\.toml: .*give 0 to 0\.48 N, and its weight is 264\.8 N.*check mass_kg"),
        ("a.toml", "max_thrust_n = 12.0\n", r"a\.toml: .*at least 1 / 50 of the most"),
        ("a.toml", "min_thrust_n = 0.1\n", r"a\.toml: .*give 0\.4 to 0\.48 N, and its weight is 0\.2648 N"),
        ("a.toml", "inertia_kg_m2 = [16.57, 16.66, 29.26]\n", r"a\.toml: .*1 g cm\^2 is 1e-7"),
        (
            "a.toml",
            "rotors_m = [[33, -33], [-33, -33], [-33, 33], [33, 33]]\n",
            r"a\.toml: .*rotors_m and radius_m in metres",
        ),
        ("a.toml", "radius_m = 0.04\n", r"a\.toml: .*rotors lie up to 0\.046 m from its middle"),
        ("a.toml", "radius_m = 70.0\n", r"a\.toml: .*radius_m 70 is more than 100 times 0\.0329 m.*in metres"),
        ("a.toml", "radius_m = 7.0\n", r"a\.toml: .*radius_m 7 is more than 100 times"),
        ("a.toml", "inertia_kg_m2 = [1.7e-9, 1.7e-9, 2.9e-9]\n", r"a\.toml: .*check the units of inertia_kg_m2"),
        ("a.toml", "torque_per_thrust_m = 5.96\n", r"a\.toml: .*torque_per_thrust_m 5\.96 is not below radius_m 0\.07"),
        ("a.toml", "torque_per_thrust_m = 1e-9\n", r"a\.toml: .*torque_per_thrust_m 1e-09 is .*less than 0\.001 of it"),
        ("a.toml", "torque_per_thrust_m = 1e300\n", r"a\.toml: .*torque_per_thrust_m 1e\+300 is not below radius_m"),
        ("a.toml", "radius_m = 1e300\n", r"a\.toml: .*radius_m 1e\+300 is more than 100 times"),
        (
            "a.toml",
            "rotors_m = [[3e-5, -3e-5], [-3e-5, -3e-5], [-3e-5, 3e-5], [3e-5, 3e-5]]\n",
            r"a\.toml: .*rotors lie up to 3e-05 m before .*it hardly turns; give rotors_m in metres",
        ),
        ("a.toml", "thrust_map_n = [-1.0, 1.0, 1.0]\n", r"a\.toml: .*rotor speeds of .* not 10 or more"),
        (
            "a.toml",
            "rotor_drag_kg = [1e9, 1e9, 1e9]\n",
            r"a\.toml: .*rotor_drag_kg .* has more than .*the rad/s of all",
        ),
        ("a.toml", "body_drag_kg_m = [1e9, 1e9, 1e9]\n", r"a\.toml: .*body_drag_kg_m .* has more than 0\.189"),
        ("a.toml", "motor_time_constant_s = 65.0\n", r"a\.toml: .*give it in seconds"),
        ("a.toml", "motor_time_constant_s = 1e-9\n", r"a\.toml: .*give it in seconds"),
        ("a.toml", "thrust_map_n = [0.0, 0.0, 3.16e-10]\n", r"a\.toml: .*at most 10000; .*of rpm: c1 times 9\.549"),
        ("a.toml", "thrust_map_n = [0.0, 0.0, -1e-8]\n", r"a\.toml: .*c2 above 0"),
        ("a.toml", "thrust_map_n = [0.0, 0.0, 0.0]\n", r"a\.toml: .*c2 above 0"),
        ("a.toml", "thrust_map_n = [0.0, nan, 1e-8]\n", r"a\.toml: thrust_map_n\.1: .*finite number, got nan"),
        ("a.toml", "torque_per_thrust_m = inf\n", r"a\.toml: torque_per_thrust_m: .*finite number, got inf"),
        ("a.toml", "rotors_m = [[nan, 0], [0, 1], [1, 0], [1, 1]]\n", r"a\.toml: rotors_m\.0\.0: .*finite number"),
        ("a.toml", 'mass_kg = "0.03"\n', r"a\.toml: mass_kg: .*valid number, got '0\.03'"),
        ("a.toml", "mass_kg = true\n", r"a\.toml: mass_kg: .*valid number, got True"),
        ("a.toml", 'rotor_drag_kg = ["0", 0, 0]\n', r"a\.toml: rotor_drag_kg\.0: .*valid number, got '0'"),
        (
            "a.toml",
            "rotor_drag_kg = [-1e-6, -1e-6, -1e-6]\n",
            r"a\.toml: .*rotor_drag_kg .*positive numbers, which brake",
        ),
        ("a.toml", "body_drag_kg_m = [0.0, -1.0, 0.0]\n", r"a\.toml: .*body_drag_kg_m .*positive numbers"),
        ("a.toml", "yaw_signs = [-2, 2, -2, 2]\n", r"a\.toml: yaw_signs\.0: Input should be -1 or 1"),
        ("a.xml", "<mujoco>", r"a\.xml: not valid XML"),
        ("a.xml", "<mujoco/>", r"a\.xml: the MJCF has no body"),
        (
            "a.xml",
            "<mujoco><worldbody><body><geom size='1'/></body></worldbody></mujoco>",
            "one body on one free joint",
        ),
    ],
)
def test_a_bad_airframe_file_is_named_with_its_key(name: str, text: str, told: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises(UserError, match=told):
        AirframeFile(str(path)).build(Mount())


@pytest.mark.parametrize(
    ("what", "told"),
    [
        ('<size memory="900G"/>', "<size>"),
        ('<worldbody><replicate count="100000000"><geom size="1"/></replicate></worldbody>', "<replicate>"),
        ('<asset><hfield name="h" nrow="60000" ncol="60000" size="1 1 1 1"/></asset>', "<hfield>"),
        ('<asset><texture name="t" type="2d" builtin="flat" width="99999" height="99999"/></asset>', "<texture>"),
        ('<custom><numeric name="n" size="2000000000"/></custom>', "<numeric>"),
        ('<extension><plugin plugin="any"/></extension>', "<extension>"),
        ("<worldbody>" + '<geom size="1"/>' * 60_000 + "</worldbody>", r"a\.xml: it has 60,\d+ elements, more than"),
        ("<worldbody>" + "<body>" * 900 + "</body>" * 900 + "</worldbody>", "nested deeper than 64"),
        ("<worldbody>" + "<body>" * 50_000 + "</body>" * 50_000 + "</worldbody>", "it has 50,... elements"),
        (
            "<worldbody><body " + " ".join(f'a{k}="1"' for k in range(200_000)) + "/></worldbody>",
            "more than 100 attributes",
        ),
    ],
)
def test_an_airframe_that_grows_beyond_its_text_is_refused(what: str, told: str, tmp_path: Path) -> None:
    path = tmp_path / "a.xml"
    path.write_text(TEMPLATE.read_text().replace("<custom>", f"{what}<custom>", 1))
    with pytest.raises(UserError, match=told):
        AirframeFile(str(path)).build(Mount())


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ('dyntype="filter"', 'dyntype="integrator"', 'dyntype="filter"'),
        ('name="rotor_drag"', 'name="drag"', 'numeric name="rotor_drag"'),
        ('inertial pos="0 0 0"', 'inertial pos="0 0 0.1"', "centre of mass"),
        ('gear="0 0 1 0 0 -0.00596"', 'gear="0 1 0 0 0 -0.00596"', "push along the body's z axis"),
        ('gear="0 0 1 0 0 -0.00596"', 'gear="0 0 1 0 0 nan"', "finite torques"),
        ('ctrlrange="0 0.12"', 'ctrlrange="-1 0.12"', "ctrlrange"),
        ('mass="0.027"', 'mass="1e-15"', r"a\.xml: .*mass must be from 0\.0001 to 10000 kg, not 1e-15"),
        ('mass="0.027"', 'mass="1e300"', r"a\.xml: .*mass must be"),
        ('mass="0.027"', 'mass="27"', r"a\.xml: .*its weight is 264\.8 N"),
        ('data="0.07"', 'data="0.01"', r"a\.xml: .*outside of its radius of 0\.01 m"),
        (
            'diaginertia="1.657e-05 1.666e-05 2.926e-05"',
            'diaginertia="1e-14 1e-14 1e-14"',
            r"a\.xml: .*inertia must be",
        ),
        (
            'diaginertia="1.657e-05 1.666e-05 2.926e-05"',
            'diaginertia="1e200 1e200 1e200"',
            r"a\.xml: .*inertia must be",
        ),
    ],
)
def test_an_mjcf_that_is_no_quadrotor_is_told_why(old: str, new: str, told: str, tmp_path: Path) -> None:
    path = tmp_path / "a.xml"
    path.write_text(TEMPLATE.read_text().replace(old, new))
    with pytest.raises(UserError, match=told):
        AirframeFile(str(path)).build(Mount())
    with pytest.raises(UserError, match="no such file"):
        AirframeFile(str(tmp_path / "none.toml")).build(Mount())


def test_a_warning_of_mujoco_leaves_no_file_behind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It would append to MUJOCO_LOG.TXT in the user's folder."""
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ValueError, match="nan"):
        physics().MjModel.from_xml_string('<mujoco><worldbody><body><geom size="nan"/></body></worldbody></mujoco>')
    assert list(tmp_path.iterdir()) == []
