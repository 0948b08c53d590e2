"""Damage within JPEG files that decoders pass over, which shows as grey or shifted blocks (ITU-T T.81)."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.scenes.decoding.jpeg_kernels import bits_of_blocks

START, END = b"\xff\xd8", 0xD9
SEQUENTIAL, PROGRESSIVE = (0xC0, 0xC1), 0xC2
OTHER_FRAMES = frozenset(range(0xC3, 0xD0)) - {0xC4, 0xC8, 0xCC}
"""Frames of other processes: lossless, hierarchical or arithmetic, of which nothing is checked."""
HUFFMAN, INTERVAL, SCAN = 0xC4, 0xDD, 0xDA
FIRST_RESTART, LAST_RESTART = 0xD0, 0xD7
COEFFICIENTS = 64


class Component(NamedTuple):
    """A colour component of a frame: its number, and its sampling factors."""

    number: int
    across: int
    down: int


class ScanPart(NamedTuple):
    """A component of a scan, with the numbers of its tables of DC and AC coefficients."""

    component: Component
    dc: int
    ac: int


@dataclass
class Frame:
    """What the headers so far say: size in px, components, tables of Huffman codes (65536,), restart interval in MCUs.

    missing: of a progressive frame, how many bits of each coefficient (64,) are still to come, by component.
    """

    width: int = 0
    height: int = 0
    progressive: bool = False
    components: dict[int, Component] = field(default_factory=dict)
    codes: dict[int, NDArray[np.int32]] = field(default_factory=dict)
    interval: int = 0
    missing: dict[int, NDArray[np.int64]] = field(default_factory=dict)

    def mcus(self, parts: list[ScanPart]) -> int:
        """Number of MCUs of a scan of these components: blocks of a single one, else those of all interleaved."""
        across = max(c.across for c in self.components.values())
        down = max(c.down for c in self.components.values())
        if len(parts) > 1:
            return -(-self.width // (8 * across)) * -(-self.height // (8 * down))
        c = parts[0].component
        wide, high = -(-self.width * c.across // across), -(-self.height * c.down // down)
        return -(-wide // 8) * -(-high // 8)


def jpeg_damage(data: bytes) -> str:
    """What is wrong with the content of a JPEG file, "" where nothing is found or its process is not known.

    Of sequential frames each code is followed, of progressive ones it is looked whether all bits are there.
    """
    frame, seen, at_end = Frame(), set[int](), False
    try:
        for marker, body, rest in _segments(data):
            if marker in (*SEQUENTIAL, PROGRESSIVE):
                _read_frame(frame, marker, body)
            elif marker in OTHER_FRAMES:
                return ""
            elif marker == HUFFMAN:
                _read_tables(frame, body)
            elif marker == INTERVAL:
                frame.interval = int.from_bytes(body[:2], "big")
            elif marker == SCAN:
                if not frame.height:  # told after the first scan
                    return ""
                seen |= set(body[1 : 1 + 2 * body[0] : 2])
                if frame.progressive:
                    _count_bits(frame, body)
                elif why := _damage_of_scan(frame, body, np.frombuffer(data, dtype=np.uint8)[rest:]):
                    return why
            at_end = marker == END
    except (IndexError, KeyError, ValueError, ZeroDivisionError):  # what a decoder needs is not there: it tells
        return ""
    if not at_end or frame.components.keys() - seen:
        return "its data end too soon"
    return "its data end too soon" if any(bits.any() for bits in frame.missing.values()) else ""


def _segments(data: bytes) -> Iterator[tuple[int, bytes, int]]:
    """Marker, content, and place of what follows of each segment, up to the end of the image."""
    at = len(START)
    while at < len(data):
        at = data.index(b"\xff", at)
        while data[at] == 0xFF:  # fill bytes
            at += 1
        marker = data[at]
        at += 1
        if marker == END:
            yield marker, b"", at
            return
        if marker in (0, 1) or FIRST_RESTART <= marker <= LAST_RESTART:  # within a scan
            continue
        length = int.from_bytes(data[at : at + 2], "big")
        body = data[at + 2 : at + length]
        at += length
        yield marker, body, at


def _read_frame(frame: Frame, marker: int, body: bytes) -> None:
    frame.progressive = marker == PROGRESSIVE
    frame.height, frame.width = int.from_bytes(body[1:3], "big"), int.from_bytes(body[3:5], "big")
    for k in range(6, 6 + 3 * body[5], 3):
        frame.components[body[k]] = Component(body[k], body[k + 1] >> 4, body[k + 1] & 15)
        if frame.progressive:
            frame.missing[body[k]] = np.full(COEFFICIENTS, 8 * body[0])  # more than any has


def _read_tables(frame: Frame, body: bytes) -> None:
    """Tables of a DHT segment, each as 256 * length + symbol for all 16 bits that may follow; class AC from 16 on."""
    at = 0
    while at < len(body):
        counts, symbols = body[at + 1 : at + 17], iter(body[at + 17 :])
        codes, code = np.zeros(1 << 16, dtype=np.int32), 0
        for length, count in enumerate(counts, start=1):
            for _ in range(count):
                codes[code << (16 - length) : (code + 1) << (16 - length)] = length << 8 | next(symbols, 0)
                code += 1
            code <<= 1
        frame.codes[body[at]] = codes
        at += 17 + sum(counts)


def _count_bits(frame: Frame, body: bytes) -> None:
    """Note which bits a progressive scan holds, by its last three bytes: first and last coefficient, lowest bit."""
    first, last, low = body[-3], body[-2], body[-1] & 15
    for number in body[1 : 1 + 2 * body[0] : 2]:
        bits = frame.missing[number][first : last + 1]
        np.minimum(bits, low, out=bits)


def _damage_of_scan(frame: Frame, body: bytes, data: NDArray[np.uint8]) -> str:
    """What is wrong with a sequential scan; body: its header, data: the bytes that follow."""
    parts = [
        ScanPart(frame.components[body[k]], body[k + 1] >> 4, body[k + 1] & 15) for k in range(1, 1 + 2 * body[0], 2)
    ]
    names = [(part.dc, 16 + part.ac) for part in parts]
    used = list(dict.fromkeys(name for pair in names for name in pair))
    codes = np.stack([frame.codes[name] for name in used])
    blocks = [1 if len(parts) == 1 else part.component.across * part.component.down for part in parts]
    rows = [
        [used.index(name) for name in pair] for pair, count in zip(names, blocks, strict=True) for _ in range(count)
    ]
    tables, left = np.array(rows, dtype=np.int64), frame.mcus(parts)
    for k, run in enumerate(_runs(data)):
        mcus = min(left, frame.interval or left)
        if not mcus:
            return "it has more data than its size tells"
        if k and run.restart != (k - 1) % 8:
            return "parts of its data are missing"
        bits = bits_of_blocks(run.content, codes, tables, mcus)
        if bits < 0:
            return "its data end too soon, or are damaged"
        if not np.isin(run.content[-(-bits // 8) :], (0, 255)).all():  # some cameras fill up
            return "its data are damaged"
        left -= mcus
    return "its data end too soon" if left else ""


class Run(NamedTuple):
    """Bytes between two restart markers without stuffing, and the number of the marker before them."""

    content: NDArray[np.uint8]
    restart: int


def _runs(data: NDArray[np.uint8]) -> Iterator[Run]:
    """The runs of a scan up to the next other marker."""
    after = np.flatnonzero(data[:-1] == 0xFF) + 1
    kinds = data[after]
    restarts = (kinds >= FIRST_RESTART) & (kinds <= LAST_RESTART)
    ends = after[~restarts & (kinds != 0) & (kinds != 0xFF)]
    end = int(ends[0]) if len(ends) else len(data) + 1
    begin, restart = 0, -1
    for marker in (*after[restarts & (after < end)].tolist(), end):
        content = data[begin : marker - 1]
        stuffed = np.flatnonzero((content[:-1] == 0xFF) & (content[1:] == 0)) + 1
        yield Run(np.delete(content, stuffed), restart)
        if marker < end:
            begin, restart = marker + 1, int(data[marker]) - FIRST_RESTART
