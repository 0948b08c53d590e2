"""Text files of numbers, read block by block: by a fast parser where a block is plain, else line by line.

Both parsers give identical numbers; only the slow one reports errors, with the number of the line.
"""

import csv
import io
import re
from array import array
from collections.abc import Iterator
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from itertools import islice
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.limits import LONGEST_LINE, MOST_POSES, TRAJECTORY
from uavbench.trajectories.files.reading import not_text, opened
from uavbench.trajectories.files.tables import plain_number
from uavbench.trajectories.pose import Array

FIRST_BYTES, BLOCK_BYTES = 1 << 16, 1 << 23
"""Comments at the top of a file make its first block slow to parse, so it is small; the others fit into a cache."""
PLAIN = b"0123456789+-.eE \t,\n"
"""Bytes that a plain block consists of."""
GZIP = b"\x1f\x8b"
"""Magic bytes of a gzip file."""
WHOLE = r"[-+]?\d+(?:,\d+)?(?:[eE][-+]?\d+)?"
"""A number without a decimal point, but maybe with a comma in its place."""
DECIMAL_COMMAS = re.compile(rf"(?=.*\d,\d){WHOLE}(?:(?:\s*;\s*|\s+){WHOLE})+;?")
"""A line of two or more numbers without a decimal point, parted by blanks or semicolons, some with a comma inside."""
EMPTY_CELLS = (re.compile(rb",[ \t]*,"), re.compile(rb"\n[ \t]*,"))
"""Commas without a value between them, and before the first value of a line; one pattern for both is slow."""
COMMENTS = ("#", "%", "//")
"""Beginnings of a comment: of TUM files, of MATLAB and LaTeX, of C."""
COMMENT_LINES = re.compile(rb"(?:[ \t]*(?:(?:#|%|//)[^\n]*)?\n)*")
STAMP_CHARACTERS = 24
"""A plain stamp has at most 19 digits and a point."""


MEANT_BY = {
    7: "a pose without its time? Put the seconds first (tum)",
    9: "a column too many for tum? Leave out the one that is neither the time nor of the pose, as an index or a score",
    10: "images.txt of COLMAP? Write poses with their times as tum, or a matrix a line as kitti",
    13: "a matrix with a time or an index first? Move times to a times.txt beside the file, leave an index out "
    "(kitti; one of whole numbers, 0 1 2 ..., is read), or write the poses with their times as tum",
    16: "a whole matrix of four rows? Leave out its last row, 0 0 0 1 (kitti)",
    17: "a whole matrix with a time first? Write position and quaternion with the time as tum; or euroc with seconds? "
    "Write nanoseconds",
}
"""What lines with other numbers of values may be, and what to do."""


@dataclass(frozen=True)
class Layout:
    """Number of values on a line; with `more`, further values may follow and are ignored.

    The first value is a time stamp in units of unit_ns (1 or 10^9) nanoseconds; unit_ns 0: there is no stamp.
    """

    values: int
    more: bool = False
    unit_ns: int = 0

    def fits(self, values: int) -> bool:
        """Whether a line with this many values has the layout."""
        return values >= self.values if self.more else values == self.values

    @property
    def decimals(self) -> int:
        """Decimals of a stamp."""
        return len(str(self.unit_ns)) - 1


@dataclass(frozen=True, eq=False)
class NumberLines:
    """Line numbers (n,); stamps (n,) in ns, zeros where the layout has none; values (n, k), the stamps' too."""

    numbers: NDArray[np.int64]
    stamps_ns: NDArray[np.int64]
    values: Array


def read_lines(path: Path, layout: Layout) -> NumberLines:
    """All lines of numbers of a file; UserError naming the first invalid line, or when there is none."""
    first_lines(path, 1)
    parts: list[NumberLines] = []
    rows = 0
    for first, block in _blocks(path):
        part = _plain(block, first, layout) or _careful(path, block, first, layout)
        parts.append(part)
        rows += len(part.numbers)
        if rows > MOST_POSES:
            raise UserError(f"{path}: has more than {MOST_POSES:,} poses; {TRAJECTORY.remedy}")
    if not rows:
        raise UserError(f"{path}: holds no pose")
    return NumberLines(
        np.concatenate([part.numbers for part in parts]),
        np.concatenate([part.stamps_ns for part in parts]),
        np.concatenate([part.values for part in parts]),
    )


class NumberedLine(NamedTuple):
    """Text of a line, and its number in the file, counted from 1."""

    number: int
    text: str


def first_lines(path: Path, count: int) -> list[NumberedLine]:
    """The first lines of numbers, at most `count`; UserError when there is none, or where they have decimal commas."""
    lines = (NumberedLine(*line) for first, block in _blocks(path) for line in _filled(path, block, first))
    found = list(islice(lines, count))
    if not found:
        raise UserError(f"{path}: holds no pose")
    if DECIMAL_COMMAS.fullmatch(found[0].text.strip()):
        raise UserError(f"{path}: line {found[0].number} has decimal commas; write decimal points")
    return found


def comments(path: Path) -> str:
    """The lines before the first line of numbers, up to the end of the first block."""
    for _, block in _blocks(path):
        found = COMMENT_LINES.match(block)
        return found[0].decode("utf-8", errors="replace") if found else ""
    return ""


def cells_of(line: str) -> list[str]:
    """Values of a line, which are separated by commas, spaces or both; "" for an empty cell before the last value."""
    if "," not in line:
        return line.split()
    return [cell for part in line.rstrip(", \t\r\n").split(",") for cell in part.split() or [""]]


def whole_number(text: str) -> int | None:
    """The whole number that a stamp is, in any notation, as 1.5e9 and 15.0 too; None for any other text."""
    try:
        value = Decimal(text.replace("_", "?"))
    except InvalidOperation:
        return None
    plain = value.is_finite() and value.adjusted() < STAMP_CHARACTERS and value == value.to_integral_value()
    return int(value) if plain else None


def column_advice(values: int) -> str:
    """What to do about lines with a number of values that no format has; "" where nothing is known of it."""
    known = MEANT_BY.get(values, "")
    return f"; {known}" if known else ""


def separator_advice(line: str) -> str:
    """What to do about a line whose values are separated by semicolons; "" for any other."""
    return "; separate values by spaces or commas, not by semicolons, and write decimal points" if ";" in line else ""


def _blocks(path: Path) -> Iterator[tuple[int, bytes]]:
    """Blocks of whole lines, with the number of the first line of each."""
    number, size = 1, FIRST_BYTES
    with opened(path, TRAJECTORY) as handle:
        while True:
            try:
                block = handle.read(size) + handle.readline(LONGEST_LINE)
                whole = block.endswith(b"\n") or not handle.peek(1)
            except OSError as error:
                raise UserError(f"{path}: cannot be read: {error.strerror or error}") from None
            if not block:
                return
            if number == 1 and block.startswith(GZIP):
                raise UserError(f"{path}: is compressed by gzip; decompress it with `gunzip`")
            block = block.removeprefix(b"\xef\xbb\xbf" if number == 1 else b"").replace(b"\r\n", b"\n")
            ends = block.count(b"\n") + block.count(b"\r")
            if not whole:
                raise too_long(path, number + ends)
            yield number, block
            number, size = number + ends, BLOCK_BYTES


def _plain(block: bytes, number: int, layout: Layout) -> NumberLines | None:
    """The lines of a block if all of them are plain, otherwise None."""
    if block.translate(None, PLAIN) or not block.endswith(b"\n"):
        return None
    if any(empty.search(b"\n" + block) for empty in EMPTY_CELLS):
        return None
    stamps = _plain_stamps(np.frombuffer(block, dtype=np.uint8), layout.decimals) if layout.unit_ns else None
    if layout.unit_ns and stamps is None:
        return None
    used = [sign for sign in (",", " ", "\t") if sign.encode() in block]
    between = used[0] if len(used) == 1 and b"  " not in block else ""
    import pandas as pd  # lazy: a vehicle reads no long files

    try:
        table = pd.read_csv(
            io.BytesIO(block if between else block.replace(b",", b" ")),
            sep=between or r"\s+",
            header=None,
            dtype=np.float64,
            na_filter=False,
            quoting=csv.QUOTE_NONE,
        )
    except ValueError:  # another width, or no numbers; `_careful` reports which
        return None
    values = table.to_numpy()
    rows, width = values.shape
    if rows != block.count(b"\n") or not layout.fits(width):
        return None
    numbers = np.arange(number, number + rows)
    return NumberLines(numbers, np.zeros(rows, np.int64) if stamps is None else stamps, values[:, : layout.values])


def _plain_stamps(text: NDArray[np.uint8], decimals: int) -> NDArray[np.int64] | None:
    """Stamps (n,) at the beginning of each line, in units of the last decimal; None where one is not plain.

    A plain stamp has only digits and at most `decimals` of them behind a point, so that it is exact.
    """
    ends = np.flatnonzero(text == ord("\n"))
    starts = np.concatenate([[0], ends[:-1] + 1])
    padded = np.concatenate([text, np.zeros(STAMP_CHARACTERS, np.uint8)])
    letters = np.lib.stride_tricks.sliding_window_view(padded, STAMP_CHARACTERS)[starts]
    over = (letters == ord(" ")) | (letters == ord(",")) | (letters == ord("\t")) | (letters == ord("\n"))
    length = np.argmax(over, axis=1)
    point = np.argmax((letters == ord(".")) | over, axis=1)
    behind = np.maximum(length - point - 1, 0)
    if not over.any(axis=1).all() or (point == 0).any() or (behind > decimals).any() or (point + decimals > 19).any():
        return None
    value = np.zeros(len(starts), dtype=np.uint64)
    for k in range(int(length.max())):
        digit = letters[:, k] - np.uint8(ord("0"))
        counts = (k < length) & (k != point)
        if (counts & (digit > 9)).any():
            return None
        value = np.where(counts, value * np.uint64(10) + digit, value)
    value *= np.uint64(10) ** (decimals - behind).astype(np.uint64)
    return value.astype(np.int64) if (value < np.uint64(2**63)).all() else None


def _careful(path: Path, block: bytes, number: int, layout: Layout) -> NumberLines:
    """The lines of any block; UserError naming the first invalid one."""
    numbers, stamps, values = array("q"), array("q"), array("d")
    for line_number, line in _filled(path, block, number):
        cells = cells_of(line)
        if not layout.fits(count := len(cells) - cells.count("")):
            wanted = f"at least {layout.values}" if layout.more else layout.values
            raise UserError(f"{path}: line {line_number} has {count} values, expected {wanted}{separator_advice(line)}")
        if "" in (known := cells[: layout.values]):
            raise UserError(
                f"{path}: line {line_number}: value {1 + known.index('')} is missing, between two commas; write it, or "
                "leave the line out"
            )
        numbers.append(line_number)
        stamps.append(_stamp(path, line_number, cells[0], layout.unit_ns) if layout.unit_ns else 0)
        try:
            values.extend([plain_number(cell) for cell in cells[: layout.values]])
        except ValueError as error:
            raise UserError(
                f"{path}: line {line_number}: {error}; leave out columns of text and those before the pose but its time"
            ) from None
    table = np.array(values).reshape(-1, layout.values)
    return NumberLines(np.array(numbers, dtype=np.int64), np.array(stamps, dtype=np.int64), table)


def _filled(path: Path, block: bytes, number: int) -> Iterator[tuple[int, str]]:
    """Numbered lines of a block that are neither blank nor a comment; UserError if one is too long or not text."""
    try:
        text = block.decode("utf-8")
    except UnicodeDecodeError as error:
        line_number = number + block[: error.start].count(b"\n")
        raise not_text(path, error, f"line {line_number}: ") from None
    for line_number, line in enumerate(text.replace("\r", "\n").split("\n"), start=number):
        if len(line) > LONGEST_LINE:
            raise too_long(path, line_number)
        if line.strip() and not line.lstrip().startswith(COMMENTS):
            yield line_number, line


def _stamp(path: Path, number: int, text: str, unit_ns: int) -> int:
    try:
        value = Decimal(text.replace("_", "?"))  # Python reads 1_5 as 15
        if value.is_finite() and value.adjusted() > 19:  # before its digits are written out: 1e999990 has a million
            raise OverflowError
        stamp = int((value * unit_ns).to_integral_value())
    except (InvalidOperation, ValueError) as error:
        names = "; put # before a line of names" if isinstance(error, InvalidOperation) else ""
        names = separator_advice(text) or names
        raise UserError(f"{path}: line {number}: {text[:40]!r} is not a time stamp{names}") from None
    except OverflowError:
        stamp = 2**63
    if not -(2**63) <= stamp < 2**63:
        raise UserError(
            f"{path}: line {number}: the time stamp {text[:40]!r} does not fit into 64-bit nanoseconds; "
            "is it in the unit of its format (TUM: seconds, EuRoC: nanoseconds)?"
        )
    return stamp


def too_long(path: Path, number: int) -> UserError:
    """Error for a line that is longer than any row of numbers."""
    return UserError(f"{path}: line {number} is longer than {LONGEST_LINE:,} bytes; is this a trajectory?")
