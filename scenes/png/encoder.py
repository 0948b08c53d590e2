"""PNG encoder with one filter for all rows; its bytes depend on no library version or processor."""

import struct
import zlib
from functools import lru_cache
from itertools import chain
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from uavbench.scenes.png.deflate import deflate, room_words
from uavbench.scenes.png.filters import AVERAGE, UP, filter_rows

ENCODING = "uavbench 2"
"""Version of the encoding; increment it with every change that alters the bytes for the same pixels."""
SIGNATURE = b"\x89PNG\r\n\x1a\n"
ZLIB_HEADER = b"\x78\x01"
"""Deflate with a window of 32 KiB, fastest compression level (RFC 1950)."""
GREY, RGB = 0, 2
"""Colour types (PNG specification, third edition, section 11.2.1)."""


def png(image: NDArray[Any], *, smooth: bool = False) -> bytes:
    """PNG file of an image (h, w) or (h, w, 3) BGR of 8 or 16 bits, the same bytes for the same pixels everywhere.

    Rows are filtered by AVERAGE, which suits noisy images, or by UP for smooth ones, whose residuals often repeat those
    of the pixel before.
    """
    samples = cv2.cvtColor(image, cv2.COLOR_BGR2RGB) if image.ndim == 3 else image
    rows = np.ascontiguousarray(samples, dtype=f">u{samples.dtype.itemsize}").view(np.uint8)
    return png_of_rows(rows.reshape(len(image), -1), image.shape[1], smooth=smooth)


def png_of_rows(rows: NDArray[np.uint8], width: int, *, smooth: bool = False) -> bytes:
    """PNG file of rows (h, n) of 1, 2, 3 or 6 bytes a pixel: grey or RGB of 8 or 16 bits, the higher byte first."""
    filtered = _filtered(len(rows), rows.shape[1] + 1)
    filter_rows(rows, rows.shape[1] // width, UP if smooth else AVERAGE, filtered)
    return png_of_filtered(filtered, width, smooth=smooth)


def png_of_filtered(filtered: NDArray[np.uint8], width: int, *, smooth: bool = False) -> bytes:
    """The file of `png_of_rows` of rows (h, 1 + n) that are filtered, by UP if they are smooth: see `filter_rows`."""
    h, pixel = len(filtered), (filtered.shape[1] - 1) // width
    wide, color = (pixel // 3, RGB) if pixel % 3 == 0 else (pixel, GREY)
    stream = _stream(filtered.size)
    deflated = deflate(filtered.reshape(-1), pixel if smooth else 1, stream)
    packed = stream.astype("<u8", copy=False).view(np.uint8)[: -(-deflated.bits // 8)]
    head = struct.pack(">IIBBBBB", width, h, 8 * wide, color, 0, 0, 0)
    checksum = struct.pack(">I", deflated.checksum)
    chunks = (_chunk(b"IHDR", head), _chunk(b"IDAT", ZLIB_HEADER, packed, checksum), _chunk(b"IEND"))
    return b"".join([SIGNATURE, *chain.from_iterable(chunks)])


@lru_cache(maxsize=4)
def _filtered(rows: int, columns: int) -> NDArray[np.uint8]:
    """Buffer of filtered rows, reused between images: allocation takes as long as filtering."""
    return np.empty((rows, columns), dtype=np.uint8)


@lru_cache(maxsize=4)
def _stream(size: int) -> NDArray[np.uint64]:
    """Buffer of the stream of so many bytes, reused between images."""
    return np.empty(room_words(size), dtype=np.uint64)


def _chunk(kind: bytes, *data: Any) -> list[Any]:
    """A chunk as a list of buffers (PNG specification, third edition, section 5.3)."""
    crc = zlib.crc32(kind)
    for piece in data:
        crc = zlib.crc32(piece, crc)
    return [struct.pack(">I", sum(map(len, data))), kind, *data, struct.pack(">I", crc)]
