"""Sequences with nerfstudio's transforms.json (Tancik et al. 2023): cameras in OpenGL's axes, and a point cloud."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from uavbench.scenes.camera import Camera
from uavbench.scenes.exports.colmap import CENTRE_PX
from uavbench.scenes.exports.notes import Held
from uavbench.scenes.exports.shown_images import Shown, png, write_masks
from uavbench.scenes.exports.surface_points import OnSurface, PointCloud
from uavbench.trajectories.files.writing import write_text

OPENCV_FROM_OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])
"""Camera axes: OpenGL has y up and z backward."""
UNITS_PER_M = 1000.0
"""Units per metre of nerfstudio's 16-bit depth images, by default."""
LARGEST = 65535
"""Largest 16-bit value."""
POINTS = "sparse_pc.ply"
AXES = "camera x right, y up, z backward; the first pixel's centre at (0.5, 0.5)"
COEFFICIENTS = {"none": (), "radtan": ("k1", "k2", "p1", "p2", "k3"), "equidistant": ("k1", "k2", "k3", "k4")}
"""Keys of a lens's coefficients, in the order of `camera.toml`."""


def export_transforms(shown: Shown, folder: Path, on_frame: Callable[[int, int], None]) -> Held:
    """`transforms.json`, `images/`, `masks/`, `depths/` and the point cloud `sparse_pc.ply`; z is up in the world."""
    sequence = shown.sequence
    (folder / "images").mkdir()
    cloud = PointCloud(OnSurface.drawn(sequence.structure))
    frames: list[dict[str, Any]] = []
    for frame, stamp in enumerate(sequence.stamps_ns.tolist()):
        name = f"{frame:06d}.png"
        (folder / "images" / name).write_bytes(shown.png(frame))
        world_from_cam = sequence.true_cam_from_world(frame).inverse().matrix @ OPENCV_FROM_OPENGL
        frames.append(
            {"file_path": f"images/{name}", "transform_matrix": world_from_cam.tolist(), "stamp_ns": stamp}
        )  # fmt: skip
        cloud.look(shown, frame)
        on_frame(frame + 1, len(sequence))
    files = {
        "transforms.json": "the camera, and world from camera, time and files of each image",
        "images/": "images by number",
        POINTS: "points on the model's surface, with colours",
    }
    annotations = []
    if write_masks(shown, folder / "masks", lambda frame: f"{frame:06d}.png"):
        annotations.append("mask")
        files["masks/"] = "255 where the structure is visible, 0 elsewhere, which is ignored in training"
    if _write_depths(shown, folder / "depths"):
        annotations.append("depth")
        files["depths/"] = f"depth along the optical axis, {UNITS_PER_M:g} units per metre; 0: none, or beyond 65.5 m"
    for kind, key in (("mask", "mask_path"), ("depth", "depth_file_path")):
        if kind in annotations:
            for each in frames:
                each[key] = each["file_path"].replace("images/", f"{kind}s/")
    about = {**camera_keys(shown.camera), "ply_file_path": POINTS, "frames": frames}
    write_text(folder / "transforms.json", json.dumps(about, indent=1) + "\n")
    write_text(folder / POINTS, _ply(cloud))
    return Held(
        files=files, frames={}, annotations=tuple(annotations), limits=tuple(cloud.limits(shown)), camera_axes=AXES
    )


def camera_keys(camera: Camera) -> dict[str, Any]:
    """Keys of a camera as in transforms.json; every distortion model has a counterpart."""
    model = "OPENCV_FISHEYE" if camera.distortion_model == "equidistant" else "OPENCV"
    keys = {"camera_model": model, "w": camera.width, "h": camera.height, "fl_x": camera.fx, "fl_y": camera.fy}
    keys |= {"cx": camera.cx + CENTRE_PX, "cy": camera.cy + CENTRE_PX}
    lens = dict(zip(COEFFICIENTS[camera.distortion_model], camera.distortion, strict=False))  # k3 is optional
    return {**keys, **(lens or {"k1": 0.0, "k2": 0.0, "p1": 0.0, "p2": 0.0})}


def _write_depths(shown: Shown, folder: Path) -> bool:
    """Write the depth of every frame, if every frame has one; whether it was written."""
    if not all(shown.has("depth", frame) for frame in range(len(shown.sequence))):
        return False
    folder.mkdir()
    for frame in range(len(shown.sequence)):
        depth = shown.depth(frame)
        assert depth is not None
        units = np.rint(UNITS_PER_M * depth)
        units[units > LARGEST] = 0
        (folder / f"{frame:06d}.png").write_bytes(png(units.astype(np.uint16)))
    return True


def _ply(cloud: PointCloud) -> str:
    head = ["ply", "format ascii 1.0", f"element vertex {len(cloud.rows)}"]
    head += [f"property double {axis}" for axis in "xyz"]
    head += [f"property uchar {name}" for name in ("red", "green", "blue")]
    places, colours = cloud.surface.points_m[cloud.rows].tolist(), cloud.colours[cloud.rows].tolist()
    rows = [" ".join(map(repr, [*p, *c])) for p, c in zip(places, colours, strict=True)]
    return "\n".join([*head, "end_header", *rows]) + "\n"
