"""Messages of laser range finders and lidars: `Range`, `LaserScan` of one level ring, `PointCloud2` of others.

A range without a measurement is NaN (REP-117): whether a surface was too near, too far or too dark is not known.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uavbench.scenes.dataset.table_files import read_readings
from uavbench.scenes.exports.laser_readings import RANGE, Laser, Lidar, Turn
from uavbench.scenes.exports.ros.bag_messages import NS, Stamped, header, link_of, message
from uavbench.trajectories.pose import Array

INFRARED = 1
"""Constant of Range."""
POINT = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("ring", "<u2"), ("time", "<f4")])
"""A point as Velodyne's driver has it, without the intensity, which is not simulated: m; ring from the lowest up;
seconds since the stamp of the header."""
DATATYPES = {"<f4": 7, "<u2": 4}
"""Constants of PointField."""


def ranges(laser: Laser, topic: str) -> Iterator[Stamped]:
    """Ranges along the x axis of the sensor, which has no field of view, with the variance of their noise."""
    path = laser.sequence.body_folder / laser.file
    stamps_ns, values = read_readings(path, [RANGE], gaps=True)
    near_m2, far_m2 = (laser.parameter(name) ** 2 for name in ("noise_m", "far_noise_m"))
    far_m, limits = laser.parameter("far_m"), _limits(laser, "min_range", "max_range")
    for stamp, value in zip(stamps_ns.tolist(), values[:, 0].tolist(), strict=True):
        known = {"range": value, "variance": (near_m2 if value < far_m else far_m2) if np.isfinite(value) else 0.0}
        fields = {"header": header(stamp, link_of(laser.file)), "radiation_type": INFRARED, "field_of_view": 0.0}
        yield Stamped(topic, stamp, message("sensor_msgs/Range", **fields, **limits, **known))


def is_plane(lidar: Lidar) -> bool:
    """Whether the scans are in the plane of the sensor's x and y axes, as LaserScan requires."""
    return len(lidar.rings) == 1 and not lidar.elevations_rad.any()


def scans(lidar: Lidar, topic: str) -> Iterator[Stamped]:
    """Scans of one level ring, stamped with their first ray."""
    limits, period_s = _limits(lidar, "range_min", "range_max"), 1 / lidar.parameter("rate_hz")
    for turn in lidar.turns():
        steps = max(len(turn.stamps_ns) - 1, 1)
        first, last = float(turn.azimuths_rad[0]), float(turn.azimuths_rad[-1])
        stamp = int(turn.stamps_ns[0])
        fields = {
            "header": header(stamp, link_of(lidar.file)),
            "angle_min": first,
            "angle_max": last,
            "angle_increment": (last - first) / steps,
            "time_increment": float(turn.stamps_ns[-1] - stamp) / steps / NS,
            "scan_time": period_s,
            "ranges": turn.ranges_m[:, 0].astype(np.float32),
            "intensities": np.zeros(0, dtype=np.float32),
        }
        yield Stamped(topic, stamp, message("sensor_msgs/LaserScan", **fields, **limits))


def clouds(lidar: Lidar, topic: str) -> Iterator[Stamped]:
    """Turns as organized clouds, a row for each ring; points in the sensor's axes, each as of its own time."""
    elevations = lidar.elevations_rad
    layout = [
        message("sensor_msgs/PointField", name=name, offset=offset, datatype=DATATYPES[kind.str], count=1)
        for name, (kind, offset, *_) in dict(POINT.fields or {}).items()
    ]
    for turn in lidar.turns():
        stamp, points = int(turn.stamps_ns[0]), _points(turn, elevations)
        fields = {
            "header": header(stamp, link_of(lidar.file)),
            "height": points.shape[0],
            "width": points.shape[1],
            "fields": layout,
            "is_bigendian": False,
            "point_step": POINT.itemsize,
            "row_step": POINT.itemsize * points.shape[1],
            "data": points.reshape(-1).view(np.uint8),
            "is_dense": bool(np.isfinite(turn.ranges_m).all()),
        }
        yield Stamped(topic, stamp, message("sensor_msgs/PointCloud2", **fields))


def _points(turn: Turn, elevations_rad: Array) -> NDArray[np.void]:
    """Points (rings, steps) as POINT."""
    out = np.empty((len(elevations_rad), len(turn.stamps_ns)), dtype=POINT)
    for name, values in zip("xyz", np.moveaxis(turn.points(elevations_rad), -1, 0), strict=True):
        out[name] = values
    out["ring"] = np.arange(len(elevations_rad))[:, None]
    out["time"] = (turn.stamps_ns - turn.stamps_ns[0]) / NS
    return out


def _limits(laser: Laser, least: str, greatest: str) -> dict[str, Any]:
    """Limits of the range, m, by the names of a message's fields."""
    return {least: laser.parameter("least_range_m"), greatest: laser.parameter("greatest_range_m")}
