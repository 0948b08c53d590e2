"""The body as provided to trackers: the camera mount, the sensors, and their samples.

Everything that a tracker receives of a sequence besides images, camera, structure and initial pose comes from here,
by a whitelist: of a sensor's file the columns that its class names in `measured`, of its parameters those in a data
sheet or calibration. True values in the same files, such as the biases of an IMU, are never passed on.
"""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from uavbench.scenes.dataset.disk_guards import inside
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.scenes.dataset.table_files import ANEW, read_readings, read_records
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.limits import TABLE
from uavbench.trajectories.files.tables import column_names
from uavbench.trajectories.gimbal.encoder import Encoder
from uavbench.trajectories.gimbal.gimbal import Gimbal
from uavbench.trajectories.gimbal.pointing import Axes
from uavbench.trajectories.pose import Array, Pose
from uavbench.trajectories.sensors.registry import NAME, SENSORS, SEQUENCE_FILES

OF_THE_SCENE = frozenset({"reflectance"})
"""Parameters of a sensor model that describe the scene and are in no data sheet."""
OF_GIMBALS = frozenset({"joints", *(f.name for f in fields(Encoder))})
"""Parameters of a gimbal besides its place on the body, which other sensors have, too."""
CALIBRATED = frozenset(f.name for kind in SENSORS.values() for f in fields(kind) if f.init) - OF_THE_SCENE | OF_GIMBALS  # type: ignore[arg-type]
"""Parameters of a sensor that trackers may use: rates, noise, ranges and positions on the body."""
GIMBAL = "gimbal"
"""Kind of the encoders of a gimbal, and name of those of the main camera's."""
TRUTH = "_truth"
"""End of the name of a file that holds the ground truth of readings (`sensors.registry.write_flight`)."""


@dataclass(frozen=True, eq=False)
class BodySensor:
    """A sensor on the body: its kind, the `columns` of what it measures, with their units, and its parameters by name.

    The parameters are those of a data sheet or calibration: rate_hz, noise densities, offset_m on the body.
    """

    kind: str
    columns: tuple[str, ...]
    parameters: Mapping[str, Any]


@dataclass(frozen=True, eq=False)
class Body:
    """The body that carries the camera: `cam_from_body`, and its sensors by name.

    A camera on a gimbal has no fixed `cam_from_body`: it is None, and `gimbal.cam_from_body_at` gives it for the angles
    that the sensor `gimbal` (`gimbal-NAME` of the further camera NAME) measures.
    """

    cam_from_body: Pose | None
    sensors: Mapping[str, BodySensor]
    gimbal: Gimbal | None = None


class StampedRow(NamedTuple):
    """A CSV row, and its stamp."""

    stamp_ns: int
    row: str


@dataclass(frozen=True, eq=False)
class Samples:
    """Samples of one sensor: stamps_ns (n,) int64, values (n, k) in the order of its columns, NaN where none."""

    stamps_ns: NDArray[np.int64]
    values: Array

    def __len__(self) -> int:
        return len(self.stamps_ns)

    def between(self, after_ns: int | None, upto_ns: int) -> "Samples":
        """Copy of the samples with after_ns < stamp <= upto_ns; after_ns None: from the first one."""
        first = 0 if after_ns is None else int(np.searchsorted(self.stamps_ns, after_ns, side="right"))
        last = int(np.searchsorted(self.stamps_ns, upto_ns, side="right"))
        return Samples(self.stamps_ns[first:last].copy(), self.values[first:last].copy())

    def rows(self) -> Iterator[StampedRow]:
        """Stamp and CSV row of each sample; numbers round-trip exactly, an empty cell is no measurement."""
        for stamp, row in zip(self.stamps_ns.tolist(), self.values.tolist(), strict=True):
            yield StampedRow(stamp, ",".join((str(stamp), *("" if value != value else repr(value) for value in row))))


class Feed:
    """Samples of a sequence in order of time; each is delivered once, and not before its stamp."""

    def __init__(self, sequence: Sequence) -> None:
        self.body = body_of(sequence)
        self._samples = {name: samples_of(sequence, name, sensor) for name, sensor in self.body.sensors.items()}
        self._given_ns: int | None = None

    def upto(self, stamp_ns: int) -> Mapping[str, Samples]:
        """Samples by sensor that were not delivered before, up to and including a stamp (ns)."""
        new = {name: samples.between(self._given_ns, stamp_ns) for name, samples in self._samples.items()}
        self._given_ns = stamp_ns
        return MappingProxyType(new)


def body_of(sequence: Sequence) -> Body:
    """The body of a sequence, with the sensors that it has files of; UserError naming an invalid file."""
    sensors = MappingProxyType(dict(_sensors(sequence)))
    if not sequence.on_gimbal:
        return Body(sequence.cam_from_body, sensors)
    return Body(None, sensors, _gimbal_of(sequence))


def gimbal_joints(about: Mapping[str, Any]) -> list[str]:
    """Joints of a gimbal by its parameters in `sequence.json`, from the body to the camera; ValueError for others."""
    joints = about.get("joints")
    if not isinstance(joints, list) or "-".join(map(str, joints)) not in get_args(Axes):
        raise ValueError(f"joints {joints!r} of a gimbal: expected yaw, roll, pitch, or the last of these")
    return joints


def _gimbal_of(sequence: Sequence) -> Gimbal:
    """Geometry of the gimbal of a sequence's camera."""
    name = f"{GIMBAL}.csv" if sequence.vehicle is None else f"{GIMBAL}-{sequence.folder.name}.csv"
    try:
        about = sequence.info["sensors"][name]
        axes: Any = "-".join(gimbal_joints(about))
        x, y, z = map(float, about["offset_m"])
        return Gimbal(axes=axes, yaw_deg=float(about["yaw_deg"]), offset_m=(x, y, z))
    except (KeyError, ValueError, TypeError) as error:
        raise UserError(f"{sequence.folder / 'sequence.json'}: sensors: {name}: {error}; {ANEW}") from None


def samples_of(sequence: Sequence, name: str, sensor: BodySensor) -> Samples:
    """All measurements of a sensor of a sequence; UserError naming file and line of an invalid one."""
    binary = inside(sequence.body_folder, f"{name}.npy")
    path = binary if binary.is_file() else inside(sequence.body_folder, f"{name}.csv")
    if path is not binary:
        return Samples(*read_readings(path, list(sensor.columns), gaps=True))
    records = read_records(path)
    stamps = records["stamp_ns"]
    if (np.diff(stamps) <= 0).any():
        raise UserError(f"{path}: its stamps do not increase; {ANEW}")
    return Samples(stamps, np.column_stack([records[column] for column in sensor.columns]))


def _sensors(sequence: Sequence) -> Iterator[tuple[str, BodySensor]]:
    sensors = sequence.info.get("sensors", {})
    if not (isinstance(sensors, dict) and all(isinstance(about, dict) for about in sensors.values())):
        raise UserError(f"{sequence.folder / 'sequence.json'}: sensors: expected tables by file; {ANEW}")
    folder = sequence.body_folder
    for path in sorted((*folder.glob("*.csv"), *folder.glob("*.npy"))):
        about = sensors.get(path.name, {})
        kind = str(about.get("kind", _kind_by_name(path)))
        told_of = about.get("measured", ())
        known = getattr(SENSORS.get(kind), "measured", told_of if isinstance(told_of, list) else ())
        if path.stem in SEQUENCE_FILES or (path.name not in sensors and path.stem.endswith(TRUTH)):
            continue
        if path.name not in sensors and not known and (near := _kind_meant(path)):
            raise UserError(
                f"{path}: looks like readings of the sensor {near}, but is not in `sensors` of sequence.json; name it "
                f"{near}-2{path.suffix}, or in another way if it holds something else"
            )
        if not known or not NAME.fullmatch(path.stem):
            continue
        header = _columns(folder, path)
        parameters = {k: v for k, v in about.items() if k in CALIBRATED and isinstance(v, int | float | list)}
        columns = tuple(column for column in known if column in header)
        if not columns:
            raise UserError(
                f"{path}: none of its columns is one of {kind} readings ({', '.join(known)}); rename its columns, or "
                "the file if it holds something else"
            )
        yield path.stem, BodySensor(kind, columns, MappingProxyType(parameters))


def _columns(folder: Path, path: Path) -> tuple[str, ...]:
    if path.suffix == ".csv":
        return tuple(column_names(path, TABLE, inside=folder))
    return read_records(inside(folder, path.name)).dtype.names or ()


def _kind_by_name(path: Path) -> str:
    """Kind of a sensor by the name of its file, as `sensors.registry.named` gives it: `imu`, `imu-2`."""
    return path.stem if path.stem in SENSORS else re.sub(r"-[0-9]+$", "", path.stem)


def _kind_meant(path: Path) -> str:
    """Longest kind of a sensor with which the name of a file begins, as `imu` does that of `IMU_0`; "" for none."""
    return max((kind for kind in SENSORS if path.stem.lower().startswith(kind)), key=len, default="")
