"""A sequence on disk: the contract between render, track and score.

    sequence.json   format, name, seed, rate, mount, content hash, versions
    camera.toml     the calibrated camera
    model.obj       the structure as designed, one group per planar face
    edges.csv       its true edges: vertices and the adjacent faces
    frames.csv      frame, stamp_ns, file
    groundtruth.csv       world_from_body and its rates at each frame; a recording of real images has none
    mounts.csv      cam_from_body at each frame of a camera on a gimbal
    frames/*.png    the images
    cameras/NAME/   of each camera besides the main one: camera.toml, frames.csv, groundtruth.csv, frames/*.png
    crlb.csv        Cramer-Rao bound of the camera's pose, of every n-th frame where the config asks for it
    flight.csv      the whole flight: motion, motors and wind, 100 times a second
    imu.csv ...     the readings of each body sensor, by its name
    manifest.json   sha256 of every other file

The world frame is the structure's frame: metres, z up.
"""

import hashlib
import json
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from operator import index
from pathlib import Path
from types import MappingProxyType
from typing import Any, SupportsIndex, overload

import numpy as np
from numpy.typing import NDArray

from uavbench.scenes.camera import Camera
from uavbench.scenes.dataset.disk_guards import inside
from uavbench.scenes.dataset.ground_truth_files import MOUNTS_FILE, read_ground_truth, read_mounts, read_pose_bounds
from uavbench.scenes.dataset.structure_files import load_structure
from uavbench.scenes.dataset.surfaces.annotation_images import annotation_file, mask_of, samples_of
from uavbench.scenes.dataset.surfaces.surface_files import read_flow, read_normals
from uavbench.scenes.dataset.table_files import ANEW, check_info, frame_stamps_ns, image_files, read_json, read_numbers
from uavbench.scenes.image_files import read_image
from uavbench.scenes.structure import Structure
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.limits import IMAGE
from uavbench.trajectories.files.listed import Marker
from uavbench.trajectories.files.reading import given_path, read_bytes
from uavbench.trajectories.pose import Array, Pose
from uavbench.trajectories.trajectory import Trajectory

RENDERED = Marker("manifest.json", "rendered sequence")
DEPTH_M_PER_UNIT = 0.001
"""Metres per unit of the 16-bit depth images: up to 65.5 m, 0 (unknown) beyond."""
EDGE_COLUMNS = ["edge", "u0_px", "v0_px", "u1_px", "v1_px", "visible_share", "contrast"]
"""Columns of `edges/NNNNNN.csv`: a visible part of a model edge, its ends, its fraction of the edge, its contrast."""


@dataclass(frozen=True, eq=False)
class Sequence:
    """A sequence folder opened for reading; images are read on access.

    vehicle: folder of the files that belong to no camera (readings, flight.csv), if it is another one.
    """

    folder: Path
    info: Mapping[str, Any]
    camera: Camera
    structure: Structure
    stamps_ns: NDArray[np.int64]
    files: tuple[str, ...]
    vehicle: Path | None = None

    @classmethod
    def load(cls, folder: Path) -> "Sequence":
        """Open a sequence folder; UserError naming the file that is missing or invalid."""
        info = read_json(folder / "sequence.json")
        check_info(folder / "sequence.json", info)
        files, camera = image_files(folder), _camera(folder, info)
        return cls(folder, info, camera, load_structure(folder), frame_stamps_ns(folder), files)

    def __len__(self) -> int:
        return len(self.files)

    @overload
    def __getitem__(self, frame: SupportsIndex) -> "Frame": ...

    @overload
    def __getitem__(self, frame: slice) -> list["Frame"]: ...

    def __getitem__(self, frame: SupportsIndex | slice) -> "Frame | list[Frame]":
        """A frame by index from 0, or from the end if negative, or the list of frames of a slice.

        IndexError when out of range, TypeError for anything but an integer or a slice of integers.
        """
        if isinstance(frame, slice):
            return [Frame(self, number) for number in range(len(self))[frame]]
        if isinstance(frame, bool) or not hasattr(frame, "__index__"):
            raise TypeError(
                f"sequence[{frame!r}]: give the number of a frame, or a slice of numbers as in sequence[0:2]"
            )
        number = index(frame)
        if not -len(self) <= number < len(self):
            raise IndexError(f"sequence[{number}]: {self.folder} has {len(self)} frames, numbered from 0")
        return Frame(self, number % len(self))

    def __iter__(self) -> Iterator["Frame"]:
        """The frames in order, each read on access."""
        return (Frame(self, frame) for frame in range(len(self)))

    @property
    def name(self) -> str:
        """Name of the sequence."""
        return str(self._said("name"))

    @cached_property
    def cam_from_body(self) -> Pose:
        """Mount of the camera on the vehicle; UserError for a camera on a gimbal, which has no fixed one."""
        if self.on_gimbal:
            raise UserError(f"{self.folder}: the camera is on a gimbal: {MOUNTS_FILE} has its pose at each frame")
        return self._pose("cam_from_body")

    @property
    def on_gimbal(self) -> bool:
        """Whether the camera's pose on the body changes in flight."""
        return self.info.get("cam_from_body") == MOUNTS_FILE

    @cached_property
    def mounts(self) -> Trajectory:
        """True `cam_from_body` of a camera on a gimbal at each frame."""
        table = read_mounts(self.folder, self.stamps_ns)
        return Trajectory(self.stamps_ns, table[:, :3], table[:, 3:])

    def cam_from_body_at(self, frame: int) -> Pose:
        """True pose of the camera on the body at a frame."""
        return self.mounts.pose(frame) if self.on_gimbal else self.cam_from_body

    @cached_property
    def cameras(self) -> Mapping[str, "Sequence"]:
        """The further cameras by name, each as a sequence of its own images, annotations and poses."""
        table = self.info.get("cameras", {})
        if not (isinstance(table, dict) and all(isinstance(about, dict) for about in table.values())):
            raise UserError(f"{self.folder / 'sequence.json'}: `cameras` is not a table of tables; {ANEW}")
        return MappingProxyType({name: self._camera(name, about) for name, about in table.items()})

    def _camera(self, name: str, about: Mapping[str, Any]) -> "Sequence":
        folder = inside(self.folder, f"cameras/{name}")
        info = {**self.info, **about, "cameras": {}}
        check_info(self.folder / "sequence.json", info)
        files, camera = image_files(folder), _camera(folder, info)
        stamps = frame_stamps_ns(folder)
        return Sequence(folder, info, camera, self.structure, stamps, files, vehicle=self.body_folder)

    @property
    def body_folder(self) -> Path:
        """Folder of the files that belong to no camera: the readings of the body sensors, and flight.csv."""
        return self.vehicle or self.folder

    @property
    def timeshift_cam_imu_ns(self) -> int:
        """Offset in ns from stamps of frames to those of sensors and flight: t_imu = t_cam + shift, as in Kalibr."""
        return int(self.info.get("timeshift_cam_imu_ns", 0))

    @property
    def content_hash(self) -> str:
        """Hash of everything that determines this sequence: spec, seed and referenced files."""
        return str(self._said("content_hash"))

    @property
    def images_hash(self) -> str:
        """Hash of the image files by the manifest; "" without one.

        The same config may give other images with another GL driver or CPU.
        """
        path = self.folder / "manifest.json"
        named = read_json(path).get("sha256", {}) if path.is_file() else {}
        images = sorted((name, digest) for name, digest in named.items() if name.startswith("frames/"))
        return hashlib.sha256(json.dumps(images).encode()).hexdigest() if images else ""

    def _said(self, key: str) -> Any:
        """Value of a key of `sequence.json`; UserError where it is missing."""
        if key not in self.info:
            raise UserError(f"{self.folder / 'sequence.json'}: `{key}` is missing; {ANEW}")
        return self.info[key]

    def _pose(self, key: str) -> Pose:
        """Pose of a key of `sequence.json`; UserError where it is missing or not a pose."""
        try:
            return Pose.from_matrix(self._said(key))
        except (ValueError, TypeError, OverflowError) as error:
            raise UserError(f"{self.folder / 'sequence.json'}: {key}: {error}") from None

    def image(self, frame: int) -> NDArray[np.uint8]:
        """BGR image (h, w, 3) of a frame; UserError when its file is missing, truncated or of another size."""
        return read_image(self.folder / self.files[frame], self.camera, inside=self.folder)

    def image_bytes(self, frame: int) -> bytes:
        """Content of a frame's image file; UserError when it is missing, or leads out of the folder."""
        return read_bytes(self.folder / self.files[frame], IMAGE, inside=self.folder)

    @property
    def recorded(self) -> bool:
        """Whether this is a recorded sequence of real images, with an initial pose and no ground truth."""
        return "initial_cam_from_world" in self.info

    @property
    def own_images(self) -> bool:
        """Whether its images are real ones or another renderer's, with ground truth or without."""
        return self.recorded or "ground_truth" in self.info

    @property
    def initial_cam_from_world(self) -> Pose:
        """Pose of the camera at the first frame: the true one, or, of a recorded sequence, the given initial pose."""
        return self._pose("initial_cam_from_world") if self.recorded else self.true_cam_from_world(0)

    @cached_property
    def ground_truth(self) -> Trajectory:
        """True `world_from_body` at each frame."""
        table = self.ground_truth_table
        try:
            return Trajectory(self.stamps_ns, table[:, 2:5], table[:, 5:9])
        except ValueError as error:
            raise UserError(f"{self.folder / 'groundtruth.csv'}: {error}; {ANEW}") from None

    @cached_property
    def ground_truth_table(self) -> Array:
        """All of groundtruth.csv (n, 18) in the order of GROUND_TRUTH_COLUMNS."""
        if self.recorded:
            raise UserError(f"{self.folder}: a recording of real images has no ground truth to compare with")
        return read_ground_truth(self.folder, self.stamps_ns)

    @cached_property
    def pose_bounds(self) -> dict[int, Array]:
        """Cramer-Rao bound (6, 6) of the twist of `cam_from_world`, by frame; not every frame has one (see `crlb`)."""
        return read_pose_bounds(self.folder)

    def true_cam_from_world(self, frame: int) -> Pose:
        """True pose of the camera at a frame."""
        return self.cam_from_body_at(frame) @ self.ground_truth.pose(frame).inverse()


@dataclass(frozen=True, eq=False)
class Frame:
    """A frame of a sequence with its ground truth; everything is read on access, UserError when it is missing.

    number: counted from 0. Poses are `target_from_source`, lengths in metres, the world the structure's frame.
    """

    sequence: Sequence
    number: int

    @property
    def stamp_ns(self) -> int:
        """Time of the frame, in ns."""
        return int(self.sequence.stamps_ns[self.number])

    @property
    def image(self) -> NDArray[np.uint8]:
        """BGR image (h, w, 3)."""
        return self.sequence.image(self.number)

    @property
    def world_from_body(self) -> Pose:
        """True pose of the vehicle; UserError for a recording, which has no ground truth."""
        return self.sequence.ground_truth.pose(self.number)

    @property
    def cam_from_world(self) -> Pose:
        """True pose of the camera; UserError for a recording, which has no ground truth."""
        return self.sequence.true_cam_from_world(self.number)

    @property
    def depth_m(self) -> Array | None:
        """Depth along the optical axis (h, w), 0 where unknown; None where the sequence has none."""
        path = self._file("depth")
        if path is None:
            return None
        units = samples_of(path, self.sequence.folder, self.sequence.camera, np.uint16)
        return np.asarray(units, dtype=np.float64) * float(self.sequence.info.get("depth_m_per_unit", DEPTH_M_PER_UNIT))

    @property
    def mask(self) -> NDArray[np.uint8] | None:
        """Instances (h, w): 1 structure, 2 plants, 3 people, 4 birds, 10 and up lookalikes, 0 else; None: no masks."""
        path = self._file("mask")
        return None if path is None else mask_of(path, self.sequence.folder, self.sequence.camera)

    @property
    def edges(self) -> Array | None:
        """Visible parts (n, 7) of the model's edges, columns as EDGE_COLUMNS; None where there are none."""
        path = self._file("edges", ".csv")
        return None if path is None else read_numbers(path, EDGE_COLUMNS)

    @property
    def flow_px(self) -> Array | None:
        """Optical flow (h, w, 2) in px to the next frame, NaN where unknown; None if the sequence has none."""
        path = self._file("flow")
        return None if path is None else read_flow(path, self.sequence.folder)

    @property
    def occlusion(self) -> NDArray[np.uint8] | None:
        """Surface point of each pixel (h, w) in the next frame: 0 visible, 1 occluded, 2 out of view, 3 unknown."""
        path = self._file("occlusion")
        if path is None:
            return None
        return samples_of(path, self.sequence.folder, self.sequence.camera, np.uint8).astype(np.uint8)

    @property
    def normals(self) -> Array | None:
        """Unit normals (h, w, 3) of the surface in the camera's frame, NaN without a surface; None: no normals."""
        path = self._file("normals")
        return None if path is None else read_normals(path, self.sequence.folder)

    def _file(self, kind: str, suffix: str = ".png") -> Path | None:
        return annotation_file(self.sequence.folder, kind, self.number, len(self.sequence), suffix)


def _camera(folder: Path, info: Mapping[str, Any]) -> Camera:
    """The camera of a folder, with the time in which its rows are read out where the shutter is rendered as rolling."""
    camera = Camera.load(folder / "camera.toml", inside=folder)
    return camera.with_row_delay(float(info.get("row_delay_ns", 0.0)))


def open_sequence(folder: str | Path) -> Sequence:
    """A sequence folder, for its images and ground truth: iterate over it, or take `sequence[0]` or `sequence[2:5]`.

    A `Sequence` has `.camera`, `.structure`, `.stamps_ns` (n,), `.cam_from_body` and `.ground_truth`, the true
    `world_from_body` of all frames; each `Frame` has `.image` (h, w, 3) BGR, `.stamp_ns`, `.cam_from_world`,
    `.world_from_body`, `.depth_m` (h, w), `.mask` (h, w), `.edges` (n, 7). UserError naming the file that is missing
    or invalid; UserWarning for images that are missing, as in a folder that was copied without them.

    >>> sequence = open_sequence(folder / "sequences" / "drawn-s0")
    >>> [frame.image.shape == (240, 320, 3) for frame in sequence][:2], len(sequence.ground_truth) == len(sequence)
    ([True, True], True)
    """
    sequence = Sequence.load(given_path("folder", folder))
    missing = [name for name in sequence.files if not (sequence.folder / name).is_file()]
    if missing:
        warnings.warn(
            f"{sequence.folder}: {len(missing)} of its {len(sequence)} images are missing, the first one {missing[0]}: "
            f"poses can be read, and no image; {ANEW}",
            stacklevel=2,
        )
    return sequence
