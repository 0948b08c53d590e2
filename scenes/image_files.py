"""Guarded reading of untrusted images and videos: type and size are checked before they are decoded.

And the begin and the end of a video of ours, whether all of it was written; and the writing of a file of a frame.
"""

import errno
import io
import warnings
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from uavbench.scenes.camera import Camera
from uavbench.scenes.decoding.sample_bits import WHITE_8, refuse_samples, to_8_bits, white_of
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files import reading
from uavbench.trajectories.files.limits import IMAGE, MOST_PIXELS, VIDEO

KINDS = ("PNG", "JPEG", "BMP", "TIFF", "PPM", "WEBP")
"""Accepted image formats by Pillow's names; PPM includes PGM and PBM."""
TEXTURES = (*KINDS, "TGA")
SUFFIXES = (".png", ".jpg", ".jpeg", ".pgm", ".ppm", ".bmp", ".tif", ".tiff", ".webp")
"""Ends of the names of a folder's images."""
ORIENTATION = 0x0112
"""Tag of Exif."""
BITS_PER_SAMPLE = 258
"""Tag of TIFF."""
LIKE = 1.01
"""Ratio of width to height up to which an image may be a resized one of the camera's: sides are whole numbers."""
PNG, EXIF_OF_PNG = b"\x89PNG\r\n\x1a\n", b"eXIf"
"""First bytes of PNG files, and the name of their chunk of Exif data."""
XMP = ("xmp", "XML:com.adobe.xmp")
"""Texts beside Exif data that tell an orientation to Pillow, but not to OpenCV, which decodes the images."""
TURNS = range(1, 9)
"""Orientations of Exif data: 1 not turned, 3 upside down."""
JPEG = b"\xff\xd8\xff"
"""First bytes of JPEG files."""
TIFF = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
"""First bytes of TIFF files of both byte orders, and of those beyond 4 GB."""
VIDEOS = {
    "MP4 or MOV": (4, b"ftyp"),
    "MOV": (4, b"moov"),
    "MOV with its images first": (4, b"mdat"),
    "MOV with room first": (4, b"wide"),
    "Matroska or WebM": (0, b"\x1a\x45\xdf\xa3"),
    "AVI": (8, b"AVI "),
    "MPEG program": (0, b"\x00\x00\x01\xba"),
    "MPEG": (0, b"\x00\x00\x01\xb3"),
    "Ogg": (0, b"OggS"),
}
"""Magic bytes of video files, with their offset. Playlists are not accepted: they may name any other file."""
LEAST_VIDEO = 4096
"""Bytes that are tried where a video cannot be begun: a block of most file systems."""
UNCOUNTED = ("Matroska or WebM", "MPEG program", "MPEG", "Ogg")
"""Videos that do not tell their number of images; OpenCV multiplies their duration, if they tell one, by a rate."""


def is_shown(path: Path, folder: Path) -> bool:
    """Whether neither a file nor a folder above it, up to `folder`, is hidden, as `._0.png` of macOS and thumbnails."""
    return not any(part.startswith(".") for part in path.relative_to(folder).parts)


def load_image(
    path: Path, flags: int = cv2.IMREAD_COLOR, *, inside: Path | None = None, bits: int = 0
) -> NDArray[np.uint8]:
    """Image of a file as `decoded`; UserError naming the file when it is missing, invalid or too large."""
    return decoded(path, reading.read_bytes(path, IMAGE, inside=inside), flags, bits)


def decoded(path: Path, data: bytes, flags: int = cv2.IMREAD_COLOR, bits: int = 0) -> NDArray[np.uint8]:
    """Image of a file's content; UserError naming the file when it is no image, damaged or too large.

    Colour and grey images have 8 bits; bits: see `to_8_bits`. IMREAD_UNCHANGED gives the samples as they are.
    """
    size_px(path, data)
    refuse_damage(path, data)
    data = data if flags == cv2.IMREAD_UNCHANGED else _without_alpha(data)
    deep = flags in (cv2.IMREAD_COLOR, cv2.IMREAD_GRAYSCALE) and white_of(data) != WHITE_8
    try:
        image = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), flags | (cv2.IMREAD_ANYDEPTH if deep else 0))
    except cv2.error as error:
        raise UserError(f"{path}: not a readable image: {error.err}; render or copy it again") from None
    if image is None:
        raise UserError(f"{path}: not a readable image; render or copy it again")
    if deep:
        return to_8_bits(path, image, data, bits)
    return image  # type: ignore[return-value]  # depth has 16 bits


def size_px(path: Path, data: bytes, kinds: tuple[str, ...] = KINDS) -> tuple[int, int]:
    """Width and height by an image's header; UserError when it has none, several images, or more than MOST_PIXELS."""
    refuse_samples(path, data)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            with Image.open(io.BytesIO(data), formats=kinds) as image:
                width, height = image.size
                is_sequence = _goes_on(image)
    except Image.DecompressionBombError:  # Pillow's own limit is slightly above ours
        raise UserError(f"{path}: {_too_many('too many')}") from None
    except Exception:  # Pillow's decoders may raise anything for a damaged header
        raise UserError(f"{path}: not a readable image ({', '.join(kinds)}); render or copy it again") from None
    check_pixels(path, width, height)
    if is_sequence:
        raise UserError(
            f"{path}: holds several images, of which only the first would be read; write each into its file"
        )
    return width, height


def _goes_on(image: Image.Image) -> bool:
    """Whether a second image of the same size follows in the file; a smaller one is a preview."""
    size = image.size
    try:
        image.seek(1)
    except Exception:  # Pillow's decoders may raise anything for what follows the first image
        return False
    return image.size == size


def is_plain(data: bytes) -> bool:
    """Whether all programs show the image of a file alike: its samples have 8 bits, and no Exif data turn it."""
    return white_of(data) == WHITE_8 and exif_turn(data) == 1


def exif_turn(data: bytes) -> int:
    """How the Exif data of an image turn it, 1 to 8: 1 not at all, 3 upside down, 6 and 8 to a side."""
    if data.startswith(PNG) and EXIF_OF_PNG not in data:  # which Pillow seeks behind all of its pixels
        return 1
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            with Image.open(io.BytesIO(data), formats=KINDS) as image:
                for text in XMP:
                    image.info.pop(text, None)
                turn = int(image.getexif().get(ORIENTATION, 1))
                return turn if turn in TURNS else 1
        except Exception:  # what is wrong with it is told where it is decoded
            return 1


@dataclass
class OneTurn:
    """The images of one camera, all of which their Exif data turn alike, as the first one."""

    first: Path | None = None
    turn: int = 1

    def check(self, path: Path, data: bytes) -> None:
        """UserError for an image that is turned otherwise: its principal point is not where it was."""
        turn = exif_turn(data)
        if self.first is None:
            self.first, self.turn = path, turn
        if turn != self.turn:
            raise UserError(
                f"{path}: its Exif data turn it otherwise (orientation {turn}) than {self.first} ({self.turn}), so "
                "that both have other intrinsics; leave out those that were taken with the camera turned, or take this "
                "turning out of all (`exiftool -Orientation=1 -n DIR`), here and wherever this calibration is used"
            )


def refuse_damage(path: Path, data: bytes) -> None:
    """UserError for a damaged TIFF or JPEG, of which decoders would return the readable part."""
    if data.startswith(JPEG):
        from uavbench.scenes.decoding.jpeg_damage import jpeg_damage  # lazy: numba, which other images do not need

        if why := jpeg_damage(data):
            raise UserError(f"{path}: the image is damaged: {why}; render or copy it again")
    if not data.startswith(TIFF):
        return
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            with Image.open(io.BytesIO(data), formats=("TIFF",)) as image:
                image.load()
    except Exception as error:  # Pillow's decoders may raise anything for damaged content
        raise UserError(f"{path}: the image is damaged: {error}; render or copy it again") from None


def _without_alpha(data: bytes) -> bytes:
    """Content of a TIFF of 8 bits as a PNG without its alpha, by which OpenCV multiplies colours; else as it is."""
    if not data.startswith(TIFF):
        return data
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with Image.open(io.BytesIO(data), formats=("TIFF",)) as image:
            if image.mode != "RGBA" or any(bits != 8 for bits in getattr(image, "tag_v2", {}).get(BITS_PER_SAMPLE, ())):
                return data  # Pillow takes 16 bits of colours with alpha for 8
            plain = io.BytesIO()
            image.convert("RGB").save(plain, "PNG")
            return plain.getvalue()


def check_pixels(path: Path, width: int, height: int) -> None:
    """UserError when an image is larger than MOST_PIXELS."""
    if width * height > MOST_PIXELS:
        raise UserError(f"{path}: {_too_many(f'{width} x {height}')}")


def open_video(path: Path) -> cv2.VideoCapture:
    """Video of a file; UserError naming the file when it is not a video, or its images are too large."""
    if not _kind_of_video(path):
        raise UserError(f"{path}: neither an image nor a readable video (MP4, MOV, Matroska, WebM, AVI, MPEG, Ogg)")
    video = cv2.VideoCapture(_for_opencv(path), cv2.CAP_FFMPEG)
    if not video.isOpened():
        raise UserError(f"{path}: not a readable video")
    check_pixels(path, int(video.get(cv2.CAP_PROP_FRAME_WIDTH)), int(video.get(cv2.CAP_PROP_FRAME_HEIGHT)))
    return video


def _for_opencv(path: Path, told: str = "") -> str:
    """Absolute path, which is never taken for a URL; UserError for one not in UTF-8, on which OpenCV crashes."""
    name = str(path.resolve())
    try:
        name.encode()
    except UnicodeEncodeError:
        raise UserError(
            f"{told or path}: its name, or that of a folder above, is not in UTF-8, without which OpenCV reads and "
            "writes no videos; rename it"
        ) from None
    return name


def _kind_of_video(path: Path) -> str:
    """Key of VIDEOS, "" for any other file."""
    with reading.opened(path, VIDEO) as handle:
        head = handle.read(16)
    return next((name for name, (at, word) in VIDEOS.items() if head[at : at + len(word)] == word), "")


def is_counted(path: Path) -> bool:
    """Whether a video tells the number of its images."""
    return _kind_of_video(path) not in UNCOUNTED


def frame_count(path: Path) -> int:
    """Number of images of a video, of which those are decoded that do not tell it; UserError as `open_video`."""
    video = open_video(path)
    told = int(video.get(cv2.CAP_PROP_FRAME_COUNT))
    return told if told > 0 and is_counted(path) else sum(1 for _ in iter(video.grab, False))


def begin_video(path: Path, codec: str, rate_hz: float, size_px: tuple[int, int]) -> cv2.VideoWriter:
    """Writer of a video with a codec, four letters, of images of a width and height.

    UserError when this build of OpenCV cannot: it would write nothing, and tell nothing; and as `_for_opencv`. OSError
    when nothing can be written there, which OpenCV tells alike.
    """
    writer = cv2.VideoWriter(_for_opencv(path, path.name), cv2.VideoWriter.fourcc(*codec), rate_hz, size_px)
    if not writer.isOpened():
        path.write_bytes(bytes(LEAST_VIDEO))
        raise UserError(f"{path.name}: this build of OpenCV cannot write {codec}; install opencv-python-headless")
    return writer


def finish_video(writer: cv2.VideoWriter, path: Path, frames: int) -> None:
    """Close a video of so many frames; OSError when fewer can be read again, since OpenCV tells of no full disk."""
    writer.release()
    if not frames:
        return
    video = cv2.VideoCapture(_for_opencv(path), cv2.CAP_FFMPEG)
    read = sum(1 for _ in iter(video.grab, False))
    if read < frames or video.get(cv2.CAP_PROP_FRAME_COUNT) <= 0:  # the number comes from what is written last
        raise OSError(errno.ENOSPC, f"only {read} of {frames} frames of the video could be written", str(path))


def _too_many(size: str) -> str:
    return f"the image has {size} pixels; at most {MOST_PIXELS:,} are read; {IMAGE.remedy}"


def read_image(path: Path, camera: Camera, inside: Path | None = None) -> NDArray[np.uint8]:
    """BGR image (h, w, 3); UserError naming the file when it cannot be read or is not of the camera's size."""
    return image_of(path, reading.read_bytes(path, IMAGE, inside=inside), camera)


def image_of(path: Path, data: bytes, camera: Camera) -> NDArray[np.uint8]:
    """BGR image (h, w, 3) of a file's content; UserError as `read_image`."""
    if path.suffix == ".png" and not data.endswith(b"IEND\xaeB`\x82"):
        raise UserError(f"{path}: the image is truncated; render or copy it again")
    width, height = size_px(path, data)
    if sorted((width, height)) == sorted((camera.width, camera.height)):  # its EXIF orientation may rotate it
        image = decoded(path, data, bits=camera.bits)
        height, width = image.shape[:2]
    check_size(path, width, height, camera)
    return image


def check_size(name: Path, width: int, height: int, camera: Camera) -> None:
    """UserError for an image of another size than the camera's, with the intrinsics that it has if it was resized."""
    if (width, height) == (camera.width, camera.height):
        return
    told = f"{name}: image is {width} x {height} px, the camera {camera.width} x {camera.height} px"
    across, down = width / camera.width, height / camera.height
    if max(across, down) > LIKE * min(across, down):
        raise UserError(f"{told}; take the camera.toml of these images, or calibrate with images of their size")
    fx, fy, cx, cy = (
        camera.fx * across, camera.fy * down, across * (camera.cx + 0.5) - 0.5, down * (camera.cy + 0.5) - 0.5
    )  # fmt: skip
    raise UserError(
        f"{told}; if they were resized, and not cropped, their camera.toml has width = {width}, height = {height}, "
        f"fx = {fx:.9g}, fy = {fy:.9g}, cx = {cx:.9g}, cy = {cy:.9g}, and the same distortion"
    )


def put_file(path: Path, data: bytes) -> None:
    """Write a file of a frame into a folder that is made for the first one."""
    try:
        path.write_bytes(data)
    except FileNotFoundError:
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(data)
