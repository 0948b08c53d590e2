"""Bits of the samples of image files: cameras store 10, 12 or 14 bits in samples of 16, which looks nearly black."""

import io
import re
import warnings
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from PIL.TiffImagePlugin import ImageFileDirectory_v2

from uavbench.trajectories.errors import UserError

PNG = b"\x89PNG\r\n\x1a\n"
PNM = re.compile(rb"P[2356]\s+(?:#[^\n]*\n\s*)*\d+\s+(?:#[^\n]*\n\s*)*\d+\s+(?:#[^\n]*\n\s*)*(\d+)\s")
"""Header of a PGM or PPM file up to its largest value (Netpbm)."""
BITS_PER_SAMPLE, MAX_SAMPLE_VALUE, SAMPLE_FORMAT = 258, 281, 339
"""Tags of TIFF 6.0."""
WHITE_8, WHITE_16 = 255, 65_535
"""Largest values of samples of 8 and 16 bits."""
USUAL_BITS = (8, 10, 12, 14)
"""Bits of cameras whose values of 16 bits stay below a quarter of the largest one."""
DARK = 4096
"""Values of 16 bits that stay below this are of a camera with 12 bits, or of an image of a 16th of full brightness."""
UNSIGNED = 1
NUMBERS = {UNSIGNED: "whole numbers", 4: "numbers of no kind"}
"""Values of SAMPLE_FORMAT that are read (TIFF 6.0)."""
FEWEST_BITS, MOST_BITS = 8, 16


def white_of(data: bytes) -> int:
    """Largest value that a file's header allows, 255 for what has 8 bits; 0 where 16 bits may hold fewer.

    PNG: by sBIT, where it tells of fewer bits than a sample has. TIFF: MaxSampleValue. PGM and PPM: the header's value.
    """
    if data.startswith(PNG):
        return _white_of_png(data)
    if found := PNM.match(data[:4096]):
        white = int(found[1])
        return 0 if white == WHITE_16 else white
    if data[:2] in (b"II", b"MM"):
        return _white_of_tiff(data)
    return WHITE_8


def _white_of_png(data: bytes) -> int:
    if data[24] <= 8:  # bit depth in IHDR, the first chunk
        return WHITE_8
    at = data.find(b"sBIT", 0, data.find(b"IDAT"))
    length = int.from_bytes(data[at - 4 : at], "big") if at >= 0 else 0
    color = length - 1 if data[25] in (4, 6) else length  # the last one is that of alpha
    bits = max(data[at + 4 : at + 4 + color], default=0)
    return (1 << bits) - 1 if 0 < bits < MOST_BITS else 0


def _white_of_tiff(data: bytes) -> int:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            with Image.open(io.BytesIO(data), formats=("TIFF",)) as image:
                tags = getattr(image, "tag_v2", {})
                bits, told = tags.get(BITS_PER_SAMPLE, (1,)), tags.get(MAX_SAMPLE_VALUE, 0)
        except Exception:  # what is wrong with it is told where it is decoded
            return WHITE_8
    depth = max(bits) if isinstance(bits, tuple) else int(bits)
    white = max(told) if isinstance(told, tuple) else int(told)
    if depth <= 8:
        return WHITE_8
    return white if depth == MOST_BITS and 0 < white < WHITE_16 else 0 if depth == MOST_BITS else WHITE_16


class DarkImageError(UserError):
    """An image of 16 bits is nearly black, or has values beyond those of its camera: its bits are not known."""


def to_8_bits(path: Path, samples: NDArray[np.generic], data: bytes, bits: int = 0) -> NDArray[np.uint8]:
    """Samples of 8 or 16 bits as grey levels of 8 bits.

    bits: of the camera, 0 where only the file tells them (`white_of`). DarkImageError naming a file of 16 bits that is
    nearly black without them, or that has values beyond them.
    """
    white, most = white_of(data), int(samples.max(initial=0))
    if samples.dtype == np.uint8:
        if white >= WHITE_8:
            return samples.astype(np.uint8)
    elif data.startswith(PNG) and white:
        white = _white_of_scaled(white, samples, most)
    if bits and white != WHITE_16 and samples.dtype != np.uint8:
        white = (1 << bits) - 1
    if not white and 0 < most < 1 << USUAL_BITS[-1] and (most < DARK or not _is_scaled(samples)):
        likely = next(b for b in USUAL_BITS if most < 1 << b)
        seen = "nearly black" if most < DARK else "dark"
        raise DarkImageError(
            f"{path}: its values of 16 bits reach only {most} of {WHITE_16:,}, which is {seen}; if the camera "
            f"has {likely} bits, set bits = {likely} in camera.toml (calibrate: --bits {likely}); if the scene was so "
            "dark, bits = 16"
        )
    if white in (0, WHITE_16):
        return np.asarray(samples.astype(np.uint16) >> 8, dtype=np.uint8)
    if most > white:
        raise DarkImageError(
            f"{path}: has the value {most}, beyond its largest one, {white}; correct its header, or bits"
        )
    return np.asarray(np.rint(samples.astype(np.float32) * (WHITE_8 / white)), dtype=np.uint8)


def _white_of_scaled(white: int, samples: NDArray[np.generic], most: int) -> int:
    """65535 where a PNG's samples were scaled to 16 bits, as its specification wants (sBIT); 0 where that is not clear.

    Samples that were not scaled stay below the largest value, and are not all multiples of the step of scaled ones.
    """
    step = (WHITE_16 + 1) // (white + 1)
    if most > white:
        return WHITE_16
    return white if (samples.astype(np.uint16) % step).any() else 0


def _is_scaled(samples: NDArray[np.generic]) -> bool:
    """Whether samples of 16 bits are those of fewer bits, scaled to 16 by zeros or by the ratio of the largest values.

    Those of a camera are not, if its file holds them as they are.
    """
    values = samples.astype(np.int64)
    for bits in USUAL_BITS:
        ratio = WHITE_16 / ((1 << bits) - 1)
        if (
            not (values % (1 << MOST_BITS - bits)).any()
            or (np.abs(values - np.rint(values / ratio) * ratio) <= 1).all()
        ):
            return True
    return False


def refuse_samples(path: Path, data: bytes) -> None:
    """UserError for a TIFF file whose samples are not whole numbers of up to 16 bits, from 0 on."""
    if data[:2] not in (b"II", b"MM"):
        return
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            tags = ImageFileDirectory_v2(data[:8])
            file = io.BytesIO(data)
            file.seek(tags.next)
            tags.load(file)
            depth, kind = (np.max(tags.get(tag, UNSIGNED)) for tag in (BITS_PER_SAMPLE, SAMPLE_FORMAT))
        except Exception:  # what is wrong with it is told where it is decoded
            return
    if depth > MOST_BITS or kind not in NUMBERS:
        what = NUMBERS.get(int(kind), "signed or floating-point numbers")
        raise UserError(
            f"{path}: its samples are {what} of {depth} bits, of which it is not known which is white; save it with 8 "
            "or 16 bits, whole numbers from 0 on"
        )
