"""The PNG encoder: other decoders read the same pixels, the size is that of OpenCV's, and the bytes are pinned."""

import hashlib
import heapq
import io
import zlib

import cv2
import numpy as np
import pytest
from PIL import Image

from uavbench.scenes.png.checksum import adler32
from uavbench.scenes.png.deflate import deflate, room_words
from uavbench.scenes.png.encoder import ENCODING, png
from uavbench.scenes.png.huffman import code_lengths
from uavbench.scenes.png.matches import AT_ONCE, find_matches

RNG = np.random.default_rng(7)


def photo(h: int, w: int) -> np.ndarray:
    """A smooth image with noise on it."""
    smooth = 120 + 60 * np.sin(np.add.outer(np.arange(h) / 17, np.arange(w) / 29))[..., None] * [1.0, 0.8, 0.5]
    return np.clip(np.rint(smooth + RNG.normal(0, 3, (h, w, 3))), 0, 255).astype(np.uint8)


STEP = np.zeros((50, 700), dtype=np.uint8)
STEP[20:, 300:] = 200
IMAGES = {
    "photo": photo(240, 320),
    "noise": RNG.integers(0, 256, (120, 333, 3), dtype=np.uint8),
    "one pixel": np.full((1, 1, 3), 9, dtype=np.uint8),
    "one column": RNG.integers(0, 256, (301, 1, 3), dtype=np.uint8),
    "black": np.zeros((480, 640, 3), dtype=np.uint8),
    "mask": STEP,
    "depth": (np.add.outer(np.arange(200) * 211, np.arange(91) * 3) % 65536).astype(np.uint16),
    "normals": RNG.integers(0, 65536, (31, 57, 3)).astype(np.uint16),
    "runs": np.repeat(RNG.integers(0, 3, 400), RNG.integers(1, 600, 400))[: 300 * 300]
    .reshape(300, 300)
    .astype(np.uint8),
}


@pytest.mark.parametrize("smooth", [False, True], ids=["noisy", "smooth"])
@pytest.mark.parametrize("name", list(IMAGES))
def test_other_decoders_read_the_same_pixels(name: str, smooth: bool) -> None:
    image, data = IMAGES[name], png(IMAGES[name], smooth=smooth)
    assert np.array_equal(cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED), image)
    if image.dtype == np.uint16 and image.ndim == 3:
        return  # Pillow has no 16-bit colour
    with Image.open(io.BytesIO(data)) as opened:
        read = np.array(opened)
    assert np.array_equal(read[..., ::-1] if image.ndim == 3 else read, image)


def test_the_files_are_about_as_small_as_those_of_a_library() -> None:
    """Of Huffman codes alone, for which OpenCV's need twice the time."""
    options = [cv2.IMWRITE_PNG_COMPRESSION, 1, cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_HUFFMAN_ONLY]
    image = photo(480, 640)
    library = cv2.imencode(".png", image, [*options, cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_AVG])[1].size
    assert len(png(image)) < 1.02 * library
    assert len(png(IMAGES["black"])) < 0.01 * IMAGES["black"].size


def test_the_bytes_of_a_version_never_change() -> None:
    """Whoever changes them raises ENCODING, which sequence.json records, and pins the new ones here."""
    ramp = (np.arange(97 * 61 * 3, dtype=np.int64) ** 2 // 7 % 251).astype(np.uint8).reshape(61, 97, 3)
    files = png(ramp), png(ramp[..., 0], smooth=True), png(257 * (ramp // 16).astype(np.uint16), smooth=True)
    digests = tuple(hashlib.sha256(file).hexdigest()[:16] for file in (files[0] + files[1], files[2]))
    assert (ENCODING, *digests) == ("uavbench 2", "8f182ab0ba57da20", "2b4c7382884f6b87")


@pytest.mark.parametrize("size", [1, 2, 3, 258, 259, 261, 65535, 131072, 131073, 400000])
@pytest.mark.parametrize("kind", ["same", "two", "noise", "skewed", "patterns"])
@pytest.mark.parametrize("distance", [1, 2, 3, 6, 8])
def test_zlib_inflates_what_is_deflated(size: int, kind: str, distance: int) -> None:
    data = {
        "patterns": np.resize(np.tile(RNG.integers(0, 256, (9, distance), dtype=np.uint8), (1, 97)), size),
        "same": np.full(size, 65, dtype=np.uint8),
        "two": (np.arange(size) // 5 % 2).astype(np.uint8),
        "noise": RNG.integers(0, 256, size, dtype=np.uint8),
        "skewed": np.minimum(RNG.geometric(0.5, size), 255).astype(np.uint8),
    }[kind]
    out = np.full(room_words(size), 0xFFFFFFFFFFFFFFFF, dtype=np.uint64)
    bits, checksum = deflate(data, distance, out)
    assert bits <= 64 * out.size and checksum == zlib.adler32(data)
    assert zlib.decompress(out.view(np.uint8)[: -(-bits // 8)].tobytes(), -15) == data.tobytes()


def matches_by_hand(data: np.ndarray, distance: int) -> list[int]:
    """Begin and end of each longest stretch of at least three bytes that are like those a distance before."""
    places, k = [], distance
    while k < len(data):
        end = k
        while end < len(data) and data[end] == data[end - distance]:
            end += 1
        places += [k, end] if end - k >= 3 else []
        k = max(end, k + 1)
    return places


@pytest.mark.parametrize("size", [1, 2, 63, 64, 65, 127, 128, 1000])
@pytest.mark.parametrize("distance", [1, 2, 6])
def test_matches_are_the_longest_stretches_of_repeated_bytes(size: int, distance: int) -> None:
    for share in (0.05, 0.3, 1.0):
        data = (RNG.random(size) > share).astype(np.uint8) * RNG.integers(0, 3, size, dtype=np.uint8)
        masks, threes = np.zeros(99, dtype=np.uint64), np.zeros(99, dtype=np.uint64)
        places = np.empty(size + AT_ONCE, dtype=np.int64)
        find = getattr(find_matches, "for_python", find_matches)
        count = find(data, (0, size), distance, masks, threes, places)
        assert places[:count].tolist() == matches_by_hand(data, distance)


@pytest.mark.parametrize(("kind", "pixel"), [("depth", 2), ("normals", 6)])
def test_what_repeats_from_pixel_to_pixel_takes_no_room(kind: str, pixel: int) -> None:
    """A slope has the same residual in each pixel, whose bytes differ."""
    shape = (200, 300) if pixel == 2 else (200, 300, 3)
    slope = np.broadcast_to(np.arange(200).reshape(-1, *[1] * (len(shape) - 1)) * 301, shape).astype(np.uint16)
    assert len(png(slope, smooth=True)) < 0.02 * slope.nbytes


def best_cost(counts: np.ndarray) -> int:
    """Bits of all symbols by Huffman's own construction."""
    queue, total = [int(c) for c in counts if c], 0
    heapq.heapify(queue)
    while len(queue) > 1:
        both = heapq.heappop(queue) + heapq.heappop(queue)
        total += both
        heapq.heappush(queue, both)
    return total


@pytest.mark.parametrize("seed", range(12))
def test_codes_are_as_short_as_huffmans_and_none_is_too_long(seed: int) -> None:
    rng = np.random.default_rng(seed)
    counts = (rng.pareto(0.6 + 0.2 * seed, 286) * 20).astype(np.int64).clip(0, 100000)
    counts[:2] = 1
    lengths = np.zeros(286, dtype=np.int64)
    code_lengths(counts, 15, lengths)
    used = lengths[lengths > 0]
    assert ((lengths > 0) == (counts > 0)).all()
    assert (1 << (15 - used)).sum() == 1 << 15, "Kraft: neither room left nor too little"
    if used.max() < 15:
        assert (counts * lengths).sum() == best_cost(counts)


def test_codes_of_very_uneven_symbols_are_cut_to_what_deflate_allows() -> None:
    counts = np.array([1, 1, *(2**k for k in range(1, 29))], dtype=np.int64)
    lengths = np.zeros(30, dtype=np.int64)
    code_lengths(counts, 15, lengths)
    assert lengths.max() == 15
    assert (1 << (15 - lengths)).sum() == 1 << 15
    assert (np.diff(lengths) <= 0).all(), "more frequent, no longer"


@pytest.mark.parametrize("size", [0, 1, 5503, 5504, 5505, 400000])
def test_the_checksum_is_that_of_zlib(size: int) -> None:
    checksum = getattr(adler32, "for_python", adler32)
    for data in (RNG.integers(0, 256, size, dtype=np.uint8), np.full(size, 255, dtype=np.uint8)):
        for cut in (0, size // 3):
            assert checksum(data[cut:], checksum(data[:cut], 1)) == zlib.adler32(data)
