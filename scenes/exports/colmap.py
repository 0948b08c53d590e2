"""Sequences as COLMAP models in text form (Schoenberger & Frahm 2016): cameras, posed images, points with tracks."""

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from uavbench.scenes.camera import Camera
from uavbench.scenes.exports.notes import Held
from uavbench.scenes.exports.shown_images import NUMBERED, STAMPS, Shown, write_masks, write_stamps
from uavbench.scenes.exports.surface_points import OnSurface, PointCloud
from uavbench.trajectories.files.writing import write_text
from uavbench.trajectories.pose import Pose

CENTRE_PX = 0.5
"""Centre of the first pixel in COLMAP and nerfstudio; here pixel centres lie at integer coordinates."""
AXES = "camera x right, y down, z forward; the first pixel's centre at (0.5, 0.5)"


@dataclass(frozen=True, eq=False)
class Posed:
    """An image of a model: a frame of a camera, the camera's number, and the image's name."""

    shown: Shown
    frame: int
    camera: int
    name: str


def export_colmap(shown: Shown, folder: Path, on_frame: Callable[[int, int], None]) -> Held:
    """`images/`, `masks/` and `sparse/0` with cameras.txt, images.txt and points3D.txt; the world is the structure's.

    Points are sampled on the model's surface; each is observed, without error, by every frame in which it is visible.
    """
    cameras, model = shown.cameras, folder / "sparse" / "0"
    (folder / "images").mkdir()
    model.mkdir(parents=True)
    cloud = PointCloud(OnSurface.drawn(shown.sequence.structure))
    several = len(cameras) > 1
    posed = [
        Posed(each, frame, number, f"{name}/{_image(frame)}" if several else _image(frame))
        for number, (name, each) in enumerate(cameras.items(), start=1)
        for frame in range(len(each.sequence))
    ]
    for done, image in enumerate(posed, start=1):
        path = folder / "images" / image.name
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(image.shown.png(image.frame))
        cloud.look(image.shown, image.frame)
        on_frame(done, len(posed))
    # COLMAP looks for the mask of images/000000.png as masks/000000.png.png.
    masked = True
    for name, each in cameras.items():
        masks = folder / "masks" / name if several else folder / "masks"
        if several and each.has("mask", 0):
            masks.parent.mkdir(exist_ok=True)
        masked &= write_masks(each, masks, lambda frame: f"{_image(frame)}.png")
    lines = [f"{number} {camera_line(each.camera)}\n" for number, each in enumerate(cameras.values(), start=1)]
    write_text(model / "cameras.txt", "# CAMERA_ID MODEL WIDTH HEIGHT PARAMS[]\n" + "".join(lines))
    write_text(model / "images.txt", _images(posed, cloud))
    write_text(model / "points3D.txt", _points(cloud))
    write_stamps(folder, {each.name: int(each.shown.sequence.stamps_ns[each.frame]) for each in posed})
    files = {
        "images/": "images by number",
        STAMPS: "time stamp of each image",
        "sparse/0/cameras.txt": "the camera, number 1: model, width, height and its parameters, px",
        "sparse/0/images.txt": "camera from world at each image, w first, and the points that it shows: x y point, px",
        "sparse/0/points3D.txt": "points on the model's surface: position, colour, error 0, and (image, index there)",
    }
    limits = [NUMBERED]
    if several:
        files["sparse/0/cameras.txt"] = "the cameras: " + ", ".join(
            f"{k} `{n}`" for k, n in enumerate(cameras, start=1)
        )
        files["images/"] = "images of each camera by number"
        if any(each.sequence.on_gimbal for each in cameras.values()):
            limits.append("Rig: a camera is on a gimbal, so the rig is not rigid, and there is no rig_config.json.")
        elif _at_once(cameras):
            write_text(folder / "rig_config.json", _rig(cameras))
            files["rig_config.json"] = "poses of the cameras on the rig, for `colmap rig_configurator`"
        else:
            limits.append("Rig: the cameras do not expose at the same times, so there is no rig_config.json.")
    if masked:
        files["masks/"] = "255 where the structure is visible, 0 elsewhere, where COLMAP extracts no features"
    return Held(
        files=files,
        frames={},
        annotations=("mask",) if masked else (),
        limits=(*limits, *cloud.limits(shown)),
        cameras=tuple(shown.sequence.cameras),
        camera_axes=AXES,
    )


def camera_line(camera: Camera) -> str:
    """Model, size and parameters of a camera as in cameras.txt; every distortion model has a counterpart."""
    parameters = [camera.fx, camera.fy, camera.cx + CENTRE_PX, camera.cy + CENTRE_PX, *camera.distortion]
    name = {"none": "PINHOLE", "radtan": "OPENCV", "equidistant": "OPENCV_FISHEYE"}[camera.distortion_model]
    if camera.distortion_model == "radtan" and len(camera.distortion) == 5:
        name, parameters = "FULL_OPENCV", [*parameters, 0.0, 0.0, 0.0]  # k1 k2 p1 p2 k3, and the denominator's k4 k5 k6
    return f"{name} {camera.width} {camera.height} " + " ".join(map(repr, parameters))


def _image(frame: int) -> str:
    return f"{frame:06d}.png"


def _at_once(cameras: dict[str, Shown]) -> bool:
    """Whether all cameras exposed images of the same number at the same time."""
    first, *others = (each.sequence.stamps_ns for each in cameras.values())
    return all(np.array_equal(first, stamps) for stamps in others)


def _rig(cameras: dict[str, Shown]) -> str:
    """Text of rig_config.json: cameras by the folder of their images, with cam_from_rig, the rig being the first."""
    rows: list[dict[str, Any]] = []
    rig_from_body: Pose | None = None
    for name, each in cameras.items():
        row: dict[str, Any] = {"image_prefix": f"{name}/"}
        if rig_from_body is None:
            rig_from_body, row["ref_sensor"] = each.sequence.cam_from_body, True
        else:
            cam_from_rig = each.sequence.cam_from_body @ rig_from_body.inverse()
            row["cam_from_rig_rotation"] = cam_from_rig.quaternion_wxyz.tolist()
            row["cam_from_rig_translation"] = cam_from_rig.translation.tolist()
        rows.append(row)
    return json.dumps([{"cameras": rows}], indent=1) + "\n"


def _images(posed: list[Posed], cloud: PointCloud) -> str:
    number = np.zeros(len(cloud.known), dtype=np.int64)
    number[cloud.rows] = np.arange(1, len(cloud.rows) + 1)
    lines = ["# IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME", "# POINTS2D[] as X Y POINT3D_ID"]
    for row, (image, seen) in enumerate(zip(posed, cloud.by_frame, strict=True), start=1):
        pose = image.shown.sequence.true_cam_from_world(image.frame)
        numbers = " ".join(map(repr, [*pose.quaternion_wxyz.tolist(), *pose.translation.tolist()]))
        lines.append(f"{row} {numbers} {image.camera} {image.name}")
        places = zip((seen.pixels + CENTRE_PX).tolist(), number[seen.rows].tolist(), strict=True)
        lines.append(" ".join(f"{x:.6f} {y:.6f} {point}" for (x, y), point in places))
    return "\n".join(lines) + "\n"


def _points(cloud: PointCloud) -> str:
    tracks: dict[int, list[str]] = {row: [] for row in cloud.rows.tolist()}
    for frame, seen in enumerate(cloud.by_frame):
        for place, row in enumerate(seen.rows.tolist()):
            tracks[row].append(f"{frame + 1} {place}")
    lines = ["# POINT3D_ID X Y Z R G B ERROR TRACK[] as IMAGE_ID POINT2D_IDX"]
    for number, (row, track) in enumerate(tracks.items(), start=1):
        xyz = " ".join(map(repr, cloud.surface.points_m[row].tolist()))
        colour = " ".join(map(str, cloud.colours[row].tolist()))
        lines.append(f"{number} {xyz} {colour} 0.0 {' '.join(track)}")
    return "\n".join(lines) + "\n"
