"""Every parameter of a suite's TOML is found again in the dataset: in its record, and in its files by an own reader."""

import csv
import json
import tomllib

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from uavbench.bench.config.suite import load_suite
from uavbench.scenes.generate import generate

SUITE = """
title = "All that can be said"
seeds = [3]
rates_hz = [10.0]

[sequences.all]
rate_hz = 20.0
structure = { kind = "box", length_m = 0.5, width_m = 0.35, height_m = 0.25 }
environment = { kind = "indoor", floor = "concrete" }
mount = { pitch_deg = -31.0, yaw_deg = 4.0, roll_deg = 2.0, offset_m = [0.03, -0.01, 0.02] }
clutter = [{ kind = "people", density = 0.1, nearest_m = 2.5, furthest_m = 4.0 }]
annotations = ["depth", "mask", "edges", "flow", "normals"]
crlb_every = 4
clock = { jitter_ms = 0.0 }
deviation = { scale_percent = 0.2 }
sensors = [
    { kind = "imu", rate_hz = 1000.0, gyro_bias_rad_s = 0.3, accel_bias_m_s2 = 0.5, offset_m = [0.1, 0.2, -0.3] },
    { kind = "imu-bmi088", rate_hz = 400.0, accel_range_m_s2 = 9.0 },
    { kind = "imu", rate_hz = 50.0, gyro_noise_rad_s_sqrt_hz = 0.0 },
    { kind = "gnss", rate_hz = 10.0, mask_deg = 5.0 },
    { kind = "baro", rate_hz = 25.0, floor_pressure_pa = 90000.0, noise_pa = 0.0 },
    { kind = "range-finder", rate_hz = 40.0, pitch_deg = -90.0, noise_m = 0.0, resolution_m = 0.0, reflectance = 1.0 },
    { kind = "lidar-2d", rate_hz = 10.0, step_deg = 9.0, pitch_deg = -90.0, noise_m = 0.0, offset_m = [0.0, 0.0, 0.1] },
]

[sequences.all.flight]
clearance_m = 0.05
saturation_share = 0.5
airframe = { kind = "crazyflie", mass_kg = 0.03 }
control = { position_1_s2 = 6.0 }
wind = { kind = "steady", speed_m_s = 0.7, from_deg = 30.0 }

[sequences.all.flight.path]
kind = "orbit"
distance_m = 0.8
height_m = 0.9
turns = 0.01
start_deg = 200.0
speed_m_s = 0.4
acceleration_m_s2 = 4.0

[[sequences.all.cameras]]
name = "down"
offset_s = 0.02
mount = { pitch_deg = -80.0, offset_m = [0.0, 0.01, 0.0] }
camera = { width = 64, height = 48 }

[sequences.all.camera]
width = 96
height = 64
fx_px = 70.0
fy_px = 71.0
cx_px = 47.0
cy_px = 31.5
distortion_model = "radtan"
distortion = [-0.05, 0.01, 0.001, -0.001]
lens_blur_px = 0.3

[[sequences.all.effects]]
kind = "rolling-shutter"
readout_ms = 12.6

[[sequences.all.effects]]
kind = "noise"

[trackers]
hold = { kind = "hold" }
"""


@pytest.fixture(scope="module")
def table():
    return tomllib.loads(SUITE)["sequences"]["all"]


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    folder = tmp_path_factory.mktemp("all")
    (folder / "all.toml").write_text(SUITE)
    (spec,) = load_suite(folder / "all.toml").sequences
    generate(spec, folder / "all-s3", content_hash="abc")
    return folder / "all-s3"


@pytest.fixture(scope="module")
def info(dataset):
    return json.loads((dataset / "sequence.json").read_text())


def columns(path):
    with path.open(newline="") as handle:
        rows = list(csv.DictReader(handle))
    return {name: np.array([float(row[name] or "nan") for row in rows]) for name in rows[0]}


def leaves(value, path=()):
    if isinstance(value, dict):
        return [leaf for key, item in value.items() for leaf in leaves(item, (*path, key))]
    if isinstance(value, list):
        return [leaf for k, item in enumerate(value) for leaf in leaves(item, (*path, k))]
    return [(path, value)]


def test_the_record_says_every_parameter(table, info):
    assert len(leaves(table)) > 50
    for path, value in leaves(table):
        said = info["config"]
        for key in path:
            said = said[key]
        assert said == value, path
    assert (info["name"], info["seed"], info["rate_hz"]) == ("all-s3", 3, 20.0)
    assert [len(info["config"][key]) for key in ("sensors", "effects", "clutter")] == [7, 2, 1]


def test_each_sensor_of_the_suite_has_its_file_and_no_other_has_one(table, dataset, info):
    names = ["imu.csv", "imu-bmi088.csv", "imu-2.csv", "gnss.csv", "baro.csv", "range-finder.csv"]
    assert list(info["sensors"]) == [*names, "lidar-2d.npy"]
    assert info["sensors"]["lidar-2d.npy"].items() >= table["sensors"][6].items()
    known = {"groundtruth.csv", "frames.csv", "flight.csv", "edges.csv", "crlb.csv"}
    assert {path.name for path in dataset.glob("*.csv")} == {*names, *known}
    for name, said in zip(names, table["sensors"], strict=False):
        assert info["sensors"][name].items() >= said.items()
        stamps = columns(dataset / name)["stamp_ns"]
        assert np.abs(stamps - np.arange(len(stamps)) * 1e9 / said["rate_hz"]).max() <= 1
        flown = columns(dataset / "flight.csv")["stamp_ns"][-1]
        assert flown - 1e9 / said["rate_hz"] < stamps[-1] <= flown + 1e7


def test_biases_ranges_noise_and_place_of_the_sensors_are_in_their_readings(dataset):
    imu, second = columns(dataset / "imu.csv"), columns(dataset / "imu-2.csv")
    first_bias = [
        imu[f"{kind}_bias_{a}_{unit}"][0] for kind, unit in (("gyro", "rad_s"), ("accel", "m_s2")) for a in "xyz"
    ]
    assert np.abs(first_bias[:3]).max() > 0.05 and np.abs(first_bias[3:]).max() > 0.1
    assert max(abs(second[f"gyro_bias_{a}_rad_s"][0]) for a in "xyz") < 1e-3
    bmi = columns(dataset / "imu-bmi088.csv")
    assert np.abs([bmi[f"a{axis}_m_s2"] for axis in "xyz"]).max() == 9.0  # 9.81 does not fit in its range
    flight = columns(dataset / "flight.csv")
    # The middle one of the IMUs has no noise of its gyroscope: it reads the rates that were flown, and its bias.
    rates = np.column_stack([second[f"w{a}_rad_s"] - second[f"gyro_bias_{a}_rad_s"] for a in "xyz"])
    flown = np.column_stack([flight[f"w{a}_rad_s"] for a in "xyz"])
    same = np.searchsorted(flight["stamp_ns"], second["stamp_ns"])
    assert rates == pytest.approx(flown[same], abs=1e-12)
    # Specific force at the place of the first: f = R' (a - g) + alpha x r + w x (w x r), noise aside.
    R = Rotation.from_quat(np.column_stack([flight[f"q{a}"] for a in "xyzw"]))
    a = np.column_stack([flight[f"a{k}_m_s2"] for k in "xyz"]) + np.array([0, 0, 9.80665])
    alpha = np.column_stack([flight[f"alpha_{k}_rad_s2"] for k in "xyz"])
    r = np.array([0.1, 0.2, -0.3])
    force = R.inv().apply(a) + np.cross(alpha, r) + np.cross(flown, np.cross(flown, r))
    at = np.searchsorted(imu["stamp_ns"], flight["stamp_ns"])
    read = np.column_stack([imu[f"a{k}_m_s2"] - imu[f"accel_bias_{k}_m_s2"] for k in "xyz"])[at]
    assert np.abs(read - force).mean() < 0.1  # 2e-3 m/s^2/sqrt(Hz) at 1000 Hz: 0.063 m/s^2
    baro = columns(dataset / "baro.csv")
    assert baro["pressure_pa"] == pytest.approx(90000 - 90000 / 101325 * 12 * 0.9, abs=2.0)


def test_ranges_are_those_of_the_floor_beneath_the_flight(dataset):
    flight, found = columns(dataset / "flight.csv"), columns(dataset / "range-finder.csv")
    down = Rotation.from_quat(np.column_stack([flight[f"q{a}"] for a in "xyzw"])).apply([0.0, 0.0, -1.0])
    height = np.interp(found["stamp_ns"], flight["stamp_ns"], flight["pz_m"] / -down[:, 2])
    assert found["range_m"] == pytest.approx(height, abs=5e-4)  # linear over 10 ms
    np.testing.assert_array_equal(found["range_m"], found["true_range_m"])
    read, true = (np.load(dataset / f"lidar-2d{end}.npy") for end in ("", "_truth"))
    assert np.diff(read["stamp_ns"][::31]) == pytest.approx(1e8, abs=1)
    ahead = read["azimuth_rad"] == read["azimuth_rad"][np.abs(read["azimuth_rad"]).argmin()]
    # Turned by pitch_deg its x axis looks down, so what is ahead is the floor, from 10 cm above the body.
    beneath = np.interp(read["stamp_ns"][ahead], flight["stamp_ns"], flight["pz_m"] / -down[:, 2]) + 0.1
    assert read["range_00_m"][ahead] == pytest.approx(beneath, abs=2e-3)
    assert np.nanmax(np.abs(read["range_00_m"] - true["true_range_00_m"])) <= 0.0005 + 1e-9


def test_the_second_camera_is_where_and_when_it_was_told(table, dataset, info):
    said, folder = table["cameras"][0], dataset / "cameras" / "down"
    assert list(info["cameras"]) == ["down"]
    turn = Rotation.from_euler("Y", -said["mount"]["pitch_deg"], degrees=True)
    body_from_cam = turn.as_matrix() @ np.array([[0, 0, 1], [-1, 0, 0], [0, -1, 0]])
    found = np.linalg.inv(np.array(info["cameras"]["down"]["cam_from_body"]))
    np.testing.assert_allclose(found[:3, :3], body_from_cam, atol=1e-12)
    np.testing.assert_allclose(found[:3, 3], said["mount"]["offset_m"], atol=1e-12)
    stamps = [int(row["stamp_ns"]) for row in columns_of_text(folder / "frames.csv")]
    assert stamps == [k * 50_000_000 + 20_000_000 for k in range(len(stamps))]
    assert cv2.imread(str(folder / "frames" / "000000.png")).shape == (48, 64, 3)
    main = [int(row["stamp_ns"]) for row in columns_of_text(dataset / "frames.csv")]
    assert main == [k * 50_000_000 for k in range(len(main))]
    truth, flight = columns(folder / "groundtruth.csv"), columns(dataset / "flight.csv")
    rows = np.searchsorted(flight["stamp_ns"], truth["stamp_ns"])
    for name in ("px_m", "pz_m", "qx", "vy_m_s", "wz_rad_s", "ax_m_s2"):
        np.testing.assert_array_equal(truth[name], flight[name][rows])


def test_camera_mount_and_rates_are_in_the_files(table, dataset, info):
    camera, said = tomllib.loads((dataset / "camera.toml").read_text()), table["camera"]
    for name in ("width", "height", "distortion_model", "distortion"):
        assert camera[name] == said[name]
    for name in ("fx", "fy", "cx", "cy"):
        assert camera[name] == said[f"{name}_px"]
    frames = columns_of_text(dataset / "frames.csv")
    stamps = np.array([int(row["stamp_ns"]) for row in frames])
    assert stamps.tolist() == [k * 50_000_000 for k in range(len(stamps))]
    for row in frames:
        assert cv2.imread(str(dataset / row["file"])).shape == (64, 96, 3)
    # The mount from its own words: yaw to the left, then pitch upwards, then roll clockwise as the camera sees.
    mount = table["mount"]
    turn = Rotation.from_euler("ZYX", [mount["yaw_deg"], -mount["pitch_deg"], mount["roll_deg"]], degrees=True)
    body_from_cam = turn.as_matrix() @ np.array([[0, 0, 1], [-1, 0, 0], [0, -1, 0]])
    found = np.linalg.inv(np.array(info["cam_from_body"]))
    np.testing.assert_allclose(found[:3, :3], body_from_cam, atol=1e-12)
    np.testing.assert_allclose(found[:3, 3], mount["offset_m"], atol=1e-12)
    assert info["row_delay_ns"] == pytest.approx(12.6e6 / 63)


def columns_of_text(path):
    with path.open(newline="") as handle:
        return list(csv.DictReader(handle))


def test_structure_path_wind_and_airframe_are_in_the_files(table, dataset):
    rows = [line.split()[1:] for line in (dataset / "model.obj").read_text().splitlines() if line.startswith("v ")]
    vertices = np.array(rows, dtype=float)
    np.testing.assert_allclose(np.ptp(vertices, axis=0), [0.5, 0.35, 0.25], atol=1e-9)
    flight, path = columns(dataset / "flight.csv"), table["flight"]["path"]
    place = np.column_stack([flight["px_m"], flight["py_m"]])
    reach = np.hypot(0.25, 0.175)
    assert np.linalg.norm(place, axis=1) == pytest.approx(reach + path["distance_m"], abs=0.02)
    assert flight["pz_m"] == pytest.approx(path["height_m"], abs=0.02)
    assert np.degrees(np.arctan2(*place[0][::-1])) % 360 == pytest.approx(path["start_deg"], abs=1.0)
    turned = np.degrees(np.arctan2(*place[-1][::-1])) % 360 - path["start_deg"]
    assert turned == pytest.approx(360 * path["turns"], abs=0.5)
    wind = table["flight"]["wind"]
    assert np.hypot(flight["wind_x_m_s"], flight["wind_y_m_s"]) == pytest.approx(wind["speed_m_s"], abs=1e-9)
    thrust = sum(flight[f"thrust_{k}_n"] for k in (1, 2, 3, 4))
    assert thrust.mean() == pytest.approx(0.03 * 9.80665, rel=0.05)


def test_the_flight_in_the_record_is_that_of_the_files(table, dataset, info):
    flight, said = columns(dataset / "flight.csv"), info["flight"]
    assert (said["path"], said["speed_asked_m_s"], said["duration_asked_s"]) == ("orbit", 0.4, None)
    assert said["duration_s"] == pytest.approx(flight["stamp_ns"][-1] / 1e9, abs=0.01)
    speeds = np.linalg.norm([flight[f"v{a}_m_s"] for a in "xyz"], axis=0)
    assert said["speed_flown_m_s"] == pytest.approx(speeds.max(), rel=0.02)
    steps = np.diff([flight[f"p{a}_m"] for a in "xyz"], axis=1)
    assert said["length_m"] == pytest.approx(np.linalg.norm(steps, axis=0).sum(), abs=0.01)


def test_what_truth_and_crlb_ask_for_is_there(dataset):
    frames = len(columns_of_text(dataset / "frames.csv"))
    for folder, suffix in (("depth", "png"), ("mask", "png"), ("edges", "csv")):
        assert len(list((dataset / folder).glob(f"*.{suffix}"))) == frames
    counts = [len(list((dataset / folder).glob("*.png"))) for folder in ("flow", "occlusion", "normals")]
    assert counts == [frames - 1, frames - 1, frames]
    assert {int(row["frame"]) for row in columns_of_text(dataset / "crlb.csv")} <= set(range(0, frames, 4))


@pytest.mark.parametrize(
    ("line", "told"),
    [
        (
            'flight.sensors = [{ kind = "imu" }]',
            "flight.sensors: unknown key here; did you mean 'sequences.a.sensors'?",
        ),
        (
            'flight.path = { kind = "recorded", path = "a.tum" }',
            "sequences.a.flight.path.path: unknown key (valid: file, format, frame)",
        ),
        ("flight.mount = { pitch_deg = 3.0 }", "flight.mount: unknown key here; did you mean 'sequences.a.mount'?"),
        ('wind = { kind = "still" }', "a.wind: unknown key here; did you mean 'sequences.a.flight.wind'?"),
        ("rates_hz = [3.0]", "a.rates_hz: unknown key here; 'rates_hz' is a key of the suite"),
    ],
)
def test_a_key_in_the_wrong_table_names_the_right_one(tmp_path, line, told):
    text = SUITE.split("[sequences.all]")[0] + '[sequences.a]\nstructure = { kind = "box" }\n'
    text += f'environment = {{ kind = "indoor" }}\n{line}\n[trackers]\nhold = {{ kind = "hold" }}\n'
    (tmp_path / "a.toml").write_text(text)
    with pytest.raises(Exception) as caught:
        load_suite(tmp_path / "a.toml")
    assert told in str(caught.value)
