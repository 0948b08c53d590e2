"""Files with the times of images that lie beside them, as other tools write them; those of a folder are not read."""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from uavbench.tracker.images.image_names import UNITS, fits
from uavbench.trajectories.errors import DamagedFileError, UserError
from uavbench.trajectories.files.limits import TABLE
from uavbench.trajectories.files.reading import read_json, read_text
from uavbench.trajectories.files.tables import column_names, integers
from uavbench.trajectories.pose import Array

TIMES = ("data.csv", "rgb.txt", "times.txt", "timestamps.txt", "times.csv", "timestamps.csv")
"""Names in EuRoC, TUM RGB-D, KITTI odometry, KITTI raw and of one's own.

Beside the images or their folder, of several cameras beside the folder of their folders.
"""
OWN = "frames.csv"
"""Name in uavbench's sequences, job folders and challenges, which has the columns OWN_COLUMNS."""
OWN_COLUMNS = ("stamp_ns", "file")
NERF = "transforms.json"
"""Name in the export to nerfstudio, whose images have their stamp_ns beside their poses."""
FIRST_NUMBER = re.compile(r"^\s*(\d+(?:\.\d*)?(?:e[+-]?\d+)?)\s*(?:[,;\s]|$)", re.MULTILINE | re.IGNORECASE)
"""The number that a line begins with; dates are none."""
OFF, SINCE_1970_S = 0.5, 1e9
"""Usual steps by which a time may differ from a stamp; seconds from which on both are of one clock, from 2001 on."""


@dataclass(frozen=True)
class TimesFile:
    """A file that may hold the times of the images of a folder: of all its lines, or of those that name the folder.

    The folder above the images' parent may hold a file of several cameras, as an export to COLMAP of a rig.
    """

    path: Path
    images: Path

    @property
    def of_several(self) -> bool:
        """Whether the file counts only by the lines that name the folder of the images."""
        return self.path.parent == self.images.parent.parent

    def has_times(self) -> bool:
        """Whether there are times: in OWN with its columns, unlike the results of a tracker, and NERF with stamps."""
        try:
            if not self.path.is_file():
                return False
            if self.path.name == NERF:
                return len(self._stamps_of_nerf()) > 0
            if self.path.name == OWN:
                return not self.of_several and set(OWN_COLUMNS) <= set(column_names(self.path, TABLE))
            return not self.of_several or bool(self._lines())
        except DamagedFileError:
            raise
        except UserError:
            return False

    def has_rate(self, rate_hz: float) -> bool:
        """Whether the times, in s, ms, us or ns, are those of a rate."""
        steps = np.diff(self.numbers())
        return len(steps) > 0 and any(fits(steps / unit * rate_hz) for unit in (1.0, *UNITS))

    def has_stamps(self, stamps_ns: NDArray[np.int64]) -> bool:
        """Whether the times, in s, ms, us or ns, are these (n,), or as far apart where one side counts from 0.

        Another number of times cannot be compared, and passes.
        """
        numbers, seconds = self.numbers(), stamps_ns / 1e9
        if len(numbers) != len(seconds) or len(numbers) < 2:
            return True
        near_s = OFF * float(np.median(np.diff(seconds)))
        for unit in (1.0, *UNITS):
            zero_s = numbers[0] / unit - seconds[0]
            of_one_clock = min(numbers[0] / unit, seconds[0]) > SINCE_1970_S
            if (np.abs(numbers / unit - seconds - (0.0 if of_one_clock else zero_s)) <= near_s).all():
                return True
        return False

    def numbers(self) -> Array:
        """The times (n,) in their unit; empty where they cannot be read."""
        try:
            if self.path.name == NERF:
                return self._stamps_of_nerf()
            if self.path.name == OWN:
                return integers(self.path, [OWN_COLUMNS[0]])[:, 0].astype(np.float64)
            return np.array(FIRST_NUMBER.findall(self._lines()), dtype=np.float64)
        except DamagedFileError:
            raise
        except UserError:
            return np.empty(0)

    def _lines(self) -> str:
        """Lines that end with an image of the folder, as left/000000.png; all lines where none does."""
        text = read_text(self.path, TABLE)
        named = re.findall(rf"^(?:.*[\s,;/\\\"])?{re.escape(self.images.name)}/[^/\n]+$", text, re.MULTILINE)
        return "\n".join(named) if named or self.of_several else text

    def _stamps_of_nerf(self) -> Array:
        """The stamps (n,) of the images of a transforms.json in their order; empty where it has none."""
        frames = read_json(self.path).get("frames")
        listed = [each for each in frames if isinstance(each, dict)] if isinstance(frames, list) else []
        stamps = {str(each.get("file_path")): each.get("stamp_ns") for each in listed}
        named = [name for name in stamps if Path(name).parent.name == self.images.name]
        known = [stamps[name] for name in sorted(named if named or self.of_several else stamps)]
        return np.array(known if all(isinstance(ns, int) for ns in known) else [], dtype=np.float64)


def doubts_of_times(images: Path, rate_hz: float) -> list[str]:
    """Message on a file of times beside a folder of images, unless its times are 1 / rate_hz apart.

    DamagedFileError for one that uavbench wrote and that has changed since.
    """
    found = _beside(images)
    if found is None or found.has_rate(rate_hz):
        return []
    return [
        f"{found.path}: seems to hold the times of the images, which are not read: the images are taken 1 / "
        f"{rate_hz:g} s apart; correct the rate, or give a video or a bag with these times"
    ]


def doubts_of_own_times(images: Path, stamps_ns: NDArray[np.int64], name: str) -> list[str]:
    """Message on a file of times beside a folder whose images have other stamps (n,) by their order; name: of these.

    DamagedFileError as `doubts_of_times`.
    """
    found = _beside(images)
    if found is None or found.has_stamps(stamps_ns):
        return []
    return [
        f"{found.path}: seems to hold other times of the images than {name}, whose poses are paired with them in "
        "order: give the poses of these images alone, or name the images by their times"
    ]


def times_beside(images: Path) -> tuple[Path, ...]:
    """Files beside a folder of images that are looked at for their times."""
    return tuple(file.path for file in _places(images) if file.path.is_file())


def _beside(images: Path) -> TimesFile | None:
    """The first file of times beside a folder of images; None without one."""
    return next((file for file in _places(images) if file.has_times()), None)


def _places(images: Path) -> list[TimesFile]:
    """Files that may hold the times of the images of a folder, whether there or not, in the order of their ranks."""
    whole = images.resolve()
    names = (OWN, NERF, *TIMES)
    return [TimesFile(folder / name, whole) for folder in (whole, *whole.parents[:2]) for name in names]
