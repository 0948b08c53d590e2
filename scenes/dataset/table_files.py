"""Readers of a sequence's JSON, CSV and record files, with errors that name file and line."""

import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uavbench.scenes.dataset.disk_guards import inside
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files import reading
from uavbench.trajectories.files.limits import TABLE
from uavbench.trajectories.files.tables import Readings, integers, named_rows, numbers, readings
from uavbench.trajectories.pose import Array

FORMAT = 10
"""Version of what a sequence's files hold, `format` in sequence.json; raised where the same suite gives other bytes.

1 (no `format`): frames are exposed at the control steps of 2 ms nearest to even times. 2: at even times.
3: shadows outdoors reach ground that lies deeper, seen from the sun, than all that casts them.
4: edges by the outlines of triangles, before by four samples per pixel.
5: what lies 2 mm before a surface is before it at all distances; with distortion, depth and masks at pixel centres.
6: the files of depth, flow and normals are compressed further; with distortion, depth and masks at edges are those of
the nearest facet; hills, ground and plants of a site.
7: a point is hidden where a surface is before its own place; skies that are overcast, or have a low sun.
8: the plants of a site, and the ripples of its river; distant hills; clouds at the ends of their tile;
shadows of scenes of more than 20 m; with distortion, depth, masks, flow and normals of thin faces and at the sky.
9: rows of a rolling shutter that see beyond the render and its margin; auto exposure on an interlaced link above 60 Hz;
vertex colours of glTF; edges of surfaces that are there from both sides.
10: with distortion or a rolling shutter, what shows beside leaves and in their gaps, in all that is traced.
"""
OF_A_SEQUENCE = ("sequence.json", "manifest.json")
"""JSON files of a sequence's folder."""
POSITIVE = ("rate_hz", "depth_m_per_unit")
TABLES = ("config", "deviation", "versions")
LONGEST_NS = 10**18
"""Largest delay or clock shift in ns: thirty years."""
ANEW = "copy the folder again, or render or import it again"
"""What to do about a sequence's file that is not as it was written, which may have come from elsewhere."""
SHOWN = 60
"""Most characters of an invalid value that an error message quotes."""


def read_json(path: Path) -> dict[str, Any]:
    """JSON object of a file that lies in its folder; UserError naming the file."""
    hint = " (is this a sequence folder?)" if path.name in OF_A_SEQUENCE else ""
    return reading.read_json(path, inside=path.parent, hint=hint)


def check_info(path: Path, info: Mapping[str, Any]) -> None:
    """UserError naming the key of `sequence.json` whose value is invalid."""
    for key in POSITIVE:
        if not (_is_number(value := info.get(key, 1.0)) and 0 < value < float("inf")):
            raise _wrong(path, key, value, "a positive number")
    if not (_is_number(value := info.get("row_delay_ns", 0.0)) and 0 <= value <= LONGEST_NS):
        raise _wrong(path, "row_delay_ns", value, "a number of ns")
    shift = info.get("timeshift_cam_imu_ns", 0)
    if isinstance(shift, bool) or not isinstance(shift, int) or abs(shift) > LONGEST_NS:
        raise _wrong(path, "timeshift_cam_imu_ns", shift, "whole ns")
    if not 1 <= (version := format_of(path, info)) <= FORMAT:
        raise UserError(
            f"{path}: format = {version}: this version of uavbench reads formats 1 to {FORMAT}; install a later one"
        )
    for key in TABLES:
        if not isinstance(value := info.get(key) or {}, dict):
            raise _wrong(path, key, value, "a table")
    effects = (info.get("config") or {}).get("effects") or ()
    if not (isinstance(effects, list | tuple) and all(isinstance(effect, dict) for effect in effects)):
        raise _wrong(path, "config.effects", effects, "a list of tables")


def format_of(path: Path, info: Mapping[str, Any]) -> int:
    """Version of the format of a sequence by its sequence.json, see FORMAT; UserError where it is no integer."""
    version = info.get("format", 1)
    if isinstance(version, bool) or not isinstance(version, int):
        raise _wrong(path, "format", version, "an integer")
    return version


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _wrong(path: Path, key: str, value: Any, expected: str) -> UserError:
    shown = repr(value)
    return UserError(f"{path}: {key} = {shown[:SHOWN]}{'...' if len(shown) > SHOWN else ''}: must be {expected}")


def read_table(path: Path, columns: list[str]) -> list[dict[str, str]]:
    """Rows of a CSV file that has at least these columns; UserError naming the file and the line."""
    return named_rows(path, columns, inside=path.parent)


def read_numbers(path: Path, columns: list[str]) -> Array:
    """These columns (n, k) of a CSV file as numbers; UserError naming the file and the line."""
    return numbers(path, columns, inside=path.parent)


def read_integers(path: Path, columns: list[str]) -> NDArray[np.int64]:
    """These columns (n, k) of a CSV file as integers; UserError naming the file and the line."""
    return integers(path, columns, inside=path.parent)


def read_readings(path: Path, columns: list[str], *, gaps: bool = False) -> Readings:
    """Readings of a sensor in these columns; gaps: some may be empty. UserError naming the file and the line."""
    return readings(path, columns, gaps=gaps, inside=path.parent)


def read_records(path: Path) -> NDArray[np.void]:
    """Array (n,) of records, `stamp_ns` int64 and columns float64, as `write_records` wrote it.

    UserError naming the file; its size is compared with its header before memory is allocated.
    """
    stream = io.BytesIO(reading.read_bytes(path, TABLE, inside=path.parent))
    try:
        if np.lib.format.read_magic(stream) != (1, 0):
            raise ValueError("not of version 1.0")
        shape, _, kind = np.lib.format.read_array_header_1_0(stream)
        names = kind.names or ()
        if names[:1] != ("stamp_ns",) or len(shape) != 1:
            raise ValueError("not an array of records that begin with stamp_ns")
        if kind != np.dtype([("stamp_ns", "<i8"), *((name, "<f8") for name in names[1:])]):
            raise ValueError("its columns are not float64")
        data = stream.getbuffer()[stream.tell() :]
        if len(data) != shape[0] * kind.itemsize:
            raise ValueError("its size does not match its header")
        return np.frombuffer(data, dtype=kind)
    except (ValueError, SyntaxError, TypeError, OverflowError) as error:
        raise UserError(f"{path}: not an array of readings: {error}; {ANEW}") from None


def image_files(folder: Path) -> tuple[str, ...]:
    """Names of the images in frames.csv; UserError where one leads out of the folder."""
    files = tuple(row["file"] for row in read_table(folder / "frames.csv", ["frame", "stamp_ns", "file"]))
    for name in files:
        inside(folder, name)
    return files


def frame_stamps_ns(folder: Path) -> NDArray[np.int64]:
    """Stamps (n,) in frames.csv."""
    return read_integers(folder / "frames.csv", ["stamp_ns"])[:, 0]
