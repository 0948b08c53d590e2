"""Files of a camera on a gimbal: its pose on the body at each frame, and the readings of the gimbal's encoders."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uavbench.scenes.dataset.body import GIMBAL
from uavbench.scenes.dataset.ground_truth_files import MOUNTS_COLUMNS, MOUNTS_FILE
from uavbench.scenes.dataset.spec_record import described
from uavbench.scenes.spec import BodyCamera
from uavbench.trajectories.camera_mount import MAIN
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.writing import write_text
from uavbench.trajectories.flight_record import Flight
from uavbench.trajectories.gimbal.gimbal import Gimbal
from uavbench.trajectories.gimbal.motion import GimbalMotion
from uavbench.trajectories.random_streams import stream
from uavbench.trajectories.sensors.sensor import write_table


def cam_from_body_record(camera: BodyCamera) -> Any:
    """Value of `cam_from_body` in `sequence.json`: a matrix (4, 4), or the name of the file of those at each frame."""
    if isinstance(camera.mount, Gimbal):
        return MOUNTS_FILE
    return camera.mount.at_rest.cam_from_body.matrix.tolist()


def write_mounts(folder: Path, motion: GimbalMotion, times_ns: NDArray[np.int64], stamps_ns: NDArray[np.int64]) -> None:
    """Write the true `cam_from_body` and the true angles of the joints at frames exposed at times_ns (n,)."""
    lines = [",".join(MOUNTS_COLUMNS)]
    for i, (time_ns, stamp_ns) in enumerate(zip(times_ns.tolist(), stamps_ns.tolist(), strict=True)):
        pose, angles = motion(time_ns), motion.angles(np.array([time_ns]))[0]
        numbers = [*pose.translation.tolist(), *pose.quaternion_wxyz.tolist(), *angles.tolist()]
        lines.append(",".join(map(repr, [i, stamp_ns, *numbers])))
    write_text(folder / MOUNTS_FILE, "\n".join(lines) + "\n")


def gimbal_file(camera: str) -> str:
    """Name of the file of the readings of a camera's gimbal."""
    return f"{GIMBAL}.csv" if camera == MAIN else f"{GIMBAL}-{camera}.csv"


def write_readings(folder: Path, camera: BodyCamera, motion: GimbalMotion, flight: Flight, seed: int) -> dict[str, Any]:
    """Write the readings of a camera's gimbal; returns its parameters, as `sequence.json` has them for each sensor.

    UserError naming the gimbal when it cannot be read on this flight, or its file exists.
    """
    gimbal, name = camera.mount, gimbal_file(camera.name)
    assert isinstance(gimbal, Gimbal)
    if (folder / name).exists():
        raise UserError(f"gimbal of {camera.name}: a sensor writes {name}, too; give its class another name")
    try:
        table = gimbal.encoder.measure(gimbal.joints, motion, flight, stream(seed, "gimbal", camera.name))
    except UserError as error:
        raise UserError(f"gimbal of {camera.name}: {error}") from None
    write_table(table, folder / name)
    return gimbal_record(gimbal, camera.name)


def gimbal_record(gimbal: Gimbal, camera: str) -> dict[str, Any]:
    """Parameters of a gimbal's encoders as JSON, with those that relate its readings to the camera's pose."""
    return {
        "kind": GIMBAL,
        "camera": camera,
        "joints": list(gimbal.joints),
        "yaw_deg": gimbal.yaw_deg,
        "offset_m": list(gimbal.offset_m),
        **described(gimbal.encoder),
        "measured": [f"{joint}_rad" for joint in gimbal.joints],
    }
