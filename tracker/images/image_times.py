"""Files with the times of images that lie beside them, as other tools write them; those of a folder are not read."""

import re
from pathlib import Path

import numpy as np

from uavbench.tracker.images.image_names import UNITS, fits
from uavbench.trajectories.errors import DamagedFileError, UserError
from uavbench.trajectories.files.limits import TABLE
from uavbench.trajectories.files.reading import read_json, read_text
from uavbench.trajectories.files.tables import column_names, integers
from uavbench.trajectories.pose import Array

TIMES = ("data.csv", "rgb.txt", "times.txt", "timestamps.txt", "times.csv", "timestamps.csv")
"""Names in EuRoC, TUM RGB-D, KITTI odometry, KITTI raw and of one's own: beside the images, or beside their folder."""
OWN = "frames.csv"
"""Name in uavbench's sequences, job folders and challenges, which has the columns OWN_COLUMNS."""
OWN_COLUMNS = ("stamp_ns", "file")
NERF = "transforms.json"
"""Name in the export to nerfstudio, whose images have their stamp_ns beside their poses."""
FIRST_NUMBER = re.compile(r"^\s*(\d+(?:\.\d*)?(?:e[+-]?\d+)?)\s*(?:[,;\s]|$)", re.MULTILINE | re.IGNORECASE)
"""The number that a line begins with; dates are none."""


def doubts_of_times(images: Path, rate_hz: float) -> list[str]:
    """Message on a file of times beside a folder of images, unless its times are 1 / rate_hz apart.

    DamagedFileError for one that uavbench wrote and that has changed since.
    """
    folders = (images, images.resolve().parent)
    found = [path for folder in folders for name in (OWN, NERF, *TIMES) if _has_times(path := folder / name)]
    return [
        f"{path}: seems to hold the times of the images, which are not read: the images are taken 1 / {rate_hz:g} s "
        "apart; correct the rate, or give a video or a bag with these times"
        for path in found[:1]
        if not _is_told(path, rate_hz)
    ]


def _has_times(path: Path) -> bool:
    """Whether there is such a file: OWN with its columns, unlike the results of a tracker, and NERF with stamps."""
    try:
        if path.name == NERF:
            return path.is_file() and len(_stamps_of_nerf(path)) > 0
        return path.is_file() and (path.name != OWN or set(OWN_COLUMNS) <= set(column_names(path, TABLE)))
    except DamagedFileError:
        raise
    except UserError:
        return False


def _is_told(path: Path, rate_hz: float) -> bool:
    """Whether a file has times in s, ms, us or ns that are those of a rate."""
    try:
        if path.name == NERF:
            numbers = _stamps_of_nerf(path)
        elif path.name == OWN:
            numbers = integers(path, [OWN_COLUMNS[0]])[:, 0].astype(np.float64)
        else:
            numbers = np.array(FIRST_NUMBER.findall(read_text(path, TABLE)), dtype=np.float64)
    except DamagedFileError:
        raise
    except UserError:
        return False
    steps = np.diff(numbers)
    return len(steps) > 0 and any(fits(steps / unit * rate_hz) for unit in (1.0, *UNITS))


def _stamps_of_nerf(path: Path) -> Array:
    """The stamps (n,) of the images of a transforms.json in their order; empty where it has none, as of other tools."""
    frames = read_json(path).get("frames")
    listed = [each for each in frames if isinstance(each, dict)] if isinstance(frames, list) else []
    stamps = {str(each.get("file_path")): each.get("stamp_ns") for each in listed}
    known = [stamps[name] for name in sorted(stamps)]
    return np.array(known if all(isinstance(ns, int) for ns in known) else [], dtype=np.float64)
