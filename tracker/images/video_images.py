"""Images of a video with the times that the file gives them."""

from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

from uavbench.scenes.camera import Camera
from uavbench.scenes.image_files import open_video
from uavbench.tracker.images.bag_images import StampedImage
from uavbench.trajectories.errors import UserError


def video_frames(source: Path, camera: Camera, rate_hz: float) -> Iterator[StampedImage]:
    """Stamps in ns, from the first image on, and BGR images of a video, also of one with a variable frame rate.

    rate_hz: of images that the file gives no later time than the one before. UserError naming a video without images or
    with images of another size.
    """
    video = open_video(source)
    frame, stamp_ns, first_ms = 0, 0, 0.0
    while True:
        good, image = video.read()
        if not good:
            break
        if image.shape[:2] != (camera.height, camera.width):
            raise UserError(
                f"{source}: frame {frame} is {image.shape[1]} x {image.shape[0]} px, "
                f"the camera {camera.width} x {camera.height} px"
            )
        at_ms = float(video.get(cv2.CAP_PROP_POS_MSEC))
        if frame:
            told_ns = round((at_ms - first_ms) * 1e6)
            stamp_ns = told_ns if told_ns > stamp_ns else stamp_ns + round(1e9 / rate_hz)
        else:
            first_ms = at_ms
        yield StampedImage(stamp_ns, np.asarray(image, dtype=np.uint8))
        frame += 1
    if not frame:
        raise UserError(f"{source}: not a readable video")


def unread(source: Path, frames: int) -> str:
    """Message when a video says that it has more images than were read, "" otherwise."""
    told = int(open_video(source).get(cv2.CAP_PROP_FRAME_COUNT))
    if frames >= told:
        return ""
    return f"{source}: {frames} of {told} frames can be read; it is damaged, or was cut without encoding it again"
