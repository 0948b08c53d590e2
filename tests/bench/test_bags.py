"""Bags of others and of ours read: evaluated against files, tracked, and refused with a reason.

They are written by mcap-ros2-support or rosbags, and evo is the oracle of what their trajectories are.
"""

import json
import os
import shutil
import struct

import cv2
import numpy as np
import pytest
import zstandard
from click.testing import CliRunner
from evo.core import metrics, sync
from evo.tools import file_interface
from mcap_ros2.writer import Writer as OtherWriter
from rosbags.rosbag2 import CompressionFormat, CompressionMode, Reader, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation

from uavbench.bench.cli.main import main
from uavbench.scenes.camera import Camera
from uavbench.tracker.images.camera_doubts import doubts_of_info
from uavbench.trajectories.bags.poses import read_poses
from uavbench.trajectories.bags.reading import BagTopic
from uavbench.trajectories.trajectory import Trajectory
from uavbench.trajectories.trajectory_files.formats import write_tum

TYPES = get_typestore(Stores.ROS2_JAZZY)
T = TYPES.types
STEP_NS = 50_000_000
ROWS = 40


def poses(seed):
    rng = np.random.default_rng(seed)
    positions = np.cumsum(rng.normal(0, 0.1, (ROWS, 3)), axis=0)
    return positions, Rotation.from_rotvec(np.cumsum(rng.normal(0, 0.02, (ROWS, 3)), axis=0)).as_quat()


def make(name, **fields):
    return T[name.replace("/", "/msg/")](**fields)


def header(stamp_ns, frame):
    return make(
        "std_msgs/Header",
        stamp=make("builtin_interfaces/Time", sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9),
        frame_id=frame,
    )


def pose(p, q):
    place = make("geometry_msgs/Point", x=p[0], y=p[1], z=p[2])
    return make(
        "geometry_msgs/Pose",
        position=place,
        orientation=make("geometry_msgs/Quaternion", x=q[0], y=q[1], z=q[2], w=q[3]),
    )


def odometry(stamp_ns, p, q, frame="world", child="base_link"):
    zero = make("geometry_msgs/Vector3", x=0.0, y=0.0, z=0.0)
    twist = make("geometry_msgs/Twist", linear=zero, angular=zero)
    return make(
        "nav_msgs/Odometry",
        header=header(stamp_ns, frame),
        child_frame_id=child,
        pose=make("geometry_msgs/PoseWithCovariance", pose=pose(p, q), covariance=np.zeros(36)),
        twist=make("geometry_msgs/TwistWithCovariance", twist=twist, covariance=np.zeros(36)),
    )


def written(path, topics, storage=StoragePlugin.MCAP, compression=CompressionMode.NONE):
    """A rosbag2 folder with the messages (stamp, message) of each topic."""
    with_mode = Writer(path, version=8, storage_plugin=storage)
    with_mode.set_compression(compression, CompressionFormat.ZSTD)
    with with_mode as writer:
        for name, messages in topics.items():
            kind = messages[0][1].__msgtype__
            connection = writer.add_connection(name, kind, typestore=TYPES)
            for stamp, message in messages:
                writer.write(connection, stamp, TYPES.serialize_cdr(message, kind))
    return path


def rows(seed=1, **ends):
    return [
        (k * STEP_NS, odometry(k * STEP_NS, p, q, **ends)) for k, (p, q) in enumerate(zip(*poses(seed), strict=True))
    ]


def stamped(seed=1):
    found = zip(*poses(seed), strict=True)
    return [
        (k * STEP_NS, make("geometry_msgs/PoseStamped", header=header(k * STEP_NS, "world"), pose=pose(p, q)))
        for k, (p, q) in enumerate(found)
    ]


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    topics = {
        "/odom": rows(),
        "/pose": stamped(2),
        "/vio": rows(3, frame="odom", child="imu"),
        "/cam": rows(4, child="cam_optical_frame"),
    }
    return written(tmp_path_factory.mktemp("bag") / "bag", topics)


@pytest.fixture(scope="module")
def tum(tmp_path_factory):
    path = tmp_path_factory.mktemp("tum") / "estimate.tum"
    p, q = poses(5)
    write_tum(Trajectory(np.arange(ROWS) * STEP_NS, p, q[:, [3, 0, 1, 2]]), path, "world_from_body")
    return path


def call(*arguments):
    return CliRunner().invoke(main, [str(each) for each in arguments])


def evaluated(*arguments):
    done = call("evaluate", *arguments, "--json")
    assert done.exit_code == 0, done.output
    return json.loads(done.stdout)


def refused(*arguments):
    done = call(*arguments)
    assert done.exit_code == 2 and "Traceback" not in done.output, done.output
    return done.output


@pytest.mark.parametrize("topic", ["/odom", "/pose"])
def test_evo_has_the_same_error_from_the_bag(bag, tum, topic):
    with Reader(bag / "bag.mcap") as reader:
        reference = file_interface.read_bag_trajectory(reader, topic)
    pair = sync.associate_trajectories(reference, file_interface.read_tum_trajectory_file(tum))
    for relation, name, unit in (
        (metrics.PoseRelation.translation_part, "translation_m", 1),
        (metrics.PoseRelation.rotation_angle_deg, "rotation_deg", 1),
    ):
        ape = metrics.APE(relation)
        ape.process_data(pair)
        ours = evaluated(f"{bag / 'bag.mcap'}:{topic}", tum)["ate"][name]
        assert ours["rmse"] * unit == pytest.approx(ape.get_statistic(metrics.StatisticsType.rmse), abs=1e-9)
        assert ours["n"] == ROWS


@pytest.mark.parametrize("storage", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
def test_a_folder_and_its_file_are_the_same_bag(tmp_path, tum, storage):
    folder = written(tmp_path / "bag", {"/odom": rows()}, storage)
    (file,) = (path for path in folder.iterdir() if path.suffix != ".yaml")
    results = [evaluated(given, tum)["ate"] for given in (folder, f"{folder}:/odom", file, f"{file}:odom")]
    assert all(result == results[0] for result in results)
    (folder / "metadata.yaml").rename(tmp_path / "metadata.yaml")
    assert evaluated(f"{folder}:/odom", tum)["ate"] == results[0], "as in an export"
    (tmp_path / "metadata.yaml").rename(folder / "metadata.yaml")
    exact = evaluated(folder, folder)
    assert exact["ate"]["translation_m"]["max"] == 0


def test_a_bag_of_another_writer_is_read(tmp_path, tum, bag):
    """With chunks of zstd, as mcap's own writer has them."""
    path = tmp_path / "other.mcap"
    with path.open("wb") as handle:
        writer = OtherWriter(handle)
        definition, _ = TYPES.generate_msgdef("nav_msgs/msg/Odometry", ros_version=2)
        schema = writer.register_msgdef("nav_msgs/msg/Odometry", definition)
        for stamp, said in rows():
            p, q = said.pose.pose.position, said.pose.pose.orientation
            place = {"position": {a: getattr(p, a) for a in "xyz"}, "orientation": {a: getattr(q, a) for a in "xyzw"}}
            message = {
                "header": {"stamp": {"sec": stamp // 10**9, "nanosec": stamp % 10**9}, "frame_id": "world"},
                "child_frame_id": "base_link",
                "pose": {"pose": place, "covariance": [0.0] * 36},
                "twist": {
                    "twist": {"linear": dict.fromkeys("xyz", 0.0), "angular": dict.fromkeys("xyz", 0.0)},
                    "covariance": [0.0] * 36,
                },
            }
            writer.write_message("/odom", schema, message, log_time=stamp, publish_time=stamp)
        writer.finish()
    assert b"zstd" in path.read_bytes()
    assert evaluated(path, tum)["ate"] == evaluated(f"{bag}:/odom", tum)["ate"]


def test_poses_of_different_frames_are_refused(bag, tum):
    told = refused("evaluate", f"{bag}:/cam", tum)
    assert "world_from_cam" in told and "world_from_body" in told
    told = refused("evaluate", tum, f"{bag}:/vio")
    assert "poses in world" in told and "in odom" in told and "--align" in told
    assert "odom_from_imu" in refused("evaluate", tum, f"{bag}:/vio", "--align", "se3")
    assert evaluated(tum, f"{bag}:/vio", "--align", "se3", "--ignore-frames")["record"]["pairs"] == ROWS
    assert evaluated(tum, f"{bag}:/pose")["record"]["estimate"]["frame"] == "world_from_?"


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ("", "has 4 topics with poses, /cam, /odom, /pose, /vio"),
        (":/nowhere", "has no topic '/nowhere'; the bag's topics: /cam (nav_msgs/msg/Odometry, 40)"),
        (":/tf:world.base_link", "has no topic '/tf'"),
    ],
)
def test_a_topic_that_is_not_there_is_told_with_those_that_are(bag, tum, given, told):
    assert told in refused("evaluate", f"{bag}{given}", tum)


def transforms(ends, moving=True):
    out = []
    for k, (p, q) in enumerate(zip(*poses(1), strict=True)):
        where = make("geometry_msgs/Vector3", x=p[0], y=p[1], z=p[2])
        turn = make("geometry_msgs/Quaternion", x=q[0], y=q[1], z=q[2], w=q[3])
        move = make("geometry_msgs/Transform", translation=where, rotation=turn)
        head = header(k * STEP_NS, ends[0])
        each = make("geometry_msgs/TransformStamped", header=head, child_frame_id=ends[1], transform=move)
        out.append((k * STEP_NS, make("tf2_msgs/TFMessage", transforms=[each])))
    return out if moving else out[7:8]


def test_a_path_through_the_tree_is_the_product_of_its_transforms(tmp_path, tum):
    topics = {"/tf": transforms(("odom", "base_link")), "/tf_static": transforms(("base_link", "cam0"), moving=False)}
    folder = written(tmp_path / "bag", topics)
    p, q = poses(1)
    body_from_cam = np.eye(4)
    body_from_cam[:3, :3], body_from_cam[:3, 3] = Rotation.from_quat(q[7]).as_matrix(), p[7]
    expected = p + Rotation.from_quat(q).apply(p[7])
    reference = Trajectory(
        np.arange(ROWS) * STEP_NS,
        expected,
        (Rotation.from_quat(q) * Rotation.from_quat(q[7])).as_quat()[:, [3, 0, 1, 2]],
    )
    write_tum(reference, tmp_path / "expected.tum")
    found = evaluated(tmp_path / "expected.tum", f"{folder}:/tf:odom.cam0")
    assert found["ate"]["translation_m"]["max"] < 1e-12 and found["ate"]["rotation_deg"]["max"] < 1e-10
    for given, told in (
        ("/tf", "name two frames of /tf"),
        ("/tf:odom.cam9", "'odom' is not an ancestor of 'cam9'"),
        ("/tf:base_link.cam0", "changing transforms between"),
    ):
        assert told in refused("evaluate", tum, f"{folder}:{given}")
    assert "base_link.cam0" in refused("evaluate", tum, f"{folder}:/tf:odom.cam9")


def test_a_transform_that_is_sent_again_and_again_without_a_change_is_fixed(tmp_path):
    moved = transforms(("odom", "base_link"))
    fixed = written(tmp_path / "fixed", {"/tf": moved, "/tf_static": transforms(("world", "odom"), moving=False)})
    again = [(at, transforms(("world", "odom"), moving=False)[0][1]) for at, _ in moved]
    for at, message in again:
        message.transforms[0].header = header(at, "world")
    both = written(tmp_path / "both", {"/tf": sorted([*moved, *again], key=lambda each: each[0])})
    expected = read_poses(BagTopic(fixed, "/tf:world.base_link")).trajectory
    found = read_poses(BagTopic(both, "/tf:world.base_link")).trajectory
    assert np.array_equal(found.stamps_ns, expected.stamps_ns) and len(found) == ROWS
    assert np.array_equal(found.positions_m, expected.positions_m)


def test_parts_of_a_recording_without_its_metadata_are_told(tmp_path, tum):
    folder = tmp_path / "recording"
    for number in range(2):
        part = written(tmp_path / f"part-{number}", {"/odom": rows()})
        folder.mkdir(exist_ok=True)
        shutil.copy(next(part.glob("*.mcap")), folder / f"recording_{number}.mcap")
    told = refused("evaluate", tum, f"{folder}:/odom")
    assert "recording: holds 2 bags, and no metadata.yaml" in told and f"ros2 bag reindex {folder}" in told
    assert f"{folder / 'recording_0.mcap'}:/topic" in told
    (folder / "recording_1.mcap").unlink()
    assert evaluated(tum, f"{folder}:/odom")["record"]["pairs"] == ROWS


def crooked(change):
    found = rows()
    change([message for _, message in found])
    return found


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda m: setattr(m[3].pose.pose.position, "x", float("nan")), "message 3: its position is not finite"),
        (lambda m: setattr(m[4].pose.pose.orientation, "w", 9.0), "message 4: its quaternion is not of unit norm"),
        (lambda m: setattr(m[5].header.stamp, "nanosec", 0), "another pose has the same stamp"),
        (lambda m: setattr(m[6], "child_frame_id", "imu"), "message 6 of /odom is of imu in world"),
    ],
)
def test_a_message_that_is_wrong_is_named(tmp_path, tum, change, told):
    folder = written(tmp_path / "bag", {"/odom": crooked(change)})
    assert told in refused("evaluate", folder, tum)


def test_bags_that_cannot_be_read_say_why(bag, tum, tmp_path):
    whole = (bag / "bag.mcap").read_bytes()
    path = tmp_path / "bad.mcap"
    for data in (b"", b"x", whole[:8], whole[: len(whole) // 2], whole[:-1], whole[: len(whole) // 3] + whole[-37:]):
        path.write_bytes(data)
        assert "bad.mcap" in refused("evaluate", path, tum)
    for place in range(9, len(whole) - 8, len(whole) // 60):
        path.write_bytes(whole[:place] + b"\xff" * 8 + whole[place + 8 :])
        done = call("evaluate", f"{path}:/odom", tum)
        assert done.exit_code in (0, 2) and not isinstance(done.exception, Exception), (place, done.output)
    path.unlink()
    assert "no such file" in refused("evaluate", path, tum)
    os.mkfifo(path)
    assert "not a regular file" in refused("evaluate", path, tum)
    (tmp_path / "old.bag").write_bytes(b"#ROSBAG V2.0\n")
    assert "rosbags-convert" in refused("evaluate", tmp_path / "old.bag", tum)
    (tmp_path / "small.mcap.zst").write_bytes(b"")
    assert "run `zstd -d` on it first" in refused("evaluate", tmp_path / "small.mcap.zst", tum)
    (tmp_path / "bad.db3").write_bytes(b"SQLite format 3\0" + bytes(100))
    assert "not a readable bag" in refused("evaluate", tmp_path / "bad.db3", tum)


@pytest.mark.parametrize("mode", [CompressionMode.MESSAGE, CompressionMode.FILE])
def test_a_compressed_rosbag2_says_what_to_do(tmp_path, tum, mode):
    folder = written(tmp_path / "bag", {"/odom": rows()}, StoragePlugin.SQLITE3, mode)
    told = refused("evaluate", folder, tum)
    assert "compressed" in told and "ros2 bag convert" in told


def test_a_bag_whose_files_lie_elsewhere_is_refused(bag, tum, tmp_path):
    shutil.copytree(bag, tmp_path / "bag")
    (tmp_path / "bag" / "bag.mcap").unlink()
    (tmp_path / "bag" / "bag.mcap").symlink_to(bag / "bag.mcap")
    assert "points outside the folder" in refused("evaluate", f"{tmp_path / 'bag'}:/odom", tum)


def test_a_chunk_is_not_inflated_beyond_what_it_claims(tmp_path, tum):
    """A small chunk that would inflate to 4 GB, and claims 100 bytes, or all of it."""
    squeezed = zstandard.ZstdCompressor().compress(bytes(1 << 20)) * 4096
    for claimed in (100, 1 << 32):
        chunk = struct.pack("<QQQI", 0, 1, claimed, 0) + struct.pack("<I", 4) + b"zstd"
        chunk += struct.pack("<Q", len(squeezed)) + squeezed
        head = struct.pack("<I", 4) + b"ros2" + struct.pack("<I", 0)
        magic = b"\x89MCAP0\r\n"
        records = b"".join(
            bytes([op]) + struct.pack("<Q", len(body)) + body for op, body in ((1, head), (6, chunk), (2, bytes(20)))
        )
        (tmp_path / "bomb.mcap").write_bytes(magic + records + magic)
        assert "not a readable bag" in refused("evaluate", tmp_path / "bomb.mcap", tum)


# Tracking


def box():
    lines = [f"v {x} {y} {z}" for x in (-0.2, 0.2) for y in (-0.2, 0.2) for z in (0.0, 0.4)]
    faces = ("1 2 4 3", "5 7 8 6", "1 5 6 2", "3 4 8 7", "1 3 7 5", "2 6 8 4")
    return "\n".join([*lines, *(f"f {face}" for face in faces)]) + "\n"


@pytest.fixture
def real(tmp_path):
    (tmp_path / "box.obj").write_text(box())
    Camera.from_field_of_view(64, 48, 60).save(tmp_path / "camera.toml")
    at = [[1, 0, 0, 0], [0, 0, -1, 0.2], [0, 1, 0, 2], [0, 0, 0, 1]]
    (tmp_path / "init.toml").write_text(f"cam_from_model = {at}\n")
    return ["--model", tmp_path / "box.obj", "--camera", tmp_path / "camera.toml", "--init", tmp_path / "init.toml"]


STAMPS = (1_000_000_001, 1_033_333_334, 1_100_000_007)
PICTURE = np.random.default_rng(0).integers(0, 255, (48, 64, 3), dtype=np.uint8)


def raw(stamp, encoding, pixels, pad=0):
    flat = pixels.reshape(len(pixels), -1)
    data = np.pad(flat, ((0, 0), (0, pad)))
    size = {"height": len(pixels), "width": pixels.shape[1], "step": data.shape[1]}
    return make(
        "sensor_msgs/Image",
        header=header(stamp, "cam"),
        encoding=encoding,
        is_bigendian=0,
        data=data.reshape(-1),
        **size,
    )


def packed(stamp, form, data):
    return make(
        "sensor_msgs/CompressedImage", header=header(stamp, "cam"), format=form, data=np.frombuffer(data, np.uint8)
    )


def images_of(path, topic, camera):
    from uavbench.tracker.images.bag_images import bag_frames
    from uavbench.trajectories.bags.reading import BagTopic

    return list(bag_frames(BagTopic(path, topic), camera))


@pytest.mark.parametrize(
    ("encoding", "pixels"),
    [
        ("bgr8", PICTURE),
        ("rgb8", PICTURE[..., ::-1]),
        ("bgra8", np.dstack([PICTURE, PICTURE[..., :1]])),
        ("rgba8", np.dstack([PICTURE[..., ::-1], PICTURE[..., :1]])),
        ("mono8", PICTURE[..., 0]),
    ],
)
def test_encodings_become_the_same_picture(tmp_path, encoding, pixels):
    topics = {"/image": [(s, raw(s, encoding, np.ascontiguousarray(pixels), pad=5)) for s in STAMPS]}
    found = images_of(written(tmp_path / "bag", topics), "/image", Camera.from_field_of_view(64, 48, 60))
    assert tuple(stamp for stamp, _ in found) == STAMPS
    expected = np.repeat(PICTURE[..., :1], 3, axis=2) if encoding == "mono8" else PICTURE
    assert all((image == expected).all() for _, image in found)


def test_a_bayer_mosaic_has_its_colours_in_their_places(tmp_path):
    """Of one colour everywhere: red 200, green 100, blue 50."""
    mosaic = np.full((48, 64), 100, np.uint8)
    mosaic[::2, ::2], mosaic[1::2, 1::2] = 200, 50
    topics = {"/image": [(s, raw(s, "bayer_rggb8", mosaic)) for s in STAMPS]}
    (_, image), *_ = images_of(written(tmp_path / "bag", topics), "/image", Camera.from_field_of_view(64, 48, 60))
    assert (image == (50, 100, 200)).all()


@pytest.mark.parametrize("bits", [8, 16])
def test_a_compressed_mosaic_has_its_colours_too(tmp_path, bits):
    """As image_transport compresses `bayer_rggb8`: in grey; the mosaic itself had been the image."""
    mosaic = np.full((48, 64), 100, np.uint8)
    mosaic[::2, ::2], mosaic[1::2, 1::2] = 200, 50
    png = cv2.imencode(".png", mosaic if bits == 8 else mosaic.astype(np.uint16) * 257)[1].tobytes()
    topics = {"/image": [(s, packed(s, f"bayer_rggb{bits}; png compressed ", png)) for s in STAMPS]}
    (_, image), *_ = images_of(written(tmp_path / "bag", topics), "/image", Camera.from_field_of_view(64, 48, 60))
    assert (image == (50, 100, 200)).all()


def test_compressed_colours_of_a_bayer_camera_stay(tmp_path):
    png = cv2.imencode(".png", PICTURE)[1].tobytes()
    topics = {"/image": [(s, packed(s, "bayer_rggb8; png compressed bgr8", png)) for s in STAMPS]}
    (_, image), *_ = images_of(written(tmp_path / "bag", topics), "/image", Camera.from_field_of_view(64, 48, 60))
    assert (image == PICTURE).all()


def test_a_tracker_runs_on_the_images_of_a_bag(tmp_path, real):
    png = cv2.imencode(".png", PICTURE)[1].tobytes()
    topics = {
        "/raw": [(s, raw(s, "bgr8", PICTURE)) for s in STAMPS],
        "/raw/compressed": [(s, packed(s, "png", png)) for s in STAMPS],
        "/odom": rows(),
    }
    bag = written(tmp_path / "bag", topics)
    for topic in ("/raw", "/raw/compressed"):
        out = tmp_path / topic.replace("/", "-")
        done = call("track", "hold", "--bag", bag, "--image-topic", topic, *real, "--out", out)
        assert done.exit_code == 0, done.output
        assert "3 of 3 frames with a pose" in done.output
        lines = [line for line in (out / "estimate_world_from_cam.tum").read_text().splitlines() if line[0] != "#"]
        assert [line.split()[0] for line in lines] == ["1.000000001", "1.033333334", "1.100000007"]
    for topic, told in (
        ("/none", "has no topic '/none'; the bag's topics: /odom"),
        ("/odom", "topics of such types: /raw"),
    ):
        given = ("--bag", bag, "--image-topic", topic)
        assert told in refused("track", "hold", *given, *real, "--out", tmp_path / "x")
    assert "go together" in refused("track", "hold", "--bag", bag, *real, "--out", tmp_path / "x")
    assert "one of" in refused("track", "hold", "--bag", bag, "--images", tmp_path, "--image-topic", "/raw")
    assert not (tmp_path / "x").exists()


def test_the_rate_of_a_topic_is_that_of_its_images(tmp_path, real):
    """It had been that of as many images spread over the whole bag: 0.2 Hz in place of 20."""
    stamps = [1_000_000_000, 1_025_000_000, 1_100_000_000]
    topics = {
        "/image": [(s, raw(s, "bgr8", PICTURE)) for s in stamps],
        "/late": [(s, raw(s, "bgr8", PICTURE)) for s in (0, 10**10)],
    }
    bag = written(tmp_path / "bag", topics)
    done = call("track", "hold", "--bag", bag, "--image-topic", "/image", *real, "--out", tmp_path / "out")
    assert done.exit_code == 0, done.output
    assert json.loads((tmp_path / "out" / "record.json").read_text())["rate_hz"] == pytest.approx(20.0)
    given = ("track", "hold", "--bag", bag, "--image-topic", "/image", *real, "--rate-hz", 40, "--out", tmp_path / "x")
    assert "20 a second, which --rate-hz 40 does not change; leave it out" in refused(*given)


@pytest.mark.parametrize(
    ("make_message", "told"),
    [
        (lambda s: raw(s, "16UC1", PICTURE), "encoding '16UC1' is not read"),
        (lambda s: raw(s, "bgr8", PICTURE[:20]), "the camera 64 x 48 px"),
        (lambda s: raw(s, "rgba8", PICTURE), "are no 64 x 48 px of rgba8"),
        (lambda s: packed(s, "h264", b"\0\0\1\x67"), "format 'h264'"),
        (lambda s: raw(5, "bgr8", PICTURE), "does not come after the one before"),
        (lambda s: raw(5, "bgr8", PICTURE), "without one of the two images"),
        (lambda s: raw(0, "bgr8", PICTURE), "give the images as a folder, with their rate"),
        (lambda s: raw(10**12 - s, "bgr8", PICTURE), "in the order of these stamps"),
    ],
)
def test_images_that_cannot_be_read_say_why(tmp_path, real, make_message, told):
    bag = written(tmp_path / "bag", {"/image": [(s, make_message(s)) for s in STAMPS]})
    out = tmp_path / "out"
    assert told in refused("track", "hold", "--bag", bag, "--image-topic", "/image", *real, "--out", out)
    assert not out.exists()


def test_covariances_of_odometry_give_its_nees(tmp_path, tum):
    """As ROS has them: position first, in the axes of the world; a message of zeros claims none."""
    messages = rows(6)
    rng = np.random.default_rng(7)
    claimed = [np.diag(rng.uniform(0.5, 2.0, 6)) + 0.1 for _ in messages]
    for (_, message), P in zip(messages[1:], claimed[1:], strict=True):
        message.pose.covariance[:] = P.ravel()
    late = [(ROWS * STEP_NS - stamp, message) for stamp, message in messages][::-1]
    path = written(tmp_path / "bag", {"/odom": late})
    found = evaluated(tum, f"{path}:/odom")["nees"]["before"]
    (p, q), (true_p, true_q) = poses(6), poses(5)
    turn = (Rotation.from_quat(true_q) * Rotation.from_quat(q).inv()).as_rotvec()
    errors = np.column_stack([true_p - p, turn])[1:]
    wanted = [e @ np.linalg.inv(P) @ e for e, P in zip(errors, claimed[1:], strict=True)]
    assert found["n"] == ROWS - 1
    assert found["mean"] == pytest.approx(np.mean(wanted), rel=1e-9)
    assert "nees" not in evaluated(tum, f"{written(tmp_path / 'none', {'/odom': rows(6)})}:/odom")


K_AND_D = {"k": (50.0, 50.0, 31.0, 24.0), "d": (-0.3, 0.1, 0.001, 0.002, 0.01), "model": "plumb_bob"}
P = (40.0, 41.0, 32.0, 23.0)


def camera_info(k, d, model, p=P, binning=0, offset=(0, 0)):
    """As a driver sends it; P is that of images rectified by image_proc."""
    roi = make("sensor_msgs/RegionOfInterest", x_offset=offset[0], y_offset=offset[1], height=0, width=0,
               do_rectify=False)  # fmt: skip
    return make(
        "sensor_msgs/CameraInfo", header=header(STAMPS[0], "cam"), height=48, width=64, distortion_model=model,
        d=np.array(d), k=np.array([k[0], 0, k[2], 0, k[1], k[3], 0, 0, 1.0]), r=np.eye(3).reshape(-1),
        p=np.array([p[0], 0, p[2], 0, 0, p[1], p[3], 0, 0, 0, 1.0, 0]), binning_x=binning, binning_y=binning, roi=roi,
    )  # fmt: skip


def told_of(tmp_path, topic, camera, **info):
    bag = written(
        tmp_path / "bag",
        {topic: [(s, raw(s, "bgr8", PICTURE)) for s in STAMPS], "/cam/camera_info": [(STAMPS[0], camera_info(**info))]},
    )
    return doubts_of_info(BagTopic(bag, topic), Camera(64, 48, *camera))


@pytest.mark.parametrize(
    ("topic", "camera", "change", "doubt"),
    [
        ("/cam/image_rect", (*P, "radtan", (-0.3, 0.1, 0.001, 0.002)), {}, "rectified by their name"),
        ("/cam/image_rect_color/compressed", (*K_AND_D["k"], "none", ()), {}, "have its P, fx = 40, fy = 41, cx = 32"),
        ("/cam/image_raw", (*P, "none", ()), {}, "tells a distortion of the images of image_raw, plumb_bob"),
        (
            "/cam/image_raw",
            (*P, "radtan", K_AND_D["d"]),
            {},
            "those of its P; the images of image_raw have its K, fx = 50",
        ),
        ("/cam/image_raw", (*K_AND_D["k"], "radtan", K_AND_D["d"][:4]), {}, 'distortion_model = "radtan" with all'),
        (
            "/cam/image_raw",
            (*K_AND_D["k"], "radtan", (-0.3, 0.1, 0.001, 0.002)),
            {"d": (-0.3, 0.1, 0.001, 0.002), "model": "equidistant"},
            'distortion_model = "equidistant" with all',
        ),
        (
            "/cam/image_raw",
            (*K_AND_D["k"], "radtan", (-0.3, 0.1, 0.001, 0.002, 0.01)),
            {"d": (-0.3, 0.1, 0.001, 0.002, 0.01, 0.2, 0.0, 0.0), "model": "rational_polynomial"},
            "calibrate with plumb_bob instead",
        ),
        (
            "/cam/image_raw",
            (*P, "radtan", K_AND_D["d"]),
            {"k": (200.0, 200.0, 103.5, 84.5), "p": (80.0, 82.0, 104.5, 82.5), "binning": 2, "offset": (40, 36)},
            "have its K, fx = 100, fy = 100, cx = 31.5, cy = 24",
        ),
    ],
)
def test_a_camera_that_its_bag_contradicts_is_doubted(tmp_path, topic, camera, change, doubt):
    (told,) = told_of(tmp_path, topic, camera, **(K_AND_D | change))
    assert doubt in told


@pytest.mark.parametrize(
    ("topic", "camera", "change"),
    [
        ("/cam/image_raw", (*K_AND_D["k"], "radtan", K_AND_D["d"]), {}),
        ("/cam/image_rect", (*P, "none", ()), {}),
        ("/cam/image_raw", (52.0, 52.0, 30.0, 25.0, "radtan", (-0.28, 0.07, 0.0, 0.0)), {}),
        ("/cam/image_raw", (*P, "none", ()), {"k": (0.0, 0.0, 0.0, 0.0), "d": ()}),
        ("/cam/image_raw", (*P, "none", ()), {"k": P, "d": (0.0,) * 5}),
        ("/cam/image_raw", (*P, "none", ()), {"k": P, "d": ()}),
        (
            "/cam/image_raw",
            (*K_AND_D["k"], "radtan", K_AND_D["d"]),
            {"d": (*K_AND_D["d"], 0.0, 0.0, 0.0), "model": "rational_polynomial"},
        ),
        ("/other/image_raw", (*P, "none", ()), {}),
    ],
)
def test_a_camera_that_is_the_one_of_its_bag_leaves_no_doubt(tmp_path, topic, camera, change):
    assert told_of(tmp_path, topic, camera, **(K_AND_D | change)) == []


@pytest.mark.parametrize(("topic", "zoomed"), [("/cam/image_raw", "k"), ("/cam/image_rect", "p")])
def test_a_lens_that_zooms_within_a_bag_is_doubted(tmp_path, topic, zoomed):
    camera = (*K_AND_D["k"], "radtan", K_AND_D["d"]) if zoomed == "k" else (*P, "none", ())
    after = {zoomed: (60.0, 60.0, 31.0, 24.0)}
    infos = [(s, camera_info(**(K_AND_D | (after if s > STAMPS[1] else {})))) for s in STAMPS]
    for stamp, info in infos:
        info.header.stamp = header(stamp, "cam").stamp
    images = [(s, raw(s, "bgr8", PICTURE)) for s in STAMPS]
    for name, sent in (("steady", infos[:2]), ("zooming", infos)):
        bag = written(tmp_path / name, {topic: images, "/cam/camera_info": sent})
        told = doubts_of_info(BagTopic(bag, topic), Camera(64, 48, *camera))
        assert len(told) == (name == "zooming")
    assert f"from {STAMPS[2] / 1e9:.3f} s on, fx = 60 and cx = 31, and before fx = " in told[0]


def test_track_tells_of_a_camera_that_the_bag_contradicts(tmp_path, real):
    info = camera_info(**K_AND_D)
    topics = {"/cam/image_raw": [(s, raw(s, "bgr8", PICTURE)) for s in STAMPS], "/cam/camera_info": [(STAMPS[0], info)]}
    bag = written(tmp_path / "bag", topics)
    done = call("track", "hold", "--bag", bag, "--image-topic", "/cam/image_raw", *real, "--out", tmp_path / "out")
    assert "doubt: " in done.output and "/cam/camera_info: tells a distortion of the images" in done.output
