"""Sequences in the layout of KITTI's odometry benchmark (Geiger et al. 2012): images, scans, calibration and poses."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from uavbench.scenes.exports.euroc import TrueStates, true_state
from uavbench.scenes.exports.laser_readings import Lidar, Turn, lidars_of
from uavbench.scenes.exports.notes import Held
from uavbench.scenes.exports.shown_images import Shown, camera_ground_truth
from uavbench.trajectories.files.writing import write_text
from uavbench.trajectories.pose import Array, Pose, rotation_from_quaternion
from uavbench.trajectories.sensors.ranging import same_sign
from uavbench.trajectories.trajectory_files.formats import seconds, write_kitti

CAMERAS = 4
"""Cameras of the benchmark; each of its calibrations has P0 to P3."""


def export_kitti(shown: Shown, folder: Path, on_frame: Callable[[int, int], None]) -> Held:
    """`image_2/`, `times.txt`, `calib.txt` and `poses.txt` (`world_from_cam`, not relative to the first frame).

    With a lidar (of several, that with the most rings) `velodyne/` has a scan for each image, and `calib.txt` has `Tr`,
    the pose of the lidar in the camera.
    """
    sequence = shown.sequence
    (folder / "image_2").mkdir()
    write_kitti(camera_ground_truth(sequence), folder / "poses.txt")
    stamps = sequence.stamps_ns.tolist()
    write_text(folder / "times.txt", "".join(f"{seconds(stamp)}\n" for stamp in stamps))
    lidars = lidars_of(sequence)
    most = max(lidars.values(), key=lambda each: len(each.rings), default=None)
    lidar = None if sequence.on_gimbal else most
    write_text(folder / "calib.txt", _calibration(shown, lidar))
    for frame in range(len(stamps)):
        (folder / "image_2" / f"{frame:06d}.png").write_bytes(shown.png(frame))
        on_frame(frame + 1, len(stamps))
    files = {
        "image_2/": "images by number",
        "poses.txt": "world from camera at each image: 3x4 matrix by rows",
        "times.txt": "stamps of the images",
        "calib.txt": "projection matrices, px",
    }
    limits = [
        "Poses: they are in the world, the structure's frame; the first one is not the identity, as it is in KITTI's "
        "own files.",
        "Cameras: there is one; P0 to P3 of `calib.txt` are equal, and there is no baseline"
        + ("." if lidar else " and no laser scanner."),
    ]
    if lidar is not None:
        _write_scans(lidar, folder / "velodyne")
        files["calib.txt"] += "; Tr: camera from lidar, m"
        files["velodyne/"] = f"scans of `{lidar.file}` by number of the image: float32 x y z reflectance, m"
        limits.append(
            f"Scans: that of an image is the turn of `{lidar.file}` nearest to it, its points moved to the time of the "
            "image by the true motion of the vehicle; their own times are not included. Reflectance is that of all "
            f"surfaces, {_reflectance(lidar):g}; steps without a measurement have no point."
        )
    elif lidars:
        limits.append("Scans: Tr is one pose of the lidar in the camera, which a camera on a gimbal does not have.")
    sensors = () if lidar is None else (lidar.file,)
    return Held(files=files, frames={"poses.txt": "world_from_cam"}, sensors=sensors, limits=tuple(limits))


def _calibration(shown: Shown, lidar: Lidar | None) -> str:
    """P0 to P3, and Tr (3, 4), with which a point of the lidar is at the pixel P2 Tr x."""
    c = shown.camera
    rows = {f"P{k}": [c.fx, 0.0, c.cx, 0.0, 0.0, c.fy, c.cy, 0.0, 0.0, 0.0, 1.0, 0.0] for k in range(CAMERAS)}
    if lidar is not None:
        rows["Tr"] = (shown.sequence.cam_from_body @ lidar.on_body).matrix[:3].reshape(-1).tolist()
    return "".join(f"{name}: " + " ".join(map(repr, row)) + "\n" for name, row in rows.items())


def _write_scans(lidar: Lidar, folder: Path) -> None:
    """A file for each image: the turn whose middle is nearest, as seen by the lidar at the time of the image."""
    sequence, motion = lidar.sequence, true_state(lidar.sequence)
    folder.mkdir()
    turns = list(lidar.turns())
    middles = np.array([turn.stamps_ns[[0, -1]].mean() for turn in turns])
    world_from_body = sequence.ground_truth
    for frame, stamp in enumerate((sequence.stamps_ns + sequence.timeshift_cam_imu_ns).tolist()):
        turn = turns[int(np.argmin(np.abs(middles - stamp)))]
        lidar_from_world = (world_from_body.pose(frame) @ lidar.on_body).inverse()
        points = lidar_from_world.transform(_in_world(turn, lidar.elevations_rad, lidar.on_body, motion).reshape(-1, 3))
        known = points[np.isfinite(points).all(axis=1)]
        rows = np.column_stack([known, np.full(len(known), _reflectance(lidar))]).astype("<f4")
        (folder / f"{frame:06d}.bin").write_bytes(rows.tobytes())


def _in_world(turn: Turn, elevations_rad: Array, body_from_lidar: Pose, motion: TrueStates) -> Array:
    """Points (rings, n, 3) of a turn in the world, each from where the body was at its stamp, between known states."""
    at = [np.interp(turn.stamps_ns, motion.stamps_ns, column) for column in motion.values[:, :3].T]
    q = [np.interp(turn.stamps_ns, motion.stamps_ns, column) for column in same_sign(motion.values[:, 3:7]).T]
    rotations = rotation_from_quaternion(np.column_stack(q))
    points = turn.points(elevations_rad)
    on_body = body_from_lidar.transform(points.reshape(-1, 3)).reshape(points.shape)
    return np.asarray(np.einsum("nij,rnj->rni", rotations, on_body) + np.column_stack(at))


def _reflectance(lidar: Lidar) -> float:
    """Reflectance of all surfaces by the model of the sensor; 0 where it is not known."""
    return float(lidar.about.get("reflectance", 0.0))
