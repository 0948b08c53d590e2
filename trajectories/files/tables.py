"""CSV tables with named columns, in any order: rows, numbers and integers, with errors that name line and column.

A byte order mark, Windows line ends, spaces about names and values, blank lines and comments (#) are permitted.
"""

import csv
import io
from array import array
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from itertools import islice
from operator import itemgetter
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.trajectories.errors import UserError, one_line
from uavbench.trajectories.files.limits import LONGEST_LINE, MOST_ROWS, TABLE, FileLimit
from uavbench.trajectories.files.reading import not_text, opened

SHOWN = 40
"""Most characters of an invalid value that an error message quotes."""
OTHER_SEPARATORS = {";": "semicolons", "\t": "tabs"}
"""Separators of other dialects of CSV, by their names."""


class NumberedRow(NamedTuple):
    """The cells of a row, and its line in the file."""

    line: int
    cells: list[str]


class TableRows(NamedTuple):
    """Names of the columns of a CSV file, and its rows."""

    names: list[str]
    rows: Iterator[NumberedRow]


@contextmanager
def table_rows(
    path: Path, columns: Sequence[str], limit: FileLimit = TABLE, inside: Path | None = None
) -> Iterator[TableRows]:
    """Names of the columns of a CSV file, which must be among them once, and its rows; they are read in the context.

    inside: folder that the file must be in. UserError as `opened`, and naming the line of an invalid row.
    """
    with opened(path, limit, inside=inside) as handle:
        try:
            lines = Lines(path, io.TextIOWrapper(handle, encoding="utf-8-sig", newline=""))
            cells = csv.reader(lines, skipinitialspace=True)
            names = [name.strip() for name in next(filter(_is_row, cells), [])]
            _check_columns(path, columns, names)
            yield TableRows(names, _numbered(lines, cells, len(names)))
        except UnicodeDecodeError as error:
            raise not_text(path, error) from None
        except (OSError, csv.Error) as error:
            raise UserError(f"{path}: not readable as CSV: {error}") from None


def column_names(path: Path, limit: FileLimit = TABLE, inside: Path | None = None) -> list[str]:
    """Names of the columns of a CSV file; UserError as `table_rows`."""
    with table_rows(path, (), limit, inside) as (names, _):
        return names


def named_rows(
    path: Path, columns: Sequence[str], limit: FileLimit = TABLE, inside: Path | None = None
) -> list[dict[str, str]]:
    """Rows of a CSV file by the names of its columns, each of which must be there once; UserError as `table_rows`."""
    with table_rows(path, columns, limit, inside) as (names, rows):
        _check_columns(path, [name for name in names if name], names)
        return [dict(zip(names, cells, strict=True)) for _, cells in rows]


def numbers(path: Path, columns: Sequence[str], limit: FileLimit = TABLE, inside: Path | None = None) -> NDArray[Any]:
    """These columns (n, k) as float64; UserError as `table_rows`, or naming line and column of what is no number."""
    values = _converted(path, columns, limit, inside, "a number")
    return np.array(values, dtype=np.float64).reshape(-1, len(columns))


def integers(path: Path, columns: Sequence[str], limit: FileLimit = TABLE, inside: Path | None = None) -> NDArray[Any]:
    """These columns (n, k) as int64; UserError as `table_rows`, or naming line and column of what is no integer."""
    values = _converted(path, columns, limit, inside, "a whole number")
    return np.array(values, dtype=np.int64).reshape(-1, len(columns))


class Readings(NamedTuple):
    """Readings of a sensor: stamps_ns (n,), increasing, and values (n, k), NaN where nothing was measured."""

    stamps_ns: NDArray[np.int64]
    values: NDArray[np.float64]


def readings(path: Path, columns: Sequence[str], *, gaps: bool = False, inside: Path | None = None) -> Readings:
    """Readings in the column stamp_ns and these columns; gaps: cells may be empty or NaN.

    UserError as `numbers`, or naming the line of a value that is not finite, or of a stamp that is not later.
    """
    stamps_ns = integers(path, ["stamp_ns"], inside=inside)[:, 0]
    values = _converted(path, columns, TABLE, inside, "a number, or nothing" if gaps else "a number")
    table = np.array(values, dtype=np.float64).reshape(-1, len(columns))
    late = np.concatenate([[False], np.diff(stamps_ns) <= 0])[: len(stamps_ns)]
    bad = ~(np.isfinite(table) | (gaps & np.isnan(table)))
    if late.any():
        line = line_of_row(path, int(np.argmax(late)))
        raise UserError(f"{path}: line {line}: its stamp is not later than the previous one; sort the file by stamp_ns")
    if bad.any():
        row, column = np.argwhere(bad)[0]
        line, value = line_of_row(path, int(row)), table[row, column]
        raise UserError(f"{path}: line {line}: {columns[column]} = {value} is not finite; leave the line out")
    return Readings(stamps_ns, table)


def line_of_row(path: Path, row: int) -> int:
    """Line of a row, counted from 0, of a CSV file that can be read."""
    with table_rows(path, ()) as (_, rows):
        return next(islice(rows, row, None)).line


def plain_number(text: str) -> float:
    """Number that a text is; ValueError for any other, and for one with underscores: Python reads 1_5 as 15."""
    if "_" in text:
        raise ValueError(f"could not convert string to float: {one_line(text)[:SHOWN]!r}")
    return float(text)


def _or_nothing(cell: str) -> float:
    return float(cell) if cell.strip() else np.nan


CONVERSIONS: dict[str, Callable[[str], Any]] = {
    "a number": float,
    "a number, or nothing": _or_nothing,
    "a whole number": int,
}
"""How a cell is converted, by what it must be."""


def _converted(path: Path, columns: Sequence[str], limit: FileLimit, inside: Path | None, what: str) -> "array[Any]":
    """Values of these columns in row-major order, eight bytes each."""
    convert = CONVERSIONS[what]
    values = array("q" if convert is int else "d")
    with table_rows(path, columns, limit, inside) as (names, rows):
        places = [names.index(column) for column in columns]
        pick = itemgetter(*places, places[0])  # a tuple, of one column too
        for number, cells in rows:
            used = pick(cells)[:-1]
            try:
                values.extend(map(convert, used))
                if "_" in "".join(used):  # Python reads 1_5 as 15
                    raise ValueError
            except OverflowError:
                raise UserError(f"{path}: line {number}: an integer has more than 64 bits") from None
            except ValueError:
                raise _no_number(path, number, list(zip(columns, used, strict=True)), what) from None
    return values


def _no_number(path: Path, line: int, named: list[tuple[str, str]], what: str) -> UserError:
    """Error about the first of these cells, by the names of their columns, that cannot be converted."""
    convert = CONVERSIONS[what]
    for name, cell in named:
        with suppress(ValueError):
            convert(cell.replace("_", "?"))
            continue
        if not cell.strip():
            return UserError(f"{path}: line {line}: {name} is empty; leave the line out, or give {what}")
        return UserError(f"{path}: line {line}: {name} = {one_line(cell)[:SHOWN]!r} is not {what}")
    raise AssertionError("one of them cannot be converted")


def _check_columns(path: Path, columns: Sequence[str], names: list[str]) -> None:
    """UserError when columns are missing, or are there more than once."""
    if missing := [column for column in columns if column not in names]:
        between = next((how for sign, how in OTHER_SEPARATORS.items() if len(names) == 1 and sign in names[0]), "")
        advice = f"; its columns are separated by {between}: write commas, and numbers with a point" if between else ""
        raise UserError(f"{path}: missing columns {', '.join(missing)}{advice}")
    if twice := [column for column in columns if names.count(column) > 1]:
        raise UserError(f"{path}: has the column {twice[0]} {names.count(twice[0])} times; keep one of them")


class Lines:
    """Lines of a CSV file that are neither blank nor comments, each with whole values, and the number of the last one.

    UserError for one that is too long, or whose quotation mark has no end: the reader would take the next for its rest.
    """

    def __init__(self, path: Path, text: io.TextIOWrapper) -> None:
        self.path, self.number = path, 0
        self._text = text

    def __iter__(self) -> Iterator[str]:
        read = self._text.readline
        while line := read(LONGEST_LINE + 1):
            self.number += 1
            if len(line) > LONGEST_LINE:
                raise UserError(
                    f"{self.path}: line {self.number} is longer than {LONGEST_LINE:,} characters; is this a CSV file?"
                )
            if line.lstrip()[:1] in ("", "#"):
                continue
            if '"' in line and not _is_whole(line):
                raise UserError(
                    f"{self.path}: line {self.number}: a value begins with a quotation mark and does not end in this "
                    "line; close it, or remove it"
                )
            yield line


def _is_whole(line: str) -> bool:
    """Whether a row ends with its line."""
    parsed = csv.reader([line, ""], skipinitialspace=True)
    next(parsed)
    return parsed.line_num == 1


def _is_row(cells: list[str]) -> bool:
    """Whether a line is neither blank nor a comment, which a spreadsheet may have put into quotation marks."""
    return any(map(str.strip, cells)) and not cells[0].lstrip().startswith("#")


def _numbered(lines: Lines, rows: Iterator[list[str]], width: int) -> Iterator[NumberedRow]:
    """Rows of a reader of lines, numbered; UserError for one of another width, or too many."""
    for cells in rows:
        number = lines.number
        if (not cells[0] or cells[0][0] in " #" or len(cells) != width) and not _is_row(cells):
            continue
        if len(cells) != width:
            advice = ""
            if len(cells) > width:
                at_end = not any(map(str.strip, cells[width:]))
                advice = "; remove commas at its end" if at_end else "; write numbers with a decimal point, not a comma"
            raise UserError(f"{lines.path}: line {number} has {len(cells)} values, not {width}{advice}")
        if number > MOST_ROWS:
            raise UserError(f"{lines.path}: has more than {MOST_ROWS:,} rows; {TABLE.remedy}")
        yield NumberedRow(number, cells)
