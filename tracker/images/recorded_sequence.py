"""Recorded sequences: images of a structure whose model is known, with their true poses or with an initial one.

`record` writes them as a sequence folder. Without true poses it has no groundtruth.csv, and `sequence.json` has
`initial_cam_from_world`; with them `sequence.json` has `ground_truth`, which tells where they are from.
"""

import json
import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Literal, Protocol

import cv2
import numpy as np
from annotated_types import Ge, Interval
from numpy.typing import NDArray

from uavbench.scenes.calibrations.camera_file import told_beside
from uavbench.scenes.camera import Camera
from uavbench.scenes.dataset.disk_guards import disk_errors
from uavbench.scenes.dataset.ground_truth_files import states_of, write_ground_truth
from uavbench.scenes.dataset.structure_files import save_structure
from uavbench.scenes.dataset.verify import write_manifest
from uavbench.scenes.image_files import SUFFIXES, OneTurn, image_of, is_plain
from uavbench.scenes.model_files.referenced_files import parts_of
from uavbench.scenes.structure import Structure
from uavbench.tracker.images.camera_doubts import doubts_of_camera
from uavbench.tracker.images.image_levels import BlackImages, RepeatedImages
from uavbench.tracker.images.image_names import doubts_of_names, refuse_twins
from uavbench.tracker.images.image_times import doubts_of_times, times_beside
from uavbench.tracker.images.model_size import doubts_of_size
from uavbench.tracker.images.track_images import RATES_HZ, in_order, load_model
from uavbench.tracker.initialization import read_init
from uavbench.tracker.versions import versions
from uavbench.trajectories.bags.reading import bag_topic
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.limits import IMAGE
from uavbench.trajectories.files.listed import Marker
from uavbench.trajectories.files.origin import refuse_foreign
from uavbench.trajectories.files.reading import read_bytes
from uavbench.trajectories.files.writing import new_folder, write_text
from uavbench.trajectories.pose import Pose
from uavbench.trajectories.trajectory import Trajectory
from uavbench.trajectories.trajectory_files.export_description import description_of

VISP_IMAGES = (Path("/usr/share/visp-images-data/ViSP-images"), Path("/usr/local/share/visp-images-data/ViSP-images"))
Row = tuple[float, float, float, float]
RECORDED = Marker("manifest.json", "recorded sequence")
VISP_CUBE = "mbt/cube"


@dataclass(frozen=True, eq=False)
class Recording:
    """Image files in order, with structure, camera and initial pose; None where the true poses are known."""

    images: tuple[Path, ...]
    camera: Camera
    structure: Structure
    initial_cam_from_world: Pose | None = None


@dataclass(frozen=True, eq=False)
class GroundTruth:
    """True poses of the images of a recording, `world_from_body` at the stamp of each.

    stamps_from: what the stamps are of: the poses, the names of the images, or the rate; about: where the poses are
    from, for `sequence.json`; doubts: messages on likely mistakes in them.
    """

    world_from_body: Trajectory
    cam_from_body: Pose
    stamps_from: Literal["poses", "names", "rate"]
    about: dict[str, Any] = field(default_factory=dict)
    doubts: tuple[str, ...] = ()

    @property
    def initial_cam_from_world(self) -> Pose:
        """True pose of the camera at the first image."""
        return self.cam_from_body @ self.world_from_body.pose(0).inverse()


class RecordingSource(Protocol):
    """Source of a recording: a frozen dataclass of its parameters."""

    def find(self) -> Recording:
        """The recording; UserError naming what is missing and where to get it."""
        ...


@dataclass(frozen=True, kw_only=True)
class Files:
    """Your own files: a folder of images, a model, camera.toml and init.toml, as for `uavbench track --images`.

    init_file is left out where the recording has a `ground_truth_file`.
    """

    images_path: str
    model_file: str
    camera_file: str
    init_file: str = ""

    @property
    def entering_files(self) -> tuple[Path, ...]:
        """Files whose content enters the sequence's hash: images, their times, a shutter, what the model refers to."""
        folder = Path(self.images_path)
        images = (*images_in(folder), *times_beside(folder)) if folder.is_dir() else ()
        return (*images, *told_beside(Path(self.camera_file)), *parts_of(Path(self.model_file)))

    def find(self) -> Recording:
        """The recording."""
        camera = Camera.load(Path(self.camera_file))
        structure = load_model(Path(self.model_file))
        first = read_init(Path(self.init_file), camera, structure) if self.init_file else None
        return Recording(images_in(Path(self.images_path)), camera, structure, first)


@dataclass(frozen=True)
class VispCube:
    """218 real frames of a cube of 8.4 cm, from Debian's package visp-images-data.

    images_path: the folder `ViSP-images`, if it is not in the package's place. Camera and initial pose are those that
    come with the images.
    """

    images_path: str = ""

    @property
    def root(self) -> Path | None:
        """The folder `ViSP-images`; None if it is missing."""
        return next((place for place in self._places if (place / VISP_CUBE).is_dir()), None)

    @property
    def entering_files(self) -> tuple[Path, ...]:
        """Files whose content enters the sequence's hash: the images and their model, camera and pose."""
        root = self.root
        if root is None:
            return ()
        model = root / "mbt/cube.cao"
        return (*images_in(root / VISP_CUBE), model, *parts_of(model), root / "mbt/cube.0.pos")

    def find(self) -> Recording:
        """The recording; UserError saying what to install."""
        root = self.root
        if root is None:
            raise UserError(
                f"{self._places[0] / VISP_CUBE}: no such folder; install it: sudo apt-get install visp-images-data, "
                "or name the folder ViSP-images in images_path"
            )
        camera = Camera(640, 480, 547.7367575, 542.0744058, 338.7036994, 234.5083345)  # mbt/cube.xml
        try:
            numbers = [float(word) for word in (root / "mbt/cube.0.pos").read_text(encoding="utf-8").split()]
            if len(numbers) != 6:
                raise ValueError(f"{len(numbers)} numbers instead of 6")
        except (OSError, ValueError) as error:
            raise UserError(f"{root / 'mbt/cube.0.pos'}: not readable: {error}") from None
        turn = Pose.exp(np.array([0.0, 0.0, 0.0, *numbers[3:]])).rotation
        model = load_model(root / "mbt/cube.cao")
        return Recording(images_in(root / VISP_CUBE), camera, model, Pose(turn, np.array(numbers[:3])))

    @property
    def _places(self) -> tuple[Path, ...]:
        return (Path(self.images_path),) if self.images_path else VISP_IMAGES


RECORDINGS: dict[str, type[RecordingSource]] = {"files": Files, "visp-cube": VispCube}
"""Name -> source of recordings."""


@dataclass(frozen=True, kw_only=True)
class RecordingSpec:
    """A recorded sequence: its source, its frame rate, and its true poses, where they are known.

    ground_truth_file: a trajectory of the images in any form that `uavbench evaluate` reads; cam_from_body: the
    camera on the body, rows of a homogeneous matrix in metres, where these are poses of the body.
    """

    name: str
    seed: Annotated[int, Ge(0)]
    source: RecordingSource
    rate_hz: Annotated[float, Interval(ge=RATES_HZ[0], le=RATES_HZ[1])] = 30.0
    ground_truth_file: str = ""
    cam_from_body: tuple[Row, Row, Row, Row] | None = None

    def __post_init__(self) -> None:
        if isinstance(self.source, Files) and not (self.source.init_file or self.ground_truth_file):
            raise ValueError("source.init_file: this key is missing, and so is ground_truth_file; give one of the two")
        if isinstance(self.source, Files) and self.source.init_file and self.ground_truth_file:
            raise ValueError("source.init_file: ground_truth_file tells the initial pose, too; leave init_file out")
        if self.cam_from_body is not None and not self.ground_truth_file:
            raise ValueError("cam_from_body: is of the poses in ground_truth_file, which is missing")
        try:
            _ = self.mount
        except ValueError as error:
            raise ValueError(f"cam_from_body: {error}") from None

    @property
    def mount(self) -> Pose | None:
        """The camera's pose on the body, if it is given."""
        return None if self.cam_from_body is None else Pose.from_matrix(self.cam_from_body)

    @property
    def entering_files(self) -> tuple[Path, ...]:
        """Files whose content enters the sequence's hash beside the ground truth: its times, its mount, or its bag.

        And the export.json that tells of what its poses are.
        """
        given = Path(self.ground_truth_file)
        if not self.ground_truth_file:
            return ()
        bag = bag_topic(given)
        beside = (bag.bag,) if bag else (given.with_name("times.txt"), given.with_name("sequence.json"))
        exported = description_of(bag.bag if bag else given)
        return (*(path for path in beside if path.is_file()), *((exported,) if exported else ()))


def record(
    spec: RecordingSpec,
    folder: Path,
    *,
    content_hash: str,
    ground_truth: Callable[[Recording], GroundTruth] | None = None,
    on_frame: Callable[[int, int], None] | None = None,
) -> None:
    """Write the sequence `folder` of a recording, completely or not at all; ground_truth: finds its true poses.

    UserError when a file is missing, an image cannot be read, or the folder holds anything other than a sequence.
    """
    refuse_foreign(folder, RECORDED)
    recording = recording_of(spec.source)
    truth = ground_truth(recording) if ground_truth is not None else None
    about = {"name": spec.name, "seed": spec.seed, "rate_hz": spec.rate_hz, "content_hash": content_hash}
    write_recording(recording, truth, folder, about, on_frame)


def write_recording(
    recording: Recording,
    truth: GroundTruth | None,
    folder: Path,
    about: Mapping[str, Any],
    on_frame: Callable[[int, int], None] | None = None,
) -> None:
    """Write the sequence `folder` of a recording; about: `name`, `seed`, `rate_hz` and `content_hash` of it.

    UserError as `record`, and without an initial pose where there are no true ones.
    """
    first = recording.initial_cam_from_world if truth is None else truth.initial_cam_from_world
    if first is None:
        raise UserError(f"recording {about['name']}: has no initial pose; it takes a Pose, or a ground truth")
    rate_hz, n = float(about["rate_hz"]), len(recording.images)
    stamps_ns = stamps_of_rate(n, rate_hz) if truth is None else truth.world_from_body.stamps_ns
    timed = truth is not None and truth.stamps_from != "rate"
    place, levels, repeated = recording.images[0].parent, BlackImages(), RepeatedImages()
    alike = OneTurn()
    with disk_errors(folder), new_folder(folder, RECORDED) as new:
        (new / "frames").mkdir()
        lines = ["frame,stamp_ns,file"]
        for frame, image in enumerate(recording.images):
            data = read_bytes(image, IMAGE)
            alike.check(image, data)
            shown = image_of(image, data, recording.camera)
            levels.see(shown)
            repeated.see(shown)
            plain = is_plain(data)
            name = f"frames/{frame:06d}{image.suffix if plain else '.png'}"
            if plain:
                shutil.copyfile(image, new / name)
            else:  # a program would see it darker, or turned
                (new / name).write_bytes(cv2.imencode(".png", shown)[1].tobytes())
            lines.append(f"{frame},{stamps_ns[frame]},{name}")
            if on_frame is not None:
                on_frame(frame + 1, n)
        write_text(new / "frames.csv", "\n".join(lines) + "\n")
        replace(recording.camera, bits=0).save(new / "camera.toml")
        save_structure(recording.structure, new)
        if truth is not None:
            write_ground_truth(new, stamps_ns, states_of(truth.world_from_body))
        mount = Pose.identity() if truth is None else truth.cam_from_body
        info = {
            **about,
            "cam_from_body": mount.matrix.tolist(),
            **({"initial_cam_from_world": first.matrix.tolist()} if truth is None else {"ground_truth": truth.about}),
            "versions": versions(),
            "doubts": [
                *doubts_of_camera(recording.camera),
                *doubts_of_size(recording.structure, first),
                *(() if timed else doubts_of_names(recording.images, rate_hz)),
                *(() if timed else doubts_of_times(place, rate_hz)),
                *levels.doubts(place.name),
                *repeated.doubts(place.name),
                *(truth.doubts if truth is not None else ()),
            ],
        }
        write_text(new / "sequence.json", json.dumps(info, indent=1) + "\n")
        write_manifest(new)


def stamps_of_rate(images: int, rate_hz: float) -> NDArray[np.int64]:
    """Stamps (n,) in ns of so many images, 1 / rate_hz apart from 0 on."""
    return np.array([round(frame * 1e9 / rate_hz) for frame in range(images)], dtype=np.int64)


def recording_of(source: RecordingSource) -> Recording:
    """The recording of a source; UserError for a user's that is none, without images, or others each time."""
    if type(source) in RECORDINGS.values():
        return source.find()
    name = f"recording {type(source).__module__}:{type(source).__name__}"
    found, again = source.find(), source.find()
    several: tuple[Any, ...] = (found, again)
    for each in several:
        if not isinstance(each, Recording):
            raise UserError(f"{name}: find gives a {type(each).__name__}; it takes a Recording")
    kinds = {"camera": Camera, "structure": Structure, "initial_cam_from_world": Pose}
    for key, kind in kinds.items():
        given = getattr(found, key)
        if not isinstance(given, kind) and not (given is None and kind is Pose):
            raise UserError(f"{name}: its {key} is a {type(given).__name__}; it takes a {kind.__name__}")
    if not found.images or not all(isinstance(image, Path) for image in found.images):
        raise UserError(f"{name}: its images are no paths of files; it takes a tuple of one Path or more, in order")
    first, second = (each.initial_cam_from_world for each in (found, again))
    same = np.array_equal(first.matrix, second.matrix) if first and second else first is second
    if tuple(found.images) != tuple(again.images) or found.camera != again.camera or not same:
        raise UserError(
            f"{name}: find gives another recording each time; take images in a fixed order, as of their names"
        )
    return found


def images_in(folder: Path) -> tuple[Path, ...]:
    """Images of a folder in the order of their names; UserError when it has none, or one twice in two types."""
    try:
        found = in_order(folder)
    except OSError as error:
        raise UserError(f"{folder}: not a readable folder: {error.strerror}") from None
    if not found:
        raise UserError(f"{folder}: no images ({', '.join(SUFFIXES)}) in it")
    refuse_twins(found)
    return tuple(found)
