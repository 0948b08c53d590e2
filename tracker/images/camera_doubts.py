"""Plausibility of a camera: of its principal point, whose conventions differ, and against what a bag tells of it."""

from typing import Any

import numpy as np

from uavbench.scenes.calibrations.other_tools import own_name
from uavbench.scenes.camera import DISTORTION_COEFFICIENTS, Camera
from uavbench.trajectories.bags.reading import BagTopic, opened_bag, stamp_ns
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.pose import Array

SCALES = (1 / 4, 1 / 3, 1 / 2, 2 / 3, 3 / 2, 2.0, 3.0, 4.0)
"""Ratios of sizes by which images are often resized."""
NEAR = 0.04
"""Distance of a principal point from the middle of such an image in parts of its size, as lenses have it."""

INFO = "sensor_msgs/msg/CameraInfo"
RECTIFIED = "image_rect"
"""Beginning of the names of topics of rectified images (image_proc): image_rect, image_rect_color."""
SAME, OTHER = 1e-4, 1e-3
"""Shares of numbers up to which they are the same, copied with few digits, and from which on they are others."""


def doubts_of_camera(camera: Camera) -> list[str]:
    """Messages on a principal point half a pixel, or a usual factor of resized images, beside the image's middle."""
    middle = np.array([camera.width, camera.height]) / 2
    if (camera.cx, camera.cy) == tuple(middle):
        return [
            f"cx = {camera.cx:g} and cy = {camera.cy:g} are half of the image's size, as in COLMAP, where the first "
            f"pixel's centre is (0.5, 0.5); here it is (0, 0): subtract 0.5 from both, or calibrate the camera"
        ]
    beside = (np.array([camera.cx, camera.cy]) + 0.5) / (2 * middle)
    for scale in SCALES:
        if (np.abs(beside - scale / 2) < NEAR * scale).all():
            width, height = round(scale * camera.width), round(scale * camera.height)
            return [
                f"cx = {camera.cx:g} and cy = {camera.cy:g} are in the middle of an image of {width} x {height} px, "
                f"not of {camera.width} x {camera.height}: are fx, fy, cx and cy those of images before they were "
                "resized? Then scale them; of images that were cropped they are right"
            ]
    return []


def doubts_of_info(source: BagTopic, camera: Camera) -> list[str]:
    """Messages on a camera that is not the one of a topic's images by their name and the `camera_info` beside them.

    Images as the camera gives them have its K and D, rectified ones its P and no distortion. One camera has all of
    them: its lens does not zoom.
    """
    return [*_doubts_of_numbers(source, camera), *_doubts_of_zoom(source)]


def _doubts_of_zoom(source: BagTopic) -> list[str]:
    """Message on a `camera_info` whose intrinsics change in the course of a bag, as where its lens zooms."""
    place, _, name = source.topic.removesuffix("/compressed").rpartition("/")
    topic, key = f"{place}/camera_info", "p" if name.startswith(RECTIFIED) else "k"
    first = None
    try:
        with opened_bag(source.bag) as bag:
            for info in bag.messages(topic, (INFO,)):
                now = _intrinsics(info, key)
                first = now if first is None else first
                if not np.allclose(now, first, rtol=OTHER):
                    return [
                        f"{source.bag}:{topic}: from {stamp_ns(info.header) / 1e9:.3f} s on, fx = {now[0]:.9g} and "
                        f"cx = {now[2]:.9g}, and before fx = {first[0]:.9g} and cx = {first[2]:.9g}: does the lens "
                        "zoom, or do two cameras send it? All images are taken with one camera; track each part by "
                        "itself"
                    ]
    except UserError:
        return []
    return []


def _doubts_of_numbers(source: BagTopic, camera: Camera) -> list[str]:
    """Message on a camera with the distortion or the intrinsics of other images than those of a topic."""
    place, _, name = source.topic.removesuffix("/compressed").rpartition("/")
    rectified, bent = name.startswith(RECTIFIED), any(camera.distortion)
    if rectified and bent:
        return [
            f"{source}: its images are rectified by their name, and the camera has a distortion: theirs is the P of "
            'camera_info, and distortion_model = "none"'
        ]
    topic = f"{place}/camera_info"
    info = _first_info(source, topic)
    if info is None or not info.k[0]:  # of a camera that was not calibrated
        return []
    d = [float(k) for k in info.d]
    told = f"{source.bag}:{topic}"
    if not rectified and any(d) and not bent:
        return [
            f"{told}: tells a distortion of the images of {name}, {info.distortion_model} {d}, and the camera none; "
            f"only images of {RECTIFIED} are without"
        ]
    own, others = (_intrinsics(info, key) for key in ("pk" if rectified else "kp"))
    given = np.array([camera.fx, camera.fy, camera.cx, camera.cy])
    if np.allclose(given, others, rtol=SAME) and not np.allclose(given, own, rtol=OTHER):
        of, wrong = ("P", "K") if rectified else ("K", "P")
        return [
            f"{told}: fx, fy, cx and cy of the camera are those of its {wrong}; the images of {name} have its {of}, "
            f"fx = {own[0]:.9g}, fy = {own[1]:.9g}, cx = {own[2]:.9g}, cy = {own[3]:.9g}"
        ]
    return [] if rectified or not bent else _doubts_of_model(told, str(info.distortion_model), d, camera)


def _doubts_of_model(told: str, model: str, d: list[float], camera: Camera) -> list[str]:
    """Message on a distortion whose numbers are the first ones of another model."""
    count = len(camera.distortion)
    if len(d) < count or not np.allclose(camera.distortion, d[:count], atol=SAME):
        return []
    known = own_name(model)
    if (known or "radtan") == camera.distortion_model and not any(d[count:]):
        return []
    whole = len(d) in DISTORTION_COEFFICIENTS.get(known, ())
    return [
        f"{told}: its distortion is {model} {d}, of which the camera has {count} numbers as {camera.distortion_model}; "
        + (f'write distortion_model = "{known}" with all of them' if whole else "calibrate with plumb_bob instead")
    ]


def _first_info(source: BagTopic, topic: str) -> Any:
    """First message of a topic of camera_info, None where the bag has none that can be read."""
    try:
        with opened_bag(source.bag) as bag:
            return next(bag.messages(topic, (INFO,)), None)
    except UserError:
        return None


def _intrinsics(info: Any, key: str) -> Array:
    """fx, fy, cx, cy (4,) by K or P of a camera_info, for images of its region of interest, with pixels binned."""
    matrix = np.reshape(getattr(info, key), (3, -1))[:, :3]
    binned = np.maximum([info.binning_x, info.binning_y], 1)
    middle = (matrix[:2, 2] - [info.roi.x_offset, info.roi.y_offset] + 0.5) / binned - 0.5
    return np.concatenate([np.diag(matrix)[:2] / binned, middle])
