"""Sequences as COLMAP models in text form (Schoenberger & Frahm 2016): cameras, posed images, points with tracks."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from uavbench.scenes.camera import Camera
from uavbench.scenes.exports.notes import Held
from uavbench.scenes.exports.shown_images import Shown, write_masks
from uavbench.scenes.exports.surface_points import OnSurface, PointCloud
from uavbench.trajectories.files.writing import write_text

CENTRE_PX = 0.5
"""Of the first pixel, in COLMAP and in nerfstudio; here pixel centres lie at whole numbers."""
AXES = "camera x right, y down, z forward; the first pixel's centre at (0.5, 0.5)"


def export_colmap(shown: Shown, folder: Path, on_frame: Callable[[int, int], None]) -> Held:
    """`images/`, `masks/` and `sparse/0` with cameras.txt, images.txt and points3D.txt; the world is the structure's.

    Points are drawn on the model's surface; every frame that shows one observes it exactly.
    """
    sequence, model = shown.sequence, folder / "sparse" / "0"
    (folder / "images").mkdir()
    model.mkdir(parents=True)
    cloud = PointCloud(OnSurface.drawn(sequence.structure))
    for frame in range(len(sequence)):
        (folder / "images" / _image(frame)).write_bytes(shown.png(frame))
        cloud.look(shown, frame)
        on_frame(frame + 1, len(sequence))
    # COLMAP looks for the mask of images/000000.png as masks/000000.png.png.
    masked = write_masks(shown, folder / "masks", lambda frame: f"{_image(frame)}.png")
    write_text(model / "cameras.txt", f"# CAMERA_ID MODEL WIDTH HEIGHT PARAMS[]\n1 {camera_line(shown.camera)}\n")
    write_text(model / "images.txt", _images(shown, cloud))
    write_text(model / "points3D.txt", _points(cloud))
    files = {
        "images/": "images by number",
        "sparse/0/cameras.txt": "the camera, number 1: model, width, height and its parameters, px",
        "sparse/0/images.txt": "camera from world at each image, w first, and the points that it shows: x y point, px",
        "sparse/0/points3D.txt": "points on the model's surface: place, colour, error 0, and (image, place in its row)",
    }
    if masked:
        files["masks/"] = "255 where the structure is seen, 0 elsewhere, where COLMAP looks for no features"
    return Held(
        files=files,
        frames={},
        annotations=("mask",) if masked else (),
        limits=("Stamps: images have numbers and no times.", *cloud.limits(shown)),
        camera_axes=AXES,
    )


def camera_line(camera: Camera) -> str:
    """Model, size and parameters of a camera as in cameras.txt; every lens of ours has a model there."""
    parameters = [camera.fx, camera.fy, camera.cx + CENTRE_PX, camera.cy + CENTRE_PX, *camera.distortion]
    name = {"none": "PINHOLE", "radtan": "OPENCV", "equidistant": "OPENCV_FISHEYE"}[camera.distortion_model]
    if camera.distortion_model == "radtan" and len(camera.distortion) == 5:
        name, parameters = "FULL_OPENCV", [*parameters, 0.0, 0.0, 0.0]  # k1 k2 p1 p2 k3, and the denominator's k4 k5 k6
    return f"{name} {camera.width} {camera.height} " + " ".join(map(repr, parameters))


def _image(frame: int) -> str:
    return f"{frame:06d}.png"


def _images(shown: Shown, cloud: PointCloud) -> str:
    number = np.zeros(len(cloud.known), dtype=np.int64)
    number[cloud.rows] = np.arange(1, len(cloud.rows) + 1)
    lines = ["# IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME", "# POINTS2D[] as X Y POINT3D_ID"]
    for frame, seen in enumerate(cloud.by_frame):
        pose = shown.sequence.true_cam_from_world(frame)
        numbers = " ".join(map(repr, [*pose.quaternion_wxyz.tolist(), *pose.translation.tolist()]))
        lines.append(f"{frame + 1} {numbers} 1 {_image(frame)}")
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
