"""The JSON and CSV files of a sequence, read with errors for people."""

import csv
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trajectories.errors import UserError
from trajectories.pose import Array


def read_json(path: Path) -> dict[str, Any]:
    """JSON object of a file; UserError naming the file."""
    try:
        value = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise UserError(f"{path}: no such file (is this a sequence folder?)") from None
    except (OSError, ValueError) as error:
        raise UserError(f"{path}: not readable as JSON: {error}") from None
    if not isinstance(value, dict):
        raise UserError(f"{path}: expected a JSON object")
    return value


def read_table(path: Path, columns: list[str]) -> list[dict[str, str]]:
    """Rows of a CSV file that has at least these columns; UserError naming the file and the row."""
    try:
        with path.open(encoding="utf-8", newline="") as handle:
            reader = csv.DictReader(handle)
            missing = [c for c in columns if c not in (reader.fieldnames or [])]
            if missing:
                raise UserError(f"{path}: missing columns {', '.join(missing)}")
            rows = list(reader)
    except FileNotFoundError:
        raise UserError(f"{path}: no such file") from None
    except (OSError, ValueError, csv.Error) as error:
        raise UserError(f"{path}: not readable as CSV: {error}") from None
    for number, row in enumerate(rows, start=2):
        if None in row or any(row[c] is None for c in columns):
            raise UserError(f"{path}: line {number} does not have {len(reader.fieldnames or [])} values")
    return rows


def read_numbers(path: Path, columns: list[str]) -> Array:
    """These columns (n, k) of a CSV file as numbers; UserError naming the file and the line."""
    return np.array(_converted(path, columns, float), dtype=np.float64).reshape(-1, len(columns))


def read_integers(path: Path, columns: list[str]) -> NDArray[np.int64]:
    """These columns (n, k) of a CSV file as integers; UserError naming the file and the line."""
    rows = _converted(path, columns, int)
    try:
        return np.array(rows, dtype=np.int64).reshape(-1, len(columns))
    except OverflowError:
        raise UserError(f"{path}: an integer has more than 64 bits") from None


def _converted(path: Path, columns: list[str], kind: Callable[[str], Any]) -> list[list[Any]]:
    rows = []
    for number, row in enumerate(read_table(path, columns), start=2):
        try:
            rows.append([kind(row[c]) for c in columns])
        except ValueError as error:
            raise UserError(f"{path}: line {number}: {error}") from None
    return rows
