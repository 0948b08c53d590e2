"""Sequences in the layout of EuRoC's ASL format (Burri et al. 2016): camera, IMUs, and the true state of the body."""

from collections.abc import Callable, Iterable
from itertools import count
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.scenes.camera import Camera
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.scenes.dataset.table_files import read_integers, read_numbers, read_readings
from uavbench.scenes.exports.notes import Held, tables_with
from uavbench.scenes.exports.shown_images import Shown
from uavbench.trajectories.errors import UserError, one_line
from uavbench.trajectories.files.limits import TABLE
from uavbench.trajectories.files.tables import column_names
from uavbench.trajectories.files.writing import write_text
from uavbench.trajectories.pose import Array, Pose
from uavbench.trajectories.trajectory import Trajectory
from uavbench.trajectories.trajectory_files.formats import write_euroc

STATE = ["px_m", "py_m", "pz_m", "qw", "qx", "qy", "qz", "vx_m_s", "vy_m_s", "vz_m_s"]
RATES = ["wx_rad_s", "wy_rad_s", "wz_rad_s"]
READINGS = [f"w{a}_rad_s" for a in "xyz"] + [f"a{a}_m_s2" for a in "xyz"]
BIASES = [f"gyro_bias_{a}_rad_s" for a in "xyz"] + [f"accel_bias_{a}_m_s2" for a in "xyz"]
NOISE = {
    "gyroscope_noise_density": ("gyro_noise_rad_s_sqrt_hz", "rad / s / sqrt(Hz)"),
    "gyroscope_random_walk": ("gyro_walk_rad_s2_sqrt_hz", "rad / s^2 / sqrt(Hz)"),
    "accelerometer_noise_density": ("accel_noise_m_s2_sqrt_hz", "m / s^2 / sqrt(Hz)"),
    "accelerometer_random_walk": ("accel_walk_m_s3_sqrt_hz", "m / s^3 / sqrt(Hz)"),
}
"""Keys of an IMU's sensor.yaml, the corresponding parameters, and their units."""
MODELS = {"none": "radial-tangential", "radtan": "radial-tangential", "equidistant": "equidistant"}
COEFFICIENTS = 4
"""Coefficients of both distortion models of the format: k1 k2 p1 p2, or k1 k2 k3 k4."""


def holds_lens(camera: Camera) -> bool:
    """Whether the format can represent this distortion: at most four coefficients."""
    return not any(camera.distortion[COEFFICIENTS:])


def export_euroc(shown: Shown, folder: Path, on_frame: Callable[[int, int], None]) -> Held:
    """`mav0/` with cam0, cam1 ..., imu0, imu1 ... and state_groundtruth_estimate0.

    Ground truth is the state of the body (its T_BS is the identity) at every row of the flight's record and at every
    image, with the true biases of imu0; T_BS of camera and IMUs map from the sensor frame to the body frame.
    """
    sequence, mav = shown.sequence, folder / "mav0"
    cameras = shown.cameras
    total, done = sum(len(each.sequence) for each in cameras.values()), count(1)
    for k, camera in enumerate(cameras.values()):
        _write_camera(camera, mav / f"cam{k}", lambda: on_frame(next(done), total))
    imus = imus_of(sequence)
    for k, (name, imu) in enumerate(imus.items()):
        _write_imu(mav / f"imu{k}", sequence.body_folder / name, imu)
    _write_ground_truth(mav / "state_groundtruth_estimate0", sequence, next(iter(imus), None))
    poses, biases = "mav0/state_groundtruth_estimate0/data.csv", ", biases of imu0" if imus else ""
    files = {
        "mav0/cam0": "images by stamp; sensor.yaml: body from camera, intrinsics, distortion",
        poses: f"body in the world, its velocity there{biases}; {rows_of(sequence)}",
    }
    files |= {f"mav0/cam{k}": f"the same for camera `{name}`" for k, name in enumerate(cameras) if k}
    files |= {f"mav0/imu{k}": f"rates and specific forces of `{name}`" for k, name in enumerate(imus)}
    limits = [f"Parameters: `{name}` is not described in sequence.json." for name, imu in imus.items() if not imu]
    limits += [f"Biases: those of imu{k} (`{name}`) are not included." for k, name in enumerate(imus) if k]
    if any(any(imu.get("offset_m", ())) for imu in imus.values()):
        limits.append(
            "Body: an IMU is not at the body's origin (see its T_BS); for a tool that takes the IMU as the body, "
            "transform the ground truth by T_BS."
        )
    return Held(
        files=files,
        frames={poses: "world_from_body"},
        sensors=tuple(imus),
        limits=tuple(limits),
        cameras=tuple(sequence.cameras),
    )


def _write_camera(shown: Shown, folder: Path, on_frame: Callable[[], None]) -> None:
    stamps = shown.sequence.stamps_ns.tolist()
    (folder / "data").mkdir(parents=True)
    lines = ["#timestamp [ns],filename", *(f"{stamp},{stamp}.png" for stamp in stamps)]
    write_text(folder / "data.csv", "\n".join(lines) + "\n")
    write_text(folder / "sensor.yaml", _camera_yaml(shown.sequence, shown.camera))
    for frame, stamp in enumerate(stamps):
        (folder / "data" / f"{stamp}.png").write_bytes(shown.png(frame))
        on_frame()


def yaml_number(value: float) -> str:
    """A number in the syntax of YAML 1.1, which requires a decimal point before an exponent."""
    text = repr(float(value))
    return text.replace("e", ".0e") if "e" in text and "." not in text else text


def imus_of(sequence: Sequence) -> dict[str, dict[str, Any]]:
    """Parameters of each IMU of a sequence, by the name of its file.

    They are empty for a file of readings that sequence.json does not list. UserError for an IMU's file without its
    columns.
    """
    unlisted = sorted(path.name for path in sequence.body_folder.glob("imu*.csv"))
    return tables_with(sequence, READINGS, "imu", unlisted)


def body_from_imu(readings: Path, imu: dict[str, Any]) -> Pose:
    """Pose of an IMU on the body, whose axes it shares; UserError naming the file with a wrong offset."""
    try:
        return Pose(np.eye(3), np.array(imu.get("offset_m", (0.0, 0.0, 0.0)), dtype=np.float64))
    except (ValueError, TypeError) as error:
        raise UserError(f"{readings.parent / 'sequence.json'}: offset_m of {readings.name}: {error}") from None


def _write_imu(folder: Path, readings: Path, imu: dict[str, Any]) -> None:
    folder.mkdir()
    head = "#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1]"
    head += ",a_RS_S_x [m s^-2],a_RS_S_y [m s^-2],a_RS_S_z [m s^-2]"
    read = read_readings(readings, READINGS)
    rows = zip(read.stamps_ns.tolist(), read.values.tolist(), strict=True)
    write_text(folder / "data.csv", "\n".join([head, *(f"{ns},{','.join(map(repr, row))}" for ns, row in rows)]) + "\n")
    kind = one_line(str(imu.get("kind", "IMU")))
    text = f"sensor_type: imu\ncomment: simulated {kind}\n{_t_bs(body_from_imu(readings, imu))}"
    if "rate_hz" in imu:
        text += f"rate_hz: {yaml_number(imu['rate_hz'])}\n"
    for key, (name, unit) in NOISE.items():
        if name in imu:
            text += f"{key}: {yaml_number(imu[name])}  # [ {unit} ]\n"
    write_text(folder / "sensor.yaml", text)


def _write_ground_truth(folder: Path, sequence: Sequence, imu: str | None) -> None:
    """State at the rows of flight.csv and at the images, in order."""
    stamps, state = true_states(sequence, 12)
    path = sequence.body_folder / "flight.csv"
    if path.is_file():
        stamps = np.concatenate([stamps, read_integers(path, ["stamp_ns"])[:, 0]])
        state = np.concatenate([state, read_numbers(path, STATE)])
        stamps, first = np.unique(stamps, return_index=True)
        state = state[first]
    motion = state[:, 7:]
    if imu is not None:
        motion = np.column_stack([motion, _biases(sequence.body_folder / imu, stamps)])
    folder.mkdir()
    write_euroc(Trajectory(stamps, state[:, :3], state[:, 3:7]), folder / "data.csv", motion)
    text = "sensor_type: pose\ncomment: ground truth of the body\n"
    write_text(folder / "sensor.yaml", text + _t_bs(Pose.identity()))


class TrueStates(NamedTuple):
    """True states (n, k) of the body at stamps_ns (n,) of the flight's clock."""

    stamps_ns: NDArray[np.int64]
    values: Array


def rows_of(sequence: Sequence) -> str:
    """When the states of `true_state` are, in words: without flight.csv, as of own images, at the images alone."""
    return "at 100 Hz and at each image" if (sequence.body_folder / "flight.csv").is_file() else "at each image"


def true_states(sequence: Sequence, columns: int) -> TrueStates:
    """States at the images of all cameras: columns 2 to `columns` of groundtruth.csv."""
    each = [sequence, *sequence.cameras.values()]
    stamps = [camera.stamps_ns + sequence.timeshift_cam_imu_ns for camera in each]
    values = np.concatenate([camera.ground_truth_table[:, 2:columns] for camera in each])
    return TrueStates(np.concatenate(stamps), values)


def true_state(sequence: Sequence, columns: Iterable[str] = STATE) -> TrueStates:
    """State at the rows of flight.csv and at the images, in order; columns: STATE, or these and RATES."""
    columns = list(columns)
    stamps, values = true_states(sequence, 2 + len(columns))
    path = sequence.body_folder / "flight.csv"
    if path.is_file():
        stamps = np.concatenate([stamps, read_integers(path, ["stamp_ns"])[:, 0]])
        values = np.concatenate([values, read_numbers(path, columns)])
    stamps, first = np.unique(stamps, return_index=True)
    return TrueStates(stamps, values[first])


def _biases(readings: Path, stamps_ns: np.ndarray) -> Array:
    """True biases (n, 6) of an IMU at stamps, linear between its readings; zeros where it has none."""
    if not set(BIASES) <= set(column_names(readings, TABLE)):
        return np.zeros((len(stamps_ns), 6))
    at, biases = read_readings(readings, BIASES)
    if not len(at):
        raise UserError(f"{readings}: has no readings; remove the file, and its table in sequence.json")
    return np.column_stack([np.interp(stamps_ns, at, column) for column in biases.T])


def _camera_yaml(sequence: Sequence, camera: Camera) -> str:
    intrinsics = ", ".join(map(yaml_number, (camera.fx, camera.fy, camera.cx, camera.cy)))
    k = (*camera.distortion, 0.0, 0.0, 0.0, 0.0)[:COEFFICIENTS]
    return (
        "sensor_type: camera\ncomment: simulated camera\n"
        + _t_bs(sequence.cam_from_body.inverse())
        + f"rate_hz: {yaml_number(sequence.info.get('rate_hz', 0))}\nresolution: [{camera.width}, {camera.height}]\n"
        + "camera_model: pinhole\n"
        + f"intrinsics: [{intrinsics}]  # fu, fv, cu, cv\n"
        + f"distortion_model: {MODELS[camera.distortion_model]}\n"
        + f"distortion_coefficients: [{', '.join(map(yaml_number, k))}]\n"
    )


def _t_bs(body_from_sensor: Pose) -> str:
    data = ", ".join(map(yaml_number, body_from_sensor.matrix.reshape(-1).tolist()))
    return f"T_BS:\n  cols: 4\n  rows: 4\n  data: [{data}]\n"
