"""Sequences in the formats of others: EuRoC ASL, TUM RGB-D, KITTI odometry, BOP, video."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

from scenes.bop import export_bop
from scenes.camera import Camera
from scenes.folders import disk_errors
from scenes.frame_truth import read_depth
from scenes.sequence import Sequence
from trajectories.errors import UserError, unknown_name
from trajectories.files import new_folder, write_text
from trajectories.formats import write_euroc, write_kitti, write_tum
from trajectories.pose import Pose
from trajectories.trajectory import Trajectory

OnFrame = Callable[[int, int], None]


def export(sequence: Sequence, format: str, folder: Path, on_frame: OnFrame | None = None) -> None:
    """Write a sequence into `folder` in one of EXPORTS, whole or not at all; UserError for an unknown format."""
    if format not in EXPORTS:
        raise unknown_name("export format", format, list(EXPORTS))
    if folder.is_dir() and any(folder.iterdir()):
        raise UserError(f"{folder}: is not empty; name a new folder to export to")
    with disk_errors(folder), new_folder(folder) as new:
        EXPORTS[format](sequence, new, on_frame or (lambda done, total: None))


def export_euroc(sequence: Sequence, folder: Path, on_frame: OnFrame) -> None:
    """`mav0/cam0`, `mav0/state_groundtruth_estimate0` and, where the sequence has an IMU, `mav0/imu0`.

    Truth is the pose of the body (T_BS identity); the camera's T_BS is body from camera.
    """
    mav, stamps = folder / "mav0", sequence.stamps_ns.tolist()
    (mav / "cam0" / "data").mkdir(parents=True)
    lines = ["#timestamp [ns],filename", *(f"{stamp},{stamp}.png" for stamp in stamps)]
    write_text(mav / "cam0" / "data.csv", "\n".join(lines) + "\n")
    write_text(mav / "cam0" / "sensor.yaml", _euroc_camera(sequence))
    for frame, stamp in enumerate(stamps):
        (mav / "cam0" / "data" / f"{stamp}.png").write_bytes(sequence.image_bytes(frame))
        on_frame(frame + 1, len(stamps))
    truth = mav / "state_groundtruth_estimate0"
    truth.mkdir()
    write_euroc(sequence.truth, truth / "data.csv", sequence.truth_table[:, 9:12])
    write_text(
        truth / "sensor.yaml", "sensor_type: pose\ncomment: ground truth of the simulation\n" + _t_bs(Pose.identity())
    )
    imu = sequence.body_sensor("imu.csv")
    if imu is not None:
        (mav / "imu0").mkdir()
        rows = imu.splitlines()
        head = "#timestamp [ns],w_x [rad s^-1],w_y [rad s^-1],w_z [rad s^-1],a_x [m s^-2],a_y [m s^-2],a_z [m s^-2]"
        body = [",".join(row.split(",")[:7]) for row in rows[1:]]
        write_text(mav / "imu0" / "data.csv", "\n".join([head, *body]) + "\n")
        write_text(mav / "imu0" / "sensor.yaml", "sensor_type: imu\ncomment: simulated IMU\n" + _t_bs(Pose.identity()))


def export_tum(sequence: Sequence, folder: Path, on_frame: OnFrame) -> None:
    """`rgb/`, `rgb.txt`, `groundtruth.txt` of the camera (world from camera), and depth / 5000 m where there is any."""
    (folder / "rgb").mkdir()
    write_tum(camera_truth(sequence), folder / "groundtruth.txt")
    depths = sequence.folder / "depth"
    lists: dict[str, list[str]] = {"rgb": []}
    if depths.is_dir():
        (folder / "depth").mkdir()
        lists["depth"] = []
    for frame, stamp in enumerate(sequence.stamps_ns.tolist()):
        seconds = f"{stamp // 10**9}.{stamp % 10**9:09d}"
        (folder / "rgb" / f"{seconds}.png").write_bytes(sequence.image_bytes(frame))
        lists["rgb"].append(f"{seconds} rgb/{seconds}.png")
        if "depth" in lists:
            depth = np.clip(np.rint(5000.0 * read_depth(sequence, frame)), 0, 65535)
            cv2.imwrite(str(folder / "depth" / f"{seconds}.png"), depth.astype(np.uint16))
            lists["depth"].append(f"{seconds} depth/{seconds}.png")
        on_frame(frame + 1, len(sequence))
    for kind, lines in lists.items():
        write_text(folder / f"{kind}.txt", "\n".join(["# timestamp filename", *lines]) + "\n")


def export_kitti(sequence: Sequence, folder: Path, on_frame: OnFrame) -> None:
    """`image_2/`, `times.txt`, `calib.txt` and `poses.txt`: the camera, relative to nothing (world from camera)."""
    (folder / "image_2").mkdir()
    write_kitti(camera_truth(sequence), folder / "poses.txt")
    stamps = sequence.stamps_ns.tolist()
    write_text(folder / "times.txt", "".join(f"{stamp * 1e-9:.9e}\n" for stamp in stamps))
    c = sequence.camera
    P = [c.fx, 0.0, c.cx, 0.0, 0.0, c.fy, c.cy, 0.0, 0.0, 0.0, 1.0, 0.0]
    write_text(folder / "calib.txt", "".join(f"P{k}: " + " ".join(f"{v:.12e}" for v in P) + "\n" for k in range(4)))
    for frame in range(len(stamps)):
        (folder / "image_2" / f"{frame:06d}.png").write_bytes(sequence.image_bytes(frame))
        on_frame(frame + 1, len(stamps))


def export_video(sequence: Sequence, folder: Path, on_frame: OnFrame) -> None:
    """`video.mp4` (VP9, plays in browsers), with the model's edges drawn in `overlay.mp4`."""
    from scenes.contact_sheet import with_edges

    size = (sequence.camera.width, sequence.camera.height)
    rate = float(sequence.info.get("rate_hz", 15.0))
    fourcc = cv2.VideoWriter.fourcc(*"vp09")
    writers = [cv2.VideoWriter(str(folder / name), fourcc, rate, size) for name in ("video.mp4", "overlay.mp4")]
    for frame in range(len(sequence)):
        image = sequence.image(frame)
        writers[0].write(image)
        writers[1].write(with_edges(sequence, frame))
        on_frame(frame + 1, len(sequence))
    for writer in writers:
        writer.release()


def camera_truth(sequence: Sequence) -> Trajectory:
    """True `world_from_cam` at each frame."""
    body_from_cam = sequence.cam_from_body.inverse()
    poses = [sequence.truth.pose(k) @ body_from_cam for k in range(len(sequence))]
    return Trajectory.from_poses(sequence.stamps_ns.tolist(), poses)


def _t_bs(pose: Pose) -> str:
    data = ", ".join(f"{v:.12g}" for v in pose.matrix.reshape(-1))
    return f"T_BS:\n  cols: 4\n  rows: 4\n  data: [{data}]\n"


def _euroc_camera(sequence: Sequence) -> str:
    c: Camera = sequence.camera
    model = {"none": "radial-tangential", "radtan": "radial-tangential", "equidistant": "equidistant"}[
        c.distortion_model
    ]
    k = ", ".join(f"{v:.12g}" for v in (c.distortion or (0.0, 0.0, 0.0, 0.0)))
    return (
        "sensor_type: camera\ncomment: simulated camera\n"
        + _t_bs(sequence.cam_from_body.inverse())
        + f"rate_hz: {float(sequence.info.get('rate_hz', 0)):g}\nresolution: [{c.width}, {c.height}]\n"
        + "camera_model: pinhole\n"
        + f"intrinsics: [{c.fx:.12g}, {c.fy:.12g}, {c.cx:.12g}, {c.cy:.12g}]\n"
        + f"distortion_model: {model}\ndistortion_coefficients: [{k}]\n"
    )


EXPORTS: dict[str, Callable[[Sequence, Path, OnFrame], None]] = {
    "euroc": export_euroc,
    "tum": export_tum,
    "kitti": export_kitti,
    "bop": export_bop,
    "video": export_video,
}
