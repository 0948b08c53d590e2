"""Conversion of a sequence to ROS 2 messages, each with its topic and time.

Frames are those of REP-103, 105 and 145: `world`, `base_link` (the body), `camera_optical_frame`, `imu_link` and
`gnss_link`. Time is that of the sequence, in ns, in headers and as the time of recording.
"""

import re
from collections import deque
from collections.abc import Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uavbench.scenes.camera import Camera
from uavbench.scenes.dataset.table_files import read_readings
from uavbench.scenes.exports.euroc import READINGS, TrueStates
from uavbench.scenes.exports.ros.geodetic import Datum
from uavbench.scenes.exports.shown_images import Picture, Shown
from uavbench.trajectories.bags.library import typestore
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.pose import Array, Pose, rotation_from_quaternion

WORLD, BODY, CAMERA = "world", "base_link", "camera_optical_frame"
FIX = ["px_m", "py_m", "pz_m"]
PRESSURE = "pressure_pa"
MODELS = {"none": ("plumb_bob", 5), "radtan": ("plumb_bob", 5), "equidistant": ("equidistant", 4)}
"""Distortion models of CameraInfo, and how many coefficients they have: k1 k2 p1 p2 k3, or k1 k2 k3 k4."""
NS, LAST_NS = 10**9, 2**31 * 10**9
"""Largest time of a header, whose seconds have 31 bits."""
DECODERS, AHEAD = 2, 4
"""Threads that decode images, and how many images are held: 4 are 2 GB of the largest cameras."""
NO_FIX, GPS, APPROXIMATED = -1, 1, 1
"""Constants of NavSatStatus and NavSatFix."""


@dataclass(frozen=True)
class Stamped:
    """A message of a topic and its time."""

    topic: str
    stamp_ns: int
    message: Any


def message(kind: str, **fields: Any) -> Any:
    """A message such as `sensor_msgs/Image`."""
    package, _, name = kind.partition("/")
    return typestore().types[f"{package}/msg/{name}"](**fields)


def header(stamp_ns: int, frame: str) -> Any:
    """Header of a message; UserError for a time outside its range."""
    if not 0 <= stamp_ns < LAST_NS:
        raise UserError(f"the stamp {stamp_ns} ns is outside the range of a ROS time stamp, 0 to 2^31 s")
    time = message("builtin_interfaces/Time", sec=stamp_ns // NS, nanosec=stamp_ns % NS)
    return message("std_msgs/Header", stamp=time, frame_id=frame)


def pictures(shown: Shown) -> Iterator[Picture]:
    """Every frame, read and decoded once, a few frames ahead of the writer."""
    with ThreadPoolExecutor(DECODERS) as pool:
        waiting: deque[Future[Picture]] = deque()
        for frame in range(len(shown.sequence)):
            for ahead in range(frame + len(waiting), min(frame + AHEAD, len(shown.sequence))):
                waiting.append(pool.submit(shown.picture, ahead))
            yield waiting.popleft().result()


def raw_images(
    pictures: Iterable[Picture], stamps_ns: Iterable[int], topic: str, link: str = CAMERA
) -> Iterator[Stamped]:
    """Images as `bgr8`."""
    for picture, stamp in zip(pictures, stamps_ns, strict=True):
        height, width = picture.image.shape[:2]
        size = {"height": height, "width": width, "step": 3 * width}
        data = {"encoding": "bgr8", "is_bigendian": 0, "data": picture.image.reshape(-1)}
        yield Stamped(topic, stamp, message("sensor_msgs/Image", header=header(stamp, link), **size, **data))


def compressed_images(
    pictures: Iterable[Picture], stamps_ns: Iterable[int], topic: str, link: str = CAMERA
) -> Iterator[Stamped]:
    """Images as PNG files: those of the sequence, byte by byte, unless they are undistorted."""
    for picture, stamp in zip(pictures, stamps_ns, strict=True):
        data = np.frombuffer(picture.png, dtype=np.uint8)
        fields = {"header": header(stamp, link), "format": "png", "data": data}
        yield Stamped(topic, stamp, message("sensor_msgs/CompressedImage", **fields))


def camera_infos(camera: Camera, stamps_ns: Iterable[int], topic: str, link: str = CAMERA) -> Iterator[Stamped]:
    """Intrinsics and distortion at each image; P is that of undistorted images with the same matrix K."""
    model, count = MODELS[camera.distortion_model]
    region = message("sensor_msgs/RegionOfInterest", x_offset=0, y_offset=0, height=0, width=0, do_rectify=False)
    fields = {
        "height": camera.height,
        "width": camera.width,
        "distortion_model": model,
        "d": np.array((*camera.distortion, *[0.0] * count)[:count]),
        "k": camera.K.reshape(-1),
        "r": np.eye(3).reshape(-1),
        "p": np.column_stack([camera.K, np.zeros(3)]).reshape(-1),
        "binning_x": 0,
        "binning_y": 0,
        "roi": region,
    }
    for stamp in stamps_ns:
        yield Stamped(topic, stamp, message("sensor_msgs/CameraInfo", header=header(stamp, link), **fields))


def odometry(state: TrueStates, topic: str) -> Iterator[Stamped]:
    """Pose of the body in the world, and its twist in the body's own axes; covariances of zero."""
    axes = rotation_from_quaternion(state.values[:, 3:7])
    velocity = np.einsum("nji,nj->ni", axes, state.values[:, 7:10])
    twists = np.column_stack([velocity, state.values[:, 10:]])
    zeros = np.zeros(36)
    for stamp, pose, twist in _rows(state.stamps_ns, state.values[:, :7], twists):
        place = message("geometry_msgs/Pose", position=_xyz("Point", pose), orientation=_quaternion(pose[3:]))
        moves = message("geometry_msgs/Twist", linear=_xyz("Vector3", twist), angular=_xyz("Vector3", twist[3:]))
        fields = {
            "header": header(stamp, WORLD),
            "child_frame_id": BODY,
            "pose": message("geometry_msgs/PoseWithCovariance", pose=place, covariance=zeros),
            "twist": message("geometry_msgs/TwistWithCovariance", twist=moves, covariance=zeros),
        }
        yield Stamped(topic, stamp, message("nav_msgs/Odometry", **fields))


def transforms(state: TrueStates) -> Iterator[Stamped]:
    """`base_link` in `world`, on /tf."""
    for stamp, pose in _rows(state.stamps_ns, state.values[:, :7]):
        yield Stamped("/tf", stamp, message("tf2_msgs/TFMessage", transforms=[transform(stamp, WORLD, BODY, pose)]))


def extrinsics(body_from_sensor: dict[str, Pose], stamp_ns: int) -> Iterator[Stamped]:
    """Extrinsics of the sensors on the body, by frame, for /tf_static."""
    rows = {
        name: [*pose.translation.tolist(), *pose.quaternion_wxyz.tolist()] for name, pose in body_from_sensor.items()
    }
    found = [transform(stamp_ns, BODY, name, row) for name, row in rows.items()]
    yield Stamped("/tf_static", stamp_ns, message("tf2_msgs/TFMessage", transforms=found))


def imu_readings(shown: Shown, name: str, imu: dict[str, Any], topic: str) -> Iterator[Stamped]:
    """Rates and specific forces of a file of readings, with the variances of their white noise (REP-145).

    There is no orientation: the first element of its covariance is -1.
    """
    path = shown.sequence.body_folder / name
    none = np.array([-1.0, *[0.0] * 8])
    gyro, accel = (_noise(imu, key) for key in ("gyro_noise_rad_s_sqrt_hz", "accel_noise_m_s2_sqrt_hz"))
    for stamp, row in _rows(*read_readings(path, READINGS)):
        fields = {
            "header": header(stamp, link_of(name)),
            "orientation": _quaternion([1.0, 0.0, 0.0, 0.0]),
            "orientation_covariance": none,
            "angular_velocity": _xyz("Vector3", row),
            "angular_velocity_covariance": gyro,
            "linear_acceleration": _xyz("Vector3", row[3:]),
            "linear_acceleration_covariance": accel,
        }
        yield Stamped(topic, stamp, message("sensor_msgs/Imu", **fields))


def fixes(shown: Shown, name: str, gnss: dict[str, Any], datum: Datum, topic: str) -> Iterator[Stamped]:
    """Geodetic fixes of a GNSS receiver; without a fix, NaN and STATUS_NO_FIX.

    Each variance is a third of PDOP^2 times the variance of one range.
    """
    path = shown.sequence.body_folder / name
    stamps_ns, values = read_readings(path, [*FIX, "pdop"], gaps=True)
    turn = np.radians(float(gnss.get("north_deg", 0.0)))
    c, s = np.cos(turn), np.sin(turn)
    east_north_up = values[:, :3] @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    range_m2 = float(gnss.get("slow_m", 0.0)) ** 2 + float(gnss.get("white_m", 0.0)) ** 2
    places = np.column_stack([datum.geodetic(east_north_up), range_m2 * values[:, 3] ** 2 / 3])
    for stamp, (latitude, longitude, height, variance) in _rows(stamps_ns, places):
        fixed = np.isfinite(latitude)
        known = bool(fixed and variance > 0)
        yield Stamped(
            topic,
            stamp,
            message(
                "sensor_msgs/NavSatFix",
                header=header(stamp, link_of(name)),
                status=message("sensor_msgs/NavSatStatus", status=0 if fixed else NO_FIX, service=GPS),
                latitude=latitude,
                longitude=longitude,
                altitude=height,
                position_covariance=(variance if known else 0.0) * np.eye(3).reshape(-1),
                position_covariance_type=APPROXIMATED if known else 0,
            ),
        )


def pressures(shown: Shown, name: str, baro: dict[str, Any], topic: str) -> Iterator[Stamped]:
    """Pressures of a barometer, Pa, with the variance of their white noise; 0, unknown, where it is not given."""
    path = shown.sequence.body_folder / name
    variance = float(baro.get("noise_pa", 0.0)) ** 2
    for stamp, (pressure,) in _rows(*read_readings(path, [PRESSURE])):
        fields = {"header": header(stamp, link_of(name)), "fluid_pressure": pressure, "variance": variance}
        yield Stamped(topic, stamp, message("sensor_msgs/FluidPressure", **fields))


def image_topic(camera: str, shown: Shown) -> str:
    """Topic of the images of a camera: `image_rect` where a distortion was removed from them (image_pipeline)."""
    changed = shown.undistorted and shown.sequence.camera.distortion_model != "none"
    return f"/{camera}/image_rect" if changed else f"/{camera}/image_raw"


def ros_name(file: str) -> str:
    """A file name as a valid ROS name: letters, digits and underscores."""
    return re.sub(r"[^a-z0-9_]", "_", Path(file).stem.lower())


def link_of(file: str) -> str:
    """Frame of the sensor of a file of readings."""
    return f"{ros_name(file)}_link"


def _rows(stamps_ns: NDArray[np.int64], *tables: Array) -> Iterator[tuple[Any, ...]]:
    return zip(stamps_ns.tolist(), *(table.tolist() for table in tables), strict=True)


def _noise(imu: dict[str, Any], key: str) -> Array:
    """Covariance (9,) of white noise of a given density at the IMU's rate; zeros (unknown) when it is not given."""
    variance = float(imu.get(key, 0.0)) ** 2 * float(imu.get("rate_hz", 0.0))
    return variance * np.eye(3).reshape(-1)


def transform(stamp_ns: int, parent: str, child: str, pose: list[float]) -> Any:
    """Pose of a frame in its parent, position and quaternion w x y z, as `TransformStamped`."""
    moved = message("geometry_msgs/Transform", translation=_xyz("Vector3", pose), rotation=_quaternion(pose[3:]))
    head = header(stamp_ns, parent)
    return message("geometry_msgs/TransformStamped", header=head, child_frame_id=child, transform=moved)


def _xyz(kind: str, row: list[float]) -> Any:
    return message(f"geometry_msgs/{kind}", x=row[0], y=row[1], z=row[2])


def _quaternion(wxyz: list[float]) -> Any:
    return message("geometry_msgs/Quaternion", x=wxyz[1], y=wxyz[2], z=wxyz[3], w=wxyz[0])
