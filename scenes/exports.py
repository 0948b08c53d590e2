"""Sequences in the formats of others: EuRoC ASL, TUM RGB-D, KITTI odometry, BOP, video."""

import json
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from scenes.camera import Camera
from scenes.folders import disk_errors
from scenes.sequence import Sequence
from trajectories.errors import UserError, unknown_name
from trajectories.files import new_folder, write_text
from trajectories.formats import write_euroc, write_kitti, write_tum
from trajectories.pose import Array, Pose
from trajectories.trajectory import Trajectory

OnFrame = Callable[[int, int], None]
BOP_DEPTH_SCALE = 0.1
"""Millimetres per unit of a BOP depth image, for what is nearer than 6.5 m."""
BOP_FAR_DEPTH_SCALE = 2.0
"""The same for what is further away: 16 bits then reach to 131 m."""


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
        (mav / "cam0" / "data" / f"{stamp}.png").write_bytes((sequence.folder / sequence.files[frame]).read_bytes())
        on_frame(frame + 1, len(stamps))
    truth = mav / "state_groundtruth_estimate0"
    truth.mkdir()
    write_euroc(sequence.truth, truth / "data.csv", sequence.truth_table[:, 9:12])
    write_text(
        truth / "sensor.yaml", "sensor_type: pose\ncomment: ground truth of the simulation\n" + _t_bs(Pose.identity())
    )
    imu = sequence.folder / "imu.csv"
    if imu.is_file():
        (mav / "imu0").mkdir()
        rows = imu.read_text(encoding="utf-8").splitlines()
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
        (folder / "rgb" / f"{seconds}.png").write_bytes((sequence.folder / sequence.files[frame]).read_bytes())
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
        (folder / "image_2" / f"{frame:06d}.png").write_bytes((sequence.folder / sequence.files[frame]).read_bytes())
        on_frame(frame + 1, len(stamps))


def export_bop(sequence: Sequence, folder: Path, on_frame: OnFrame) -> None:
    """BOP layout: `models/`, and `test/000001/` with rgb, depth and mask (where the sequence has them) and truth.

    One object, number 1: the structure. Lengths in millimetres.
    """
    scene, models = folder / "test" / "000001", folder / "models"
    (scene / "rgb").mkdir(parents=True)
    models.mkdir()
    write_text(models / "obj_000001.ply", _ply_mm(sequence.structure.vertices, sequence.structure.triangles))
    low, high = 1000 * sequence.structure.bounds
    points = sequence.structure.vertices
    diameter = 1000 * float(np.max([np.linalg.norm(points - p, axis=1).max() for p in points]))
    info = {"diameter": diameter} | {f"min_{a}": float(low[k]) for k, a in enumerate("xyz")}
    info |= {f"size_{a}": float(high[k] - low[k]) for k, a in enumerate("xyz")}
    write_text(models / "models_info.json", json.dumps({"1": info}) + "\n")
    camera = {"cx": sequence.camera.cx, "cy": sequence.camera.cy, "depth_scale": 1.0, "fx": sequence.camera.fx,
              "fy": sequence.camera.fy, "height": sequence.camera.height, "width": sequence.camera.width}  # fmt: skip
    write_text(folder / "camera.json", json.dumps(camera) + "\n")
    cameras, poses, infos = {}, {}, {}
    for frame in range(len(sequence)):
        name = f"{frame:06d}"
        (scene / "rgb" / f"{name}.png").write_bytes((sequence.folder / sequence.files[frame]).read_bytes())
        scale = _bop_images(sequence, frame, scene)
        pose = sequence.true_cam_from_world(frame)
        R, t = pose.rotation.reshape(-1).tolist(), (1000 * pose.translation).tolist()
        cameras[str(frame)] = {
            "cam_K": sequence.camera.K.reshape(-1).tolist(),
            "depth_scale": scale,
            "cam_R_w2c": R,
            "cam_t_w2c": t,
        }
        poses[str(frame)] = [{"cam_R_m2c": R, "cam_t_m2c": t, "obj_id": 1}]
        infos[str(frame)] = [_bop_info(sequence, frame)]
        on_frame(frame + 1, len(sequence))
    for file, content in (("scene_camera", cameras), ("scene_gt", poses), ("scene_gt_info", infos)):
        write_text(scene / f"{file}.json", json.dumps(content, indent=1) + "\n")


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


def read_depth(sequence: Sequence, frame: int) -> Array:
    """True depth (h, w) of a frame in metres, 0 where there is nothing."""
    path = sequence.folder / "depth" / f"{frame:06d}.png"
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    if image is None:
        raise FileNotFoundError(path)
    return np.asarray(image, dtype=np.float64) * float(sequence.info["depth_m_per_unit"])


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


def _ply_mm(vertices: Array, triangles: np.ndarray) -> str:
    head = ["ply", "format ascii 1.0", f"element vertex {len(vertices)}"]
    head += [f"property float {a}" for a in "xyz"]
    head += [f"element face {len(triangles)}", "property list uchar int vertex_indices", "end_header"]
    rows = [f"{x:.9g} {y:.9g} {z:.9g}" for x, y, z in (1000 * vertices).tolist()]
    return "\n".join([*head, *rows, *(f"3 {a} {b} {c}" for a, b, c in triangles.tolist())]) + "\n"


def _bop_images(sequence: Sequence, frame: int, scene: Path) -> float:
    """Write depth and masks of a frame where there are any; millimetres per unit of its depth image."""
    name = f"{frame:06d}"
    if (sequence.folder / "mask" / f"{name}.png").is_file():
        mask = 255 * _shown(sequence.folder / "mask" / f"{name}.png").astype(np.uint8)
        (scene / "mask_visib").mkdir(exist_ok=True)
        cv2.imwrite(str(scene / "mask_visib" / f"{name}_000000.png"), mask)
    if not (sequence.folder / "depth" / f"{name}.png").is_file():
        return 1.0
    depth_mm = 1000 * read_depth(sequence, frame)
    scale = BOP_DEPTH_SCALE if depth_mm.max() < 65535 * BOP_DEPTH_SCALE else BOP_FAR_DEPTH_SCALE
    units = np.rint(depth_mm / scale)
    units[units > 65535] = 0  # further than 16 bits reach: unknown, never wrapped
    (scene / "depth").mkdir(exist_ok=True)
    cv2.imwrite(str(scene / "depth" / f"{name}.png"), units.astype(np.uint16))
    return scale


def _bop_info(sequence: Sequence, frame: int) -> dict[str, object]:
    """Boxes and pixel counts of the structure: projected outline, and what the mask shows of it."""
    camera, pose = sequence.camera, sequence.true_cam_from_world(frame)
    seen = np.zeros((camera.height, camera.width), dtype=np.uint8)
    points = pose.transform(sequence.structure.vertices)
    for triangle in points[sequence.structure.triangles]:
        if (triangle[:, 2] > 0.01).all():
            cv2.fillConvexPoly(seen, np.rint(camera.project(triangle)).astype(np.int32).clip(-30000, 30000), 1)
    path = sequence.folder / "mask" / f"{frame:06d}.png"
    visible = _shown(path) if path.is_file() else seen.astype(bool)
    total, shown = int(seen.sum()), int(visible.sum())
    return {
        "bbox_obj": _box(seen.astype(bool)),
        "bbox_visib": _box(visible),
        "px_count_all": total,
        "px_count_valid": total,
        "px_count_visib": shown,
        "visib_fract": min(1.0, shown / total) if total else 0.0,
    }


def _shown(path: Path) -> NDArray[np.bool_]:
    """Where a mask image shows the structure."""
    image = np.asarray(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE), dtype=np.uint8)
    return np.asarray(image == 1)


def _box(mask: np.ndarray) -> list[int]:
    """x, y, width, height of what is set; -1s when nothing is."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if not len(rows):
        return [-1, -1, -1, -1]
    return [int(columns[0]), int(rows[0]), int(columns[-1] - columns[0] + 1), int(rows[-1] - rows[0] + 1)]


EXPORTS: dict[str, Callable[[Sequence, Path, OnFrame], None]] = {
    "euroc": export_euroc,
    "tum": export_tum,
    "kitti": export_kitti,
    "bop": export_bop,
    "video": export_video,
}
