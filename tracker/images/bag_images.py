"""Images of a topic of a ROS 2 bag, raw or compressed, with the stamps of their headers."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np

from uavbench.scenes.camera import Camera
from uavbench.scenes.decoding.sample_bits import DarkImageError
from uavbench.scenes.image_files import check_pixels, check_size, decoded
from uavbench.tracker.protocol import Image
from uavbench.trajectories.bags.reading import BagTopic, opened_bag, stamp_ns
from uavbench.trajectories.errors import UserError

RAW, COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
ENCODINGS: dict[str, tuple[int, int | None]] = {
    "bgr8": (3, None),
    "8UC3": (3, None),
    "rgb8": (3, cv2.COLOR_RGB2BGR),
    "bgra8": (4, cv2.COLOR_BGRA2BGR),
    "rgba8": (4, cv2.COLOR_RGBA2BGR),
    "mono8": (1, cv2.COLOR_GRAY2BGR),
    "8UC1": (1, cv2.COLOR_GRAY2BGR),
    "bayer_rggb8": (1, cv2.COLOR_BayerRGGB2BGR),
    "bayer_bggr8": (1, cv2.COLOR_BayerBGGR2BGR),
    "bayer_gbrg8": (1, cv2.COLOR_BayerGBRG2BGR),
    "bayer_grbg8": (1, cv2.COLOR_BayerGRBG2BGR),
}
"""Bytes per pixel of each supported encoding of sensor_msgs/image_encodings.hpp, and its conversion to BGR."""
BAYER = "bayer_"
"""Beginning of the encodings of mosaics, which image_transport compresses in grey: `bayer_rggb8; png compressed `."""


class StampedImage(NamedTuple):
    """A BGR image (h, w, 3), and its stamp in ns."""

    stamp_ns: int
    image: Image


def bag_frames(source: BagTopic, camera: Camera) -> Iterator[StampedImage]:
    """Stamps in ns and BGR images of a topic; UserError naming a message that is invalid or of another size."""
    before = None
    with opened_bag(source.bag) as bag:
        kind = bag.topics[source.topic].type if source.topic in bag.topics else ""
        for number, message in enumerate(bag.messages(source.topic, (RAW, COMPRESSED))):
            name = Path(f"{source}, message {number}")
            image = _raw(name, message) if kind == RAW else _compressed(name, message, camera)
            height, width = image.shape[:2]
            check_size(name, width, height, camera)
            stamp = stamp_ns(message.header)
            if before is not None and stamp <= before:
                raise UserError(
                    f"{name}: its header's stamp, {stamp} ns, does not come after the one before, {before} ns; "
                    + _advice(stamp, before)
                )
            before = stamp
            yield StampedImage(stamp, image)


def _advice(stamp_ns: int, before_ns: int) -> str:
    """What to do about an image that is not later than the one before."""
    if stamp_ns == before_ns == 0:
        return "its driver sets none: give the images as a folder, with their rate"
    if stamp_ns == before_ns:
        return "write the bag again without one of the two images"
    return "write the bag again with its images in the order of these stamps"


def bag_rate_hz(source: BagTopic) -> float:
    """Mean rate in Hz of the images of a topic, by the stamps of their headers; 0 for a single image."""
    with opened_bag(source.bag) as bag:
        stamps = [stamp_ns(message.header) for message in bag.messages(source.topic, (RAW, COMPRESSED))]
    span_s = (stamps[-1] - stamps[0]) / 1e9
    return (len(stamps) - 1) / span_s if span_s > 0 else 0.0


def _raw(name: Path, message: Any) -> Image:
    """BGR image of an Image message, whose rows may be padded."""
    if message.encoding not in ENCODINGS:
        raise UserError(
            f"{name}: its encoding {message.encoding!r} is not read ({', '.join(ENCODINGS)} are); convert the topic, "
            "as with image_proc or cv_bridge"
        )
    channels, convert = ENCODINGS[message.encoding]
    height, width, step = message.height, message.width, message.step
    check_pixels(name, width, height)
    if not (width and height) or step < channels * width or message.data.size != step * height:
        raise UserError(
            f"{name}: {message.data.size} bytes are no {width} x {height} px of {message.encoding} in rows of {step} "
            "bytes"
        )
    rows = message.data.reshape(height, step)[:, : channels * width]
    pixels = np.ascontiguousarray(rows.reshape((height, width) if channels == 1 else (height, width, channels)))
    return np.asarray(pixels if convert is None else cv2.cvtColor(pixels, convert), dtype=np.uint8)


def _compressed(name: Path, message: Any, camera: Camera) -> Image:
    """BGR image of a CompressedImage message, also of a mosaic: PNG, JPEG, or another supported image format."""
    try:
        image = decoded(name, message.data.tobytes(), bits=camera.bits)
    except DarkImageError:
        raise
    except UserError:
        raise UserError(
            f"{name}: its data, of the format {message.format!r}, are not a supported image (PNG, JPEG); convert the "
            "topic, as with image_transport's republish"
        ) from None
    return _demosaiced(name, message.format, image)


def _demosaiced(name: Path, told: str, image: Image) -> Image:
    """BGR image of one that is as its file has it, a mosaic in grey where the format of its message says so."""
    mosaic = told.partition(";")[0].strip()
    if not mosaic.startswith(BAYER) or np.ptp(image, axis=2).any():
        return image
    _, convert = ENCODINGS.get(mosaic.removesuffix("16").removesuffix("8") + "8", (0, None))  # 8 bits by now
    if convert is None:
        raise UserError(f"{name}: its format {told!r} is not read; convert the topic, as with image_proc")
    return np.asarray(cv2.cvtColor(image[..., 0], convert), dtype=np.uint8)
