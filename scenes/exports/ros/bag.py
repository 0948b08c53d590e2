"""Sequences as ROS 2 bags: MCAP, or rosbag2 in SQLite, by the library rosbags (the extra `uavbench[bags]`)."""

import heapq
import json
import sqlite3
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import tee
from pathlib import Path
from typing import Any, Literal

from uavbench.scenes.dataset.body import GIMBAL, gimbal_joints
from uavbench.scenes.exports.euroc import RATES, STATE, body_from_imu, imus_of, rows_of, true_state
from uavbench.scenes.exports.laser_readings import Laser, Lidar, lidars_of, range_finders_of
from uavbench.scenes.exports.notes import Held, tables_of, tables_with
from uavbench.scenes.exports.ros import bag_messages as messages
from uavbench.scenes.exports.ros import laser_messages
from uavbench.scenes.exports.ros.bag_messages import Stamped, link_of, ros_name
from uavbench.scenes.exports.ros.geodetic import Datum
from uavbench.scenes.exports.ros.gimbal_messages import joint_states, moving_extrinsics
from uavbench.scenes.exports.shown_images import Shown
from uavbench.trajectories.bags.library import rosbags, typestore
from uavbench.trajectories.bags.storages import path_for_rosbags
from uavbench.trajectories.camera_mount import MAIN
from uavbench.trajectories.errors import DiskError, UserError
from uavbench.trajectories.pose import Pose

VERSION = 8
"""Version of rosbag2's metadata: that of ROS 2 Jazzy, which later distributions read."""
FILES = {"mcap": "bag.mcap", "sqlite3": "bag/bag.db3"}
"""File of the messages, by storage."""
INFO = "/camera/camera_info"

Images = Literal["both", "raw", "compressed"]


@dataclass(frozen=True)
class BagExport:
    """Writes a bag.

    images: as `sensor_msgs/Image`, as `CompressedImage` (PNG), or both. datum: geodetic position of the world's origin
    for `NavSatFix`; None: the latitude of the receiver's sky, 0 degrees east, height 0.
    """

    storage: Literal["mcap", "sqlite3"]
    images: Images = "both"
    datum: Datum | None = None

    def __call__(self, shown: Shown, folder: Path, on_frame: Callable[[int, int], None]) -> Held:
        """Write `bag.mcap` or `bag/`: images, camera, readings of sensors, and the true odometry and transforms."""
        content = Content(shown, self.images, self.datum)
        topics = list(content.topics())
        try:
            _write(topics, folder / "bag", self.storage, self._about(shown), lambda n: on_frame(n, len(shown.sequence)))
        except sqlite3.Error as error:
            full = getattr(error, "sqlite_errorname", "").startswith(("SQLITE_FULL", "SQLITE_IOERR"))
            raise (DiskError if full else UserError)(
                f"{folder.parent}: SQLite cannot write the bag: {error}; free space, or choose another location"
            ) from None
        if self.storage == "mcap":
            (folder / "bag" / "bag.mcap").rename(folder / "bag.mcap")
            (folder / "bag" / "metadata.yaml").unlink()
            (folder / "bag").rmdir()
        name = FILES[self.storage]
        files = {name: "ROS 2 messages: " + "; ".join(f"`{each.name}` {each.type}, {each.about}" for each in topics)}
        if self.storage == "sqlite3":
            files["bag/metadata.yaml"] = "topics and times, in the format of `ros2 bag`"
        return Held(
            files=files,
            frames={} if shown.sequence.recorded else {name: "world_from_body"},
            sensors=content.sensors,
            limits=tuple(content.limits()),
            angular_rates=True,
            moving_mounts=True,
            cameras=tuple(shown.sequence.cameras),
        )

    def _about(self, shown: Shown) -> dict[str, str]:
        """Custom metadata of the bag."""
        sequence = shown.sequence
        return {"uavbench": json.dumps({"sequence": sequence.name, "content_hash": sequence.content_hash})}


@dataclass(frozen=True, eq=False)
class Channel:
    """A topic, its type such as `sensor_msgs/Image`, its description, and its messages in order of their stamps."""

    name: str
    type: str
    about: str
    messages: Iterator[Stamped]


@dataclass(frozen=True, eq=False)
class Content:
    """Topics of a sequence in a bag."""

    shown: Shown
    images: Images
    datum: Datum | None

    @cached_property
    def imus(self) -> dict[str, dict[str, Any]]:
        """Parameters of the IMUs by their files."""
        return imus_of(self.shown.sequence)

    @cached_property
    def receivers(self) -> dict[str, dict[str, Any]]:
        """Parameters of the GNSS receivers by their files."""
        return tables_with(self.shown.sequence, [*messages.FIX, "pdop"], "gnss")

    @cached_property
    def barometers(self) -> dict[str, dict[str, Any]]:
        """Parameters of the barometers by their files."""
        return tables_with(self.shown.sequence, [messages.PRESSURE], "baro")

    @cached_property
    def gimbals(self) -> dict[str, list[str]]:
        """Joints of the gimbals by the files of their encoders' readings."""
        tables = tables_of(self.shown.sequence)
        return {name: gimbal_joints(each) for name, each in tables.items() if each.get("kind") == GIMBAL}

    @cached_property
    def range_finders(self) -> dict[str, Laser]:
        """The laser range finders by their files."""
        return range_finders_of(self.shown.sequence)

    @cached_property
    def lidars(self) -> dict[str, Lidar]:
        """The lidars by their files."""
        return lidars_of(self.shown.sequence)

    @property
    def sensors(self) -> tuple[str, ...]:
        """Files of readings that the bag has."""
        on_body = (self.imus, self.receivers, self.barometers, self.range_finders, self.lidars, self.gimbals)
        return tuple(file for found in on_body for file in found)

    def place(self, receiver: dict[str, Any]) -> Datum:
        """Geodetic position of the world's origin for a receiver."""
        return self.datum or Datum(float(receiver.get("latitude_deg", 0.0)), 0.0, 0.0)

    def topics(self) -> Iterator[Channel]:
        """All topics; messages with equal stamps are recorded in this order."""
        shown, sequence = self.shown, self.shown.sequence
        if not sequence.recorded:
            yield from self._ground_truth()
        for camera, each in shown.cameras.items():
            yield from self._camera(camera, each)
        for file, imu in self.imus.items():
            name, about = f"/{ros_name(file)}/data_raw", f"rates and specific forces of `{file}`"
            found = messages.imu_readings(shown, file, imu, name)
            yield Channel(name, "sensor_msgs/Imu", about, found)
        for file, gnss in self.receivers.items():
            name, about = f"/{ros_name(file)}/fix", f"fixes of `{file}`, the world's origin at {self.place(gnss)}"
            found = messages.fixes(shown, file, gnss, self.place(gnss), name)
            yield Channel(name, "sensor_msgs/NavSatFix", about, found)
        for file, baro in self.barometers.items():
            name, about = f"/{ros_name(file)}/pressure", f"pressures of `{file}`"
            found = messages.pressures(shown, file, baro, name)
            yield Channel(name, "sensor_msgs/FluidPressure", about, found)
        for file, joints in self.gimbals.items():
            name, about = f"/{ros_name(file)}/joint_states", f"measured angles of the joints in `{file}`"
            yield Channel(name, "sensor_msgs/JointState", about, joint_states(sequence, file, joints, name))
        for file, finder in self.range_finders.items():
            name, about = f"/{ros_name(file)}/range", f"ranges of `{file}` along its x axis"
            yield Channel(name, "sensor_msgs/Range", about, laser_messages.ranges(finder, name))
        for file, lidar in self.lidars.items():
            yield lidar_channel(file, lidar)

    def _camera(self, name: str, shown: Shown) -> Iterator[Channel]:
        """Calibration and images of a camera."""
        sequence, link = shown.sequence, optical_frame(name)
        of, info = ("", INFO) if name == MAIN else (f" of camera `{name}`", f"/{name}/camera_info")
        infos = messages.camera_infos(shown.camera, sequence.stamps_ns.tolist(), info, link)
        yield Channel(info, "sensor_msgs/CameraInfo", f"intrinsics and distortion{of}", infos)
        image = messages.image_topic(name, shown)
        first, second = tee(messages.pictures(shown))  # decoded once: the messages of a frame are written together
        stamps = sequence.stamps_ns.tolist()
        if self.images != "compressed":
            images = messages.raw_images(first, stamps, image, link)
            yield Channel(image, "sensor_msgs/Image", f"bgr8{of}", images)
        if self.images != "raw":
            topic = f"{image}/compressed"
            images = messages.compressed_images(second, stamps, topic, link)
            yield Channel(topic, "sensor_msgs/CompressedImage", f"PNG{of}", images)

    def _ground_truth(self) -> Iterator[Channel]:
        sequence, state = self.shown.sequence, true_state(self.shown.sequence, [*STATE, *RATES])
        sensors = {
            optical_frame(name): each.sequence.cam_from_body.inverse()
            for name, each in self.shown.cameras.items()
            if not each.sequence.on_gimbal
        }
        sensors |= {link_of(name): body_from_imu(sequence.body_folder / name, imu) for name, imu in self.imus.items()}
        sensors |= {link_of(name): Pose.identity() for name in (*self.receivers, *self.barometers)}
        lasers = [*self.range_finders.values(), *self.lidars.values()]
        sensors |= {link_of(laser.file): laser.on_body for laser in lasers}
        still = messages.extrinsics(sensors, int(state.stamps_ns[0]))
        yield Channel("/tf_static", "tf2_msgs/TFMessage", "poses of the sensors on `base_link`", still)
        moving = {optical_frame(n): s.sequence for n, s in self.shown.cameras.items() if s.sequence.on_gimbal}
        poses = [messages.transforms(state), *(moving_extrinsics(each, frame) for frame, each in moving.items())]
        on_body = "".join(f", `{frame}` on `base_link` at its images" for frame in moving)
        merged = heapq.merge(*poses, key=lambda each: each.stamp_ns)
        yield Channel("/tf", "tf2_msgs/TFMessage", f"ground truth: `base_link` in `world`{on_body}", merged)
        about = f"ground truth: pose in `world`, twist in `base_link`; {rows_of(self.shown.sequence)}"
        yield Channel("/odom", "nav_msgs/Odometry", about, messages.odometry(state, "/odom"))

    def limits(self) -> Iterator[str]:
        """Sentences on what the messages cannot represent, or represent with a different meaning."""
        counted = "they count from the beginning of the record, as in the sequence, and not from 1970"
        since = "they are those of the sequence" if self.shown.sequence.own_images else counted
        yield f"Stamps: {since}; the time of recording of a message is its header's stamp."
        if self.shown.sequence.recorded:
            yield "Ground truth: a recording has none, and no mount is known: there is no /odom, /tf and /tf_static."
        else:
            yield "Covariances: those of /odom are zero, since it is ground truth."
        for name, imu in self.imus.items():
            if not imu:
                yield f"Parameters: `{name}` is not described in sequence.json; its covariances are zero, unknown."
            yield f"Biases: the true biases of `{name}`, and its random walks, are not included."
        for name, gnss in self.receivers.items():
            yield (
                f"Datum: the world is a local frame; for `{name}` its origin is at latitude, longitude and height "
                f"{self.place(gnss)} (WGS 84, --datum), its y axis {gnss.get('north_deg', 0.0):g} degrees "
                f"counter-clockwise from north. The sky is that over {gnss.get('latitude_deg', 0.0):g} degrees north."
            )
            yield f"Fixes: velocities and satellite numbers of `{name}` are not included; variances follow from PDOP."
        for name in self.barometers:
            yield f"Pressures: the height of `{name}` above the floor is not included."
        for name in (*self.range_finders, *self.lidars):
            yield (
                f"Ranges: those of `{name}` are rounded to float32, NaN where there is no measurement; intensities are "
                "not simulated, and the true ranges are not included."
            )


def lidar_channel(file: str, lidar: Lidar) -> Channel:
    """Turns of a lidar, stamped with their first ray."""
    if laser_messages.is_plane(lidar):
        name, about = f"/{ros_name(file)}/scan", f"turns of `{file}`"
        return Channel(name, "sensor_msgs/LaserScan", about, laser_messages.scans(lidar, name))
    name, about = f"/{ros_name(file)}/points", f"turns of `{file}`: x y z ring time, a row for each ring"
    return Channel(name, "sensor_msgs/PointCloud2", about, laser_messages.clouds(lidar, name))


def optical_frame(camera: str) -> str:
    """Frame of a camera, by REP-103."""
    return messages.CAMERA if camera == MAIN else f"{camera}_optical_frame"


def _write(
    topics: list[Channel], path: Path, storage: str, about: dict[str, str], on_frame: Callable[[int], None]
) -> None:
    """Write the messages of all topics in the order of their stamps."""
    library = rosbags("rosbag2")
    plugin = {"mcap": library.StoragePlugin.MCAP, "sqlite3": library.StoragePlugin.SQLITE3}[storage]
    types, frame = typestore(), 0
    with path_for_rosbags(path) as place, library.Writer(place, version=VERSION, storage_plugin=plugin) as writer:
        for key, value in about.items():
            writer.set_custom_data(key, value)
        connections = {}
        for topic in topics:
            kind = topic.type.replace("/", "/msg/")
            quality = [_kept()] if topic.name == "/tf_static" else []
            connections[topic.name] = writer.add_connection(
                topic.name, kind, typestore=types, offered_qos_profiles=quality
            )
        for each in heapq.merge(*(topic.messages for topic in topics), key=lambda each: each.stamp_ns):
            connection = connections[each.topic]
            writer.write(connection, each.stamp_ns, types.serialize_cdr(each.message, connection.msgtype))
            if each.topic == INFO:
                frame += 1
                on_frame(frame)


def _kept() -> Any:
    """Quality of service of /tf_static: transient local, so that late subscribers get the last message."""
    kinds = rosbags("interfaces")
    for_ever = kinds.QosTime(0, 0)
    return kinds.Qos(
        history=kinds.QosHistory.KEEP_LAST,
        depth=1,
        reliability=kinds.QosReliability.RELIABLE,
        durability=kinds.QosDurability.TRANSIENT_LOCAL,
        deadline=for_ever,
        lifespan=for_ever,
        liveliness=kinds.QosLiveliness.AUTOMATIC,
        liveliness_lease_duration=for_ever,
        avoid_ros_namespace_conventions=False,
    )
