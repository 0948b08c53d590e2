"""Registry of export formats: EuRoC ASL, TUM RGB-D, KITTI odometry, BOP, video, bags, COLMAP, nerfstudio."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from uavbench.scenes.camera import Camera
from uavbench.scenes.dataset.disk_guards import disk_errors
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.scenes.dataset.table_files import ANEW
from uavbench.scenes.exports.bop import export_bop
from uavbench.scenes.exports.colmap import export_colmap
from uavbench.scenes.exports.croissant import write_croissant
from uavbench.scenes.exports.euroc import export_euroc, holds_lens
from uavbench.scenes.exports.kalibr import export_kalibr
from uavbench.scenes.exports.kitti import export_kitti
from uavbench.scenes.exports.nerfstudio import export_transforms
from uavbench.scenes.exports.notes import Held, shown_name, write_notes
from uavbench.scenes.exports.ros.bag import BagExport
from uavbench.scenes.exports.shown_images import Shown, camera_ground_truth, png
from uavbench.scenes.image_files import begin_video, finish_video
from uavbench.trajectories.errors import UserError, unknown_name
from uavbench.trajectories.files.writing import new_folder, write_text
from uavbench.trajectories.trajectory_files.formats import seconds, write_tum

OnFrame = Callable[[int, int], None]
Write = Callable[[Shown, Path, OnFrame], Held]
TUM_UNITS_PER_M = 5000.0
"""Units per metre of TUM's 16-bit depth images, which its tools require."""
LARGEST = 65535
"""Largest 16-bit value."""


@dataclass(frozen=True)
class Format:
    """Writer of a format, whether it can represent a camera's distortion, and whether several cameras.

    fixed_mounts: whether it has one pose of each camera on the body, so that a gimbal cannot be represented.
    """

    write: Write
    holds_lens: Callable[[Camera], bool]
    several: bool = False
    fixed_mounts: bool = False


def export(
    sequence: Sequence,
    format: str,
    folder: Path,
    on_frame: OnFrame | None = None,
    undistort: bool = False,
    **settings: Any,
) -> tuple[str, ...]:
    """Write a sequence into `folder` in one of EXPORTS, atomically; returns what the format does not represent.

    settings: fields of BagExport, for a bag. UserError for settings of another format, for an unknown format, for a
    distortion that the format cannot represent, unless `undistort` removes it from the images, and for a camera on a
    gimbal where the format has a fixed pose on the body.
    """
    if format not in EXPORTS:
        raise unknown_name("export format", format, list(EXPORTS))
    if folder.is_dir() and any(folder.iterdir()):
        raise UserError(f"{folder}: is not empty; choose a new folder to export to")
    write = _with_settings(format, settings)
    others = sequence.cameras if EXPORTS[format].several else {}
    for name, each in {shown_name(sequence): sequence, **others}.items():
        camera = each.camera
        if EXPORTS[format].fixed_mounts and each.on_gimbal:
            able = ", ".join(other for other, about in EXPORTS.items() if not about.fixed_mounts)
            raise UserError(
                f"{sequence.folder}: camera {name!r} is on a gimbal, and the format {format} has one pose of a "
                f"camera on the body for all images; choose one of {able}"
            )
        if not undistort and not EXPORTS[format].holds_lens(camera):
            raise UserError(
                f"{sequence.folder}: one of its cameras has the distortion {camera.distortion_model} "
                f"{list(camera.distortion)}, which the format {format} cannot represent; add --undistort to export "
                "undistorted images"
            )
    with disk_errors(folder), new_folder(folder) as new:
        try:
            held = write(Shown(sequence, undistort), new, on_frame or (lambda done, total: None))
            not_held = write_notes(sequence, format, new, held, undistort)
        except (ValueError, TypeError, OverflowError) as error:  # invalid numbers, missing poses, unordered stamps
            raise UserError(f"{sequence.folder}: has data that cannot be exported: {error}; {ANEW}") from error
        write_croissant(sequence, new, held, not_held)
        return not_held


def _with_settings(format: str, settings: dict[str, Any]) -> Write:
    """Writer of a format with these settings; UserError when the format has no such settings."""
    write = EXPORTS[format].write
    if isinstance(write, BagExport):
        return replace(write, **settings)
    if settings:
        bags = [name for name, each in EXPORTS.items() if isinstance(each.write, BagExport)]
        raise UserError(f"{' and '.join(settings)} are for bags ({', '.join(bags)}); the format {format} has none")
    return write


def export_tum(shown: Shown, folder: Path, on_frame: OnFrame) -> Held:
    """`rgb/`, `rgb.txt`, `groundtruth.txt` of the camera (world from camera), `camera.txt`, and depth in 1/5000 m."""
    sequence = shown.sequence
    (folder / "rgb").mkdir()
    write_tum(camera_ground_truth(sequence), folder / "groundtruth.txt", "world_from_cam")
    lists: dict[str, list[str]] = {"rgb": []}
    far = measured = 0
    for frame, stamp in enumerate(sequence.stamps_ns.tolist()):
        name = f"{seconds(stamp)}.png"
        (folder / "rgb" / name).write_bytes(shown.png(frame))
        lists["rgb"].append(f"{seconds(stamp)} rgb/{name}")
        depth = shown.depth(frame)
        if depth is not None:
            (folder / "depth").mkdir(exist_ok=True)
            units = np.rint(TUM_UNITS_PER_M * depth)
            measured, far = measured + int((units > 0).sum()), far + int((units > LARGEST).sum())
            units[units > LARGEST] = 0  # no measurement in this format, rather than a wrong one
            (folder / "depth" / name).write_bytes(png(units.astype(np.uint16)))
            lists.setdefault("depth", []).append(f"{seconds(stamp)} depth/{name}")
        on_frame(frame + 1, len(sequence))
    for kind, lines in lists.items():
        write_text(folder / f"{kind}.txt", "\n".join(["# timestamp filename", *lines]) + "\n")
    c = shown.camera
    intrinsics = " ".join(map(repr, (c.fx, c.fy, c.cx, c.cy)))
    write_text(folder / "camera.txt", f"# fx fy cx cy width height (px)\n{intrinsics} {c.width} {c.height}\n")
    files = {
        "rgb/, rgb.txt": "images by stamp",
        "groundtruth.txt": "world from camera at each image: timestamp tx ty tz qx qy qz qw",
        "camera.txt": "intrinsics of the pinhole: fx fy cx cy width height, px",
    }
    limits: list[str] = []
    if measured:
        files["depth/, depth.txt"] = "depth along the optical axis, 5000 units per metre; 0: no measurement"
    if far:
        limits.append(
            f"Depth: 16 bits end at {LARGEST / TUM_UNITS_PER_M:.3f} m; {100 * far / measured:.1f} % of the measured "
            "pixels are further away and are 0, no measurement."
        )
    annotations = ("depth",) if "depth" in lists else ()
    return Held(
        files=files, frames={"groundtruth.txt": "world_from_cam"}, annotations=annotations, limits=tuple(limits)
    )


def export_video(shown: Shown, folder: Path, on_frame: OnFrame) -> Held:
    """`video.mp4` (VP9, plays in browsers), with the model's edges drawn in `overlay.mp4`."""
    from uavbench.scenes.dataset.contact_sheet import edges_on

    sequence = shown.sequence
    size = (sequence.camera.width, sequence.camera.height)
    rate = float(sequence.info.get("rate_hz", 15.0))
    paths = [folder / name for name in ("video.mp4", "overlay.mp4")]
    writers = [begin_video(path, "vp09", rate, size) for path in paths]
    for frame in range(len(sequence)):
        image = shown.image(frame)
        writers[0].write(image)
        writers[1].write(edges_on(image.copy(), shown.camera, sequence, frame))
        on_frame(frame + 1, len(sequence))
    for writer, path in zip(writers, paths, strict=True):
        finish_video(writer, path, len(sequence))
    how = "undistorted" if shown.undistorted else "distorted as they are"
    files = {"video.mp4": f"the images, {how}", "overlay.mp4": "the same with the model's visible edges"}
    cut = " and ".join(side for side, px in zip(("column", "row"), size, strict=True) if px % 2)
    limits = (
        f"Stamps: a video has one rate, {rate:g} Hz; after lost frames it runs ahead.",
        "Poses and camera are not included; the compression of the video is lossy.",
        *([f"Size: the sides of a video are even; the last {cut} of each image is left out."] if cut else []),
    )
    return Held(files=files, frames={}, limits=limits)


def pinhole_only(camera: Camera) -> bool:
    """Whether a camera is a pinhole without distortion; an equidistant fisheye without coefficients is none."""
    return camera.distortion_model != "equidistant" and not any(camera.distortion)


EXPORTS: dict[str, Format] = {
    "euroc": Format(export_euroc, holds_lens, several=True, fixed_mounts=True),
    "kalibr": Format(export_kalibr, holds_lens, several=True, fixed_mounts=True),
    "tum": Format(export_tum, pinhole_only),
    "kitti": Format(export_kitti, pinhole_only),
    "bop": Format(export_bop, pinhole_only),
    "video": Format(export_video, lambda camera: True),
    "mcap": Format(BagExport("mcap"), lambda camera: True, several=True),
    "rosbag2": Format(BagExport("sqlite3"), lambda camera: True, several=True),
    "colmap": Format(export_colmap, lambda camera: True, several=True),
    "transforms": Format(export_transforms, lambda camera: True),
}
