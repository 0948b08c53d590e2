"""Laser range finders and lidars of a sequence for an export: their place, their turns, and points in their axes."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uavbench.scenes.dataset.sequence import Sequence
from uavbench.scenes.dataset.table_files import ANEW, read_records
from uavbench.scenes.exports.notes import sensors_of, tables_with
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.pose import Array, Pose
from uavbench.trajectories.sensors.ranging import LaserRanging

RANGE, AZIMUTH = "range_m", "azimuth_rad"
OF_LASERS = {"least_range_m", "greatest_range_m", "pitch_deg"}
"""Parameters of a laser sensor, which the other readings of a range, those of the flow deck, do not all have."""


@dataclass(frozen=True, eq=False)
class Laser:
    """A laser sensor of a sequence: the file of its readings, and its parameters by name."""

    sequence: Sequence
    file: str
    about: dict[str, Any]

    def parameter(self, key: str) -> float:
        """A number among the parameters; UserError naming the one that is missing."""
        try:
            return float(self.about[key])
        except (KeyError, ValueError, TypeError):
            raise self.mistake(f"{key}: expected a number") from None

    @property
    def on_body(self) -> Pose:
        """Pose of the sensor on the body; UserError for an invalid one."""
        try:
            x, y, z = map(float, self.about.get("offset_m", (0.0, 0.0, 0.0)))
            yaw, pitch, roll = (float(self.about.get(f"{angle}_deg", 0.0)) for angle in ("yaw", "pitch", "roll"))
            mounted = LaserRanging(offset_m=(x, y, z), yaw_deg=yaw, pitch_deg=pitch, roll_deg=roll)
            return Pose(mounted.body_from_sensor, np.array(mounted.offset_m))
        except (ValueError, TypeError) as error:
            raise self.mistake(f"its place on the body: {error}") from None

    def mistake(self, what: str) -> UserError:
        """Error that names the record of the sensor."""
        return UserError(f"{self.sequence.body_folder / 'sequence.json'}: sensors: {self.file}: {what}; {ANEW}")


@dataclass(frozen=True, eq=False)
class Turn:
    """One scan of a lidar: stamps_ns (n,), azimuths_rad (n,) and ranges_m (n, rings) of its steps, NaN: none."""

    stamps_ns: NDArray[np.int64]
    azimuths_rad: Array
    ranges_m: Array

    def points(self, elevations_rad: Array) -> Array:
        """Points (rings, n, 3) in the sensor's axes, m, each as of its own stamp; elevations_rad (rings,)."""
        a, e = self.azimuths_rad[None], elevations_rad[:, None]
        ways = np.stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e) + 0 * a], axis=-1)
        return np.asarray(ways * self.ranges_m.T[..., None])


@dataclass(frozen=True, eq=False)
class Lidar(Laser):
    """A lidar of a sequence."""

    @cached_property
    def records(self) -> NDArray[np.void]:
        """Readings (n,), a record for each step of a turn."""
        return read_records(self.sequence.body_folder / self.file)

    @property
    def rings(self) -> list[str]:
        """Columns of the ranges, from the lowest ring up."""
        return [name for name in self.records.dtype.names or () if name.startswith("range_")]

    @property
    def elevations_rad(self) -> Array:
        """Elevations (rings,) of the rings; UserError where they are not those of the file."""
        try:
            degrees = np.array(self.about["elevations_deg"], dtype=np.float64)
        except (KeyError, ValueError, TypeError):
            raise self.mistake("elevations_deg: expected a list of numbers") from None
        if degrees.shape != (len(self.rings),):
            raise self.mistake(f"elevations_deg: expected {len(self.rings)} numbers, one for each ring of the file")
        return np.radians(degrees)

    def turns(self) -> Iterator[Turn]:
        """The turns in order; one begins where the azimuth does not grow."""
        stamps, azimuths = self.records["stamp_ns"], self.records[AZIMUTH]
        ranges = np.column_stack([self.records[name] for name in self.rings])
        begins = [0, *(np.flatnonzero(np.diff(azimuths) <= 0) + 1).tolist(), len(stamps)]
        for first, end in pairwise(begins):
            yield Turn(stamps[first:end], azimuths[first:end], ranges[first:end])


def range_finders_of(sequence: Sequence) -> dict[str, Laser]:
    """The laser range finders of a sequence, by the files of their readings."""
    tables = tables_with(sequence, [RANGE], "range-finder")
    return {name: Laser(sequence, name, about) for name, about in tables.items() if set(about) >= OF_LASERS}


def lidars_of(sequence: Sequence) -> dict[str, Lidar]:
    """The lidars of a sequence, by the files of their readings."""
    arrays = {name: about for name, about in sensors_of(sequence).items() if name.endswith(".npy")}
    lidars = {name: Lidar(sequence, name, about) for name, about in arrays.items()}
    return {name: each for name, each in lidars.items() if AZIMUTH in (each.records.dtype.names or ()) and each.rings}
