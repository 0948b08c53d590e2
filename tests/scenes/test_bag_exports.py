"""Every number of a bag, read by readers that did not write it, is that of the suite, the camera and the flight.

MCAP is read by the libraries mcap and mcap-ros2-support, rosbag2 by SQLite and the latter's decoder; uavbench writes
with rosbags.
"""

import hashlib
import json
import sqlite3
import sys
from dataclasses import replace

import cv2
import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.records import Schema
from mcap_ros2.decoder import DecoderFactory
from scipy.spatial.transform import Rotation

from tests.scenes.test_exports_by_own_readers import (
    LENS,
    PLAIN,
    bodies,
    cam_from_body,
    image,
    notes,
    numbers,
    rendered,
    stamps,
    suite,
    table,
)
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.scenes.exports import shown_images
from uavbench.scenes.exports.registry import export
from uavbench.scenes.exports.ros import bag as bag_module
from uavbench.scenes.exports.ros.bag_messages import header, link_of
from uavbench.scenes.exports.ros.geodetic import Datum
from uavbench.trajectories.errors import DiskError, UserError

GNSS = '{ kind = "gnss", north_deg = 30.0, rate_hz = 10.0 },'


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    text = PLAIN.replace('{ kind = "baro" },', f'{{ kind = "baro", noise_pa = 1.5 }}, {GNSS}')
    text = text.rstrip().removesuffix("]") + '{ kind = "flow" }]\n'
    return rendered(tmp_path_factory.mktemp("plain"), text)


@pytest.fixture(scope="module", params=["mcap", "rosbag2"])
def bag(request, plain, tmp_path_factory):
    folder = tmp_path_factory.mktemp(request.param) / "out"
    export(Sequence.load(plain), request.param, folder)
    return folder


@pytest.fixture(scope="module")
def lens(tmp_path_factory):
    text = LENS.replace("MODEL", "radtan").replace("COEFFICIENTS", "[-0.2, 0.05, 0.001, -0.002]")
    text = text.replace("turns = 0.02", "turns = 0.005")
    return Sequence.load(rendered(tmp_path_factory.mktemp("lens"), text))


@pytest.fixture(scope="module")
def messages(bag):
    return read(bag)


def read(folder):
    """Messages (time of recording, message) by topic."""
    return of_mcap(folder / "bag.mcap") if (folder / "bag.mcap").exists() else of_sqlite(folder / "bag" / "bag.db3")


def of_mcap(path):
    found = {}
    with path.open("rb") as handle:
        reader = make_reader(handle, decoder_factories=[DecoderFactory()], validate_crcs=True)
        assert reader.get_header().profile == "ros2"
        for _, channel, record, message in reader.iter_decoded_messages(log_time_order=False):
            assert record.log_time == record.publish_time
            found.setdefault(channel.topic, []).append((record.log_time, message))
    return found


def of_sqlite(path):
    found = {}
    with sqlite3.connect(path) as base:
        texts = dict(base.execute("SELECT topic_type, encoded_message_definition FROM message_definitions"))
        for number, name, kind, form in base.execute("SELECT id, name, type, serialization_format FROM topics"):
            assert form == "cdr"
            decode = DecoderFactory().decoder_for(
                "cdr", Schema(id=1, name=kind, encoding="ros2msg", data=texts[kind].encode())
            )
            rows = base.execute("SELECT timestamp, data FROM messages WHERE topic_id = ? ORDER BY id", (number,))
            found[name] = [(time, decode(data)) for time, data in rows]
    return found


def ns(header):
    return header.stamp.sec * 10**9 + header.stamp.nanosec


def matrix(p, q):
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = Rotation.from_quat([q.x, q.y, q.z, q.w]).as_matrix(), [p.x, p.y, p.z]
    return out


def xyz(v):
    return [v.x, v.y, v.z]


def test_topics_are_recorded_when_their_headers_say_and_in_order(messages):
    assert set(messages) == {
        "/tf_static", "/tf", "/odom", "/camera/camera_info", "/camera/image_raw", "/camera/image_raw/compressed",
        "/imu/data_raw", "/imu_bmi088/data_raw", "/gnss/fix", "/baro/pressure",
    }  # fmt: skip
    for name, found in messages.items():
        times = [time for time, _ in found]
        assert times == sorted(times)
        if not name.startswith("/tf"):
            assert times == [ns(message.header) for _, message in found]


def test_images_are_those_of_the_sequence(plain, messages):
    originals = [plain / name for name in table(plain / "frames.csv")["file"]]
    assert [time for time, _ in messages["/camera/image_raw"]] == stamps(plain / "frames.csv")
    for original, (_, raw), (_, packed) in zip(
        originals, messages["/camera/image_raw"], messages["/camera/image_raw/compressed"], strict=True
    ):
        pixels = np.frombuffer(raw.data, np.uint8).reshape(raw.height, raw.step)
        assert (raw.encoding, raw.step, raw.is_bigendian) == ("bgr8", 3 * raw.width, 0)
        np.testing.assert_array_equal(pixels.reshape(raw.height, raw.width, 3), image(original))
        assert packed.format == "png"
        assert hashlib.sha256(bytes(packed.data)).digest() == hashlib.sha256(original.read_bytes()).digest()
        assert raw.header.frame_id == packed.header.frame_id == "camera_optical_frame"


def test_the_camera_is_that_of_the_suite(plain, messages):
    asked = suite(plain)["camera"]
    fx, fy, cx, cy = (asked[f"{name}_px"] for name in ("fx", "fy", "cx", "cy"))
    assert [time for time, _ in messages["/camera/camera_info"]] == stamps(plain / "frames.csv")
    for _, info in messages["/camera/camera_info"]:
        assert (info.width, info.height, info.distortion_model) == (asked["width"], asked["height"], "plumb_bob")
        assert list(info.d) == [0.0] * 5
        assert list(info.k) == [fx, 0, cx, 0, fy, cy, 0, 0, 1]
        assert list(info.r) == np.eye(3).ravel().tolist()
        assert list(info.p) == [fx, 0, cx, 0, 0, fy, cy, 0, 0, 0, 1, 0]
        assert (info.binning_x, info.binning_y, info.header.frame_id) == (0, 0, "camera_optical_frame")
        whole = info.roi  # all zeros: the whole image (sensor_msgs/CameraInfo)
        assert [whole.x_offset, whole.y_offset, whole.height, whole.width, whole.do_rectify] == [0, 0, 0, 0, False]


def test_odometry_and_transforms_are_the_ground_truth(plain, messages):
    odometry = dict(messages["/odom"])
    assert sorted(odometry) == sorted({*stamps(plain / "flight.csv"), *stamps(plain / "groundtruth.csv")})
    moved = {time: message.transforms[0] for time, message in messages["/tf"]}
    assert list(moved) == list(odometry)
    for name in ("flight.csv", "groundtruth.csv"):
        velocity = numbers(plain / name, "vx_m_s", "vy_m_s", "vz_m_s")
        rates = numbers(plain / name, "wx_rad_s", "wy_rad_s", "wz_rad_s")
        for k, (stamp, body) in enumerate(zip(stamps(plain / name), bodies(plain / name), strict=True)):
            said, transform = odometry[stamp], moved[stamp]
            assert (said.header.frame_id, said.child_frame_id) == ("world", "base_link")
            assert (transform.header.frame_id, transform.child_frame_id) == ("world", "base_link")
            np.testing.assert_allclose(matrix(said.pose.pose.position, said.pose.pose.orientation), body, atol=1e-14)
            np.testing.assert_allclose(
                matrix(transform.transform.translation, transform.transform.rotation), body, atol=1e-14
            )
            np.testing.assert_allclose(xyz(said.twist.twist.linear), body[:3, :3].T @ velocity[k], atol=1e-13)
            np.testing.assert_array_equal(xyz(said.twist.twist.angular), rates[k])
            assert not any(said.pose.covariance) and not any(said.twist.covariance)


def test_the_static_tree_is_the_mounts_of_the_suite(plain, messages):
    ((time, message),) = messages["/tf_static"]
    assert time == min(stamps(plain / "flight.csv")[0], stamps(plain / "groundtruth.csv")[0])
    found = {
        each.child_frame_id: matrix(each.transform.translation, each.transform.rotation) for each in message.transforms
    }
    assert all(each.header.frame_id == "base_link" for each in message.transforms)
    assert set(found) == {"camera_optical_frame", "imu_link", "imu_bmi088_link", "gnss_link", "baro_link"}
    np.testing.assert_allclose(found["camera_optical_frame"], np.linalg.inv(cam_from_body(plain)), atol=1e-14)
    expected = np.eye(4)
    expected[:3, 3] = suite(plain)["sensors"][2]["offset_m"]
    np.testing.assert_array_equal(found["imu_bmi088_link"], expected)
    np.testing.assert_array_equal(found["imu_link"], np.eye(4))
    np.testing.assert_array_equal(found["baro_link"], np.eye(4))


@pytest.mark.parametrize(("topic", "file", "number"), [("imu_bmi088", "imu-bmi088.csv", 2), ("imu", "imu.csv", 3)])
def test_imus_are_those_of_the_sequence(plain, messages, topic, file, number):
    found = messages[f"/{topic}/data_raw"]
    assert [time for time, _ in found] == stamps(plain / file)
    rates = numbers(plain / file, "wx_rad_s", "wy_rad_s", "wz_rad_s")
    forces = numbers(plain / file, "ax_m_s2", "ay_m_s2", "az_m_s2")
    defaults = json.loads((plain / "sequence.json").read_text())["config"]["sensors"][number]
    rate_hz = suite(plain)["sensors"][number]["rate_hz"]
    for k, (_, said) in enumerate(found):
        assert said.header.frame_id == f"{topic}_link"
        np.testing.assert_array_equal(xyz(said.angular_velocity), rates[k])
        np.testing.assert_array_equal(xyz(said.linear_acceleration), forces[k])
        assert list(said.orientation_covariance) == [-1, *[0] * 8]
        q = said.orientation
        assert [q.w, q.x, q.y, q.z] == [1, 0, 0, 0]
        for covariance, density in (
            (said.angular_velocity_covariance, defaults["gyro_noise_rad_s_sqrt_hz"]),
            (said.linear_acceleration_covariance, defaults["accel_noise_m_s2_sqrt_hz"]),
        ):
            np.testing.assert_allclose(np.reshape(covariance, (3, 3)), density**2 * rate_hz * np.eye(3), rtol=1e-12)


def test_pressures_are_those_of_the_barometer(plain, messages):
    found = messages["/baro/pressure"]
    assert [time for time, _ in found] == stamps(plain / "baro.csv")
    for (_, said), (pressure,) in zip(found, numbers(plain / "baro.csv", "pressure_pa"), strict=True):
        assert (said.fluid_pressure, said.variance, said.header.frame_id) == (pressure, 1.5**2, "baro_link")


def ecef(latitude_deg, longitude_deg, height_m):
    """The textbook's forward formula of WGS 84."""
    lat, lon, e2 = np.radians(latitude_deg), np.radians(longitude_deg), 0.00669437999014
    n = 6378137.0 / np.sqrt(1 - e2 * np.sin(lat) ** 2)
    across = (n + height_m) * np.cos(lat)
    return np.array([across * np.cos(lon), across * np.sin(lon), (n * (1 - e2) + height_m) * np.sin(lat)])


def east_north_up(place, origin):
    lat, lon = np.radians(origin[:2])
    turn = np.array(
        [
            [-np.sin(lon), np.cos(lon), 0],
            [-np.sin(lat) * np.cos(lon), -np.sin(lat) * np.sin(lon), np.cos(lat)],
            [np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)],
        ]
    )
    return turn @ (ecef(*place) - ecef(*origin))


def check_fixes(plain, found, origin):
    cells = table(plain / "gnss.csv")
    assert [time for time, _ in found] == stamps(plain / "gnss.csv")
    fixed = 0
    for k, (_, said) in enumerate(found):
        if not cells["px_m"][k]:
            assert said.status.status == -1 and np.isnan([said.latitude, said.longitude, said.altitude]).all()
            assert not any(said.position_covariance) and said.position_covariance_type == 0
            continue
        fixed += 1
        assert (said.status.status, said.status.service, said.header.frame_id) == (0, 1, "gnss_link")
        e, n, u = east_north_up((said.latitude, said.longitude, said.altitude), origin)
        # The world's y axis points 30 degrees counter-clockwise from north, so its x axis as much from east.
        c, s = np.cos(np.radians(30)), np.sin(np.radians(30))
        here = [float(cells[name][k]) for name in ("px_m", "py_m", "pz_m")]
        np.testing.assert_allclose([c * e + s * n, -s * e + c * n, u], here, atol=2e-8)
        variance = float(cells["pdop"][k]) ** 2 * (1.0**2 + 0.3**2) / 3
        np.testing.assert_allclose(np.reshape(said.position_covariance, (3, 3)), variance * np.eye(3), rtol=1e-12)
        assert said.position_covariance_type == 1
    assert fixed


def test_fixes_lie_on_earth_where_the_datum_says(plain, messages, bag, tmp_path):
    check_fixes(plain, messages["/gnss/fix"], (40.8, 0.0, 0.0))
    assert "origin is at latitude, longitude and height 40.8,0.0,0.0" in notes(bag)
    export(Sequence.load(plain), "mcap", tmp_path / "out", datum=Datum.parse("-33.9,151.2,40"), images="raw")
    moved = of_mcap(tmp_path / "out" / "bag.mcap")
    check_fixes(plain, moved["/gnss/fix"], (-33.9, 151.2, 40.0))
    assert "/camera/image_raw" in moved and "/camera/image_raw/compressed" not in moved


@pytest.mark.parametrize("stamp", [-1, 2**31 * 10**9])
def test_a_stamp_that_a_header_cannot_hold_is_refused(stamp):
    with pytest.raises(UserError, match=f"the stamp {stamp} ns is outside the range"):
        header(stamp, "world")


@pytest.mark.parametrize(("stamp", "parts"), [(0, (0, 0)), (2**31 * 10**9 - 1, (2**31 - 1, 10**9 - 1))])
def test_a_header_holds_what_31_bits_of_seconds_hold(stamp, parts):
    said = header(stamp, "world")
    assert ((said.stamp.sec, said.stamp.nanosec), said.frame_id) == (parts, "world")


@pytest.mark.parametrize(("file", "link"), [("imu.csv", "imu_link"), ("My-IMU 2.csv", "my_imu_2_link")])
def test_frames_are_called_after_files(file, link):
    assert link_of(file) == link


@pytest.mark.parametrize(
    "origin", [(0.0, 0.0, 0.0), (89.9, 179.9, 99_999.0), (-89.9, -180.0, -9_000.0), (47.0, 8.5, 400.0)]
)
def test_places_about_any_datum_are_those_of_the_forward_formula(origin):
    points = np.random.default_rng(0).normal(0, 3000.0, (20, 3))
    datum = Datum.parse(",".join(map(repr, origin)))
    assert str(datum) == ",".join(map(repr, origin))
    found = [east_north_up(place, origin) for place in datum.geodetic(points)]
    np.testing.assert_allclose(found, points, atol=1e-5)


@pytest.mark.parametrize("text", ["89.999,180,99999", "-89.999,-180,-99999", " 1, 2, 3"])
def test_a_datum_may_be_anywhere_but_at_the_poles(text):
    datum = Datum.parse(text)
    assert [datum.latitude_deg, datum.longitude_deg, datum.height_m] == [float(word) for word in text.split(",")]


@pytest.mark.parametrize("text", [
    "", "1,2", "1,2,x", "91,0,0", "90,0,0", "-90,0,0", "0,181,0", "0,180.1,0", "nan,0,0", "0,0,1e9", "0,0,1e5",
    "0,0,-1e5",
    "0,0,150000",
])  # fmt: skip
def test_a_datum_that_is_none_is_refused(text):
    with pytest.raises(UserError, match="write LAT,LON,HEIGHT"):
        Datum.parse(text)


@pytest.mark.parametrize(
    ("model", "coefficients", "said"),
    [
        ("radtan", [-0.2, 0.05, 0.001, -0.002], ("plumb_bob", [-0.2, 0.05, 0.001, -0.002, 0.0])),
        ("radtan", [-0.2, 0.05, 0.001, -0.002, 0.01], ("plumb_bob", [-0.2, 0.05, 0.001, -0.002, 0.01])),
        ("equidistant", [0.01, 0.02, -0.01, 0.001], ("equidistant", [0.01, 0.02, -0.01, 0.001])),
    ],
)
def test_a_lens_is_held_or_taken_out(lens, tmp_path, model, coefficients, said):
    camera = replace(lens.camera, distortion_model=model, distortion=tuple(coefficients))
    sequence = replace(lens, camera=camera)
    export(sequence, "mcap", tmp_path / "held")
    for _, info in of_mcap(tmp_path / "held" / "bag.mcap")["/camera/camera_info"]:
        assert (info.distortion_model, list(info.d)) == said
    export(sequence, "mcap", tmp_path / "flat", undistort=True)
    flat = of_mcap(tmp_path / "flat" / "bag.mcap")
    assert {"/camera/image_rect", "/camera/image_rect/compressed"} <= set(flat)
    assert not any(info.distortion_model != "plumb_bob" or any(info.d) for _, info in flat["/camera/camera_info"])
    for (_, raw), (_, packed) in zip(flat["/camera/image_rect"], flat["/camera/image_rect/compressed"], strict=True):
        pixels = cv2.imdecode(np.frombuffer(packed.data, np.uint8), cv2.IMREAD_UNCHANGED)
        np.testing.assert_array_equal(np.frombuffer(raw.data, np.uint8).reshape(pixels.shape), pixels)


@pytest.mark.parametrize("images", ["both", "raw", "compressed"])
@pytest.mark.parametrize("storage", ["mcap", "rosbag2"])
def test_each_image_is_read_and_decoded_once(plain, tmp_path, monkeypatch, storage, images):
    """It is what most of the time of a bag goes into."""
    decoded, opened = [], []
    decode, read = shown_images.image_of, Sequence.image_bytes
    monkeypatch.setattr(shown_images, "image_of", lambda *a: decoded.append(a[0].name) or decode(*a))
    monkeypatch.setattr(Sequence, "image_bytes", lambda self, frame: opened.append(frame) or read(self, frame))
    monkeypatch.setattr(Sequence, "image", lambda self, frame: pytest.fail("decoded once more"))
    sequence = Sequence.load(plain)
    export(sequence, storage, tmp_path / "out", images=images)
    assert sorted(opened) == list(range(len(sequence)))
    assert sorted(decoded) == sorted(name.split("/")[-1] for name in sequence.files)


def test_the_same_sequence_is_the_same_bytes(plain, tmp_path):
    for k in "ab":
        export(Sequence.load(plain), "mcap", tmp_path / k)
    assert (tmp_path / "a" / "bag.mcap").read_bytes() == (tmp_path / "b" / "bag.mcap").read_bytes()


def test_settings_of_bags_are_refused_elsewhere(plain, tmp_path):
    with pytest.raises(UserError, match=r"images are for bags \(mcap, rosbag2\); the format tum has none"):
        export(Sequence.load(plain), "tum", tmp_path / "tum", images="raw")


def test_what_a_bag_lacks_is_told(bag):
    said = notes(bag)
    for word in (
        "Sensor readings: `flow.csv`",
        "the height of `baro.csv`",
        "`depth/`",
        "`mask/`",
        "true biases of `imu.csv`",
        "not from 1970",
        "thrusts and wind",
    ):
        assert word in said
    assert "angular rates" not in said
    assert json.loads((bag / "export.json").read_text())["frames"] in (
        {"bag.mcap": "world_from_body"},
        {"bag/bag.db3": "world_from_body"},
    )


def test_without_rosbags_it_is_told_what_to_install(plain, tmp_path, monkeypatch):
    for name in [name for name in sys.modules if name.split(".")[0] == "rosbags"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "rosbags", None)
    with pytest.raises(UserError, match=r"pip install 'uavbench\[bags\]'"):
        export(Sequence.load(plain), "mcap", tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("name", "told"), [(None, UserError), ("SQLITE_CANTOPEN", UserError), ("SQLITE_FULL", DiskError)]
)
def test_what_sqlite_cannot_write_is_told(plain, tmp_path, monkeypatch, name, told):
    """An error of Python's module, not of the library, has no name."""

    def fail(*_):
        error = sqlite3.ProgrammingError("what is wrong")
        if name is not None:
            error.sqlite_errorname = name
        raise error

    monkeypatch.setattr(bag_module, "_write", fail)
    with pytest.raises(UserError, match="SQLite cannot write the bag: what is wrong") as error:
        export(Sequence.load(plain), "rosbag2", tmp_path / "out")
    assert type(error.value) is told
