"""Messages of a camera on a gimbal: its pose on the body at each image, and the encoders' readings."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from uavbench.scenes.dataset.sequence import Sequence
from uavbench.scenes.dataset.table_files import read_readings
from uavbench.scenes.exports.ros.bag_messages import BODY, Stamped, header, message, ros_name, transform


def moving_extrinsics(sequence: Sequence, frame: str) -> Iterator[Stamped]:
    """True pose of a camera on the body at each of its images, on /tf, by the clock of the body."""
    for number, stamp_ns in enumerate((sequence.stamps_ns + sequence.timeshift_cam_imu_ns).tolist()):
        pose = sequence.cam_from_body_at(number).inverse()
        row = [*pose.translation.tolist(), *pose.quaternion_wxyz.tolist()]
        moved = transform(stamp_ns, BODY, frame, row)
        yield Stamped("/tf", stamp_ns, message("tf2_msgs/TFMessage", transforms=[moved]))


def joint_states(sequence: Sequence, file: str, joints: list[str], topic: str) -> Iterator[Stamped]:
    """Measured angles of the joints of a gimbal, rad; velocities and efforts are not measured."""
    path = sequence.body_folder / file
    names, none = [f"{ros_name(file)}_{joint}" for joint in joints], np.zeros(0)
    stamps_ns, table = read_readings(path, [f"{joint}_rad" for joint in joints])
    for stamp_ns, row in zip(stamps_ns.tolist(), table, strict=True):
        fields: dict[str, Any] = {"name": names, "position": row, "velocity": none, "effort": none}
        head = header(stamp_ns, BODY)
        yield Stamped(topic, stamp_ns, message("sensor_msgs/JointState", header=head, **fields))
