"""Files with the times of images that lie beside them, as other tools write them; those of a folder are not read."""

import re
from pathlib import Path

import numpy as np

from uavbench.tracker.images.image_names import UNITS, fits
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.limits import TABLE
from uavbench.trajectories.files.reading import read_text

TIMES = ("data.csv", "rgb.txt", "times.txt", "timestamps.txt", "times.csv", "timestamps.csv")
"""Names in EuRoC, TUM RGB-D, KITTI odometry, KITTI raw and of one's own: beside the images, or beside their folder."""
FIRST_NUMBER = re.compile(r"^\s*(\d+(?:\.\d*)?(?:e[+-]?\d+)?)\s*(?:[,;\s]|$)", re.MULTILINE | re.IGNORECASE)
"""The number that a line begins with; dates are none."""


def doubts_of_times(images: Path, rate_hz: float) -> list[str]:
    """Message on a file of times beside a folder of images, unless its times are 1 / rate_hz apart."""
    found = [
        path for folder in (images, images.resolve().parent) for name in TIMES if (path := folder / name).is_file()
    ]
    return [
        f"{path}: seems to hold the times of the images, which are not read: the images are taken 1 / {rate_hz:g} s "
        "apart; correct the rate, or give a video or a bag with these times"
        for path in found[:1]
        if not _is_told(path, rate_hz)
    ]


def _is_told(path: Path, rate_hz: float) -> bool:
    """Whether a file has times in s, ms, us or ns that are those of a rate."""
    try:
        numbers = np.array(FIRST_NUMBER.findall(read_text(path, TABLE)), dtype=np.float64)
    except UserError:
        return False
    steps = np.diff(numbers)
    return len(steps) > 0 and any(fits(steps / unit * rate_hz) for unit in (1.0, *UNITS))
