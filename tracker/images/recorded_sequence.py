"""Recorded sequences: real images of a structure whose model and initial pose are known, and no ground truth.

`record` writes them as a sequence folder without groundtruth.csv; `sequence.json` has `initial_cam_from_world`.
"""

import json
import shutil
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Protocol

import cv2
import numpy as np
from annotated_types import Ge, Interval

from uavbench.scenes.camera import Camera
from uavbench.scenes.dataset.disk_guards import disk_errors
from uavbench.scenes.dataset.structure_files import save_structure
from uavbench.scenes.dataset.verify import write_manifest
from uavbench.scenes.image_files import SUFFIXES, is_plain, read_image
from uavbench.scenes.model_files.referenced_files import parts_of
from uavbench.scenes.structure import Structure
from uavbench.tracker.images.camera_doubts import doubts_of_camera
from uavbench.tracker.images.image_levels import BlackImages, RepeatedImages
from uavbench.tracker.images.image_names import doubts_of_names, refuse_twins
from uavbench.tracker.images.image_times import doubts_of_times
from uavbench.tracker.images.model_size import doubts_of_size
from uavbench.tracker.images.track_images import RATES_HZ, in_order, load_model
from uavbench.tracker.initialization import read_init
from uavbench.tracker.versions import versions
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.limits import IMAGE
from uavbench.trajectories.files.listed import Marker
from uavbench.trajectories.files.origin import refuse_foreign
from uavbench.trajectories.files.reading import read_bytes
from uavbench.trajectories.files.writing import new_folder, write_text
from uavbench.trajectories.pose import Pose

VISP_IMAGES = (Path("/usr/share/visp-images-data/ViSP-images"), Path("/usr/local/share/visp-images-data/ViSP-images"))
RECORDED = Marker("manifest.json", "recorded sequence")
VISP_CUBE = "mbt/cube"


@dataclass(frozen=True, eq=False)
class Recording:
    """Image files in order, with structure, camera and initial pose."""

    images: tuple[Path, ...]
    camera: Camera
    structure: Structure
    initial_cam_from_world: Pose


class RecordingSource(Protocol):
    """Source of a recording: a frozen dataclass of its parameters."""

    def find(self) -> Recording:
        """The recording; UserError naming what is missing and where to get it."""
        ...


@dataclass(frozen=True, kw_only=True)
class Files:
    """Your own files: a folder of images, a model, camera.toml and init.toml, as for `uavbench track --images`."""

    images_path: str
    model_file: str
    camera_file: str
    init_file: str

    @property
    def entering_files(self) -> tuple[Path, ...]:
        """Files whose content enters the sequence's hash: the images, and those that the model refers to."""
        folder = Path(self.images_path)
        return (*(images_in(folder) if folder.is_dir() else ()), *parts_of(Path(self.model_file)))

    def find(self) -> Recording:
        """The recording."""
        camera = Camera.load(Path(self.camera_file))
        structure = load_model(Path(self.model_file))
        first = read_init(Path(self.init_file), camera, structure)
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
    """A recorded sequence: its source and its frame rate."""

    name: str
    seed: Annotated[int, Ge(0)]
    source: RecordingSource
    rate_hz: Annotated[float, Interval(ge=RATES_HZ[0], le=RATES_HZ[1])] = 30.0


def record(
    spec: RecordingSpec, folder: Path, *, content_hash: str, on_frame: Callable[[int, int], None] | None = None
) -> None:
    """Write the sequence `folder` of a recording, completely or not at all.

    UserError when a file is missing, an image cannot be read, or the folder holds anything other than a sequence.
    """
    refuse_foreign(folder, RECORDED)
    recording = recording_of(spec.source)
    place, levels, repeated = recording.images[0].parent, BlackImages(), RepeatedImages()
    with disk_errors(folder), new_folder(folder, RECORDED) as new:
        (new / "frames").mkdir()
        lines = ["frame,stamp_ns,file"]
        for frame, image in enumerate(recording.images):
            shown = read_image(image, recording.camera)
            levels.see(shown)
            repeated.see(shown)
            plain = is_plain(read_bytes(image, IMAGE))
            name = f"frames/{frame:06d}{image.suffix if plain else '.png'}"
            if plain:
                shutil.copyfile(image, new / name)
            else:  # a program would see it darker, or turned
                (new / name).write_bytes(cv2.imencode(".png", shown)[1].tobytes())
            lines.append(f"{frame},{round(frame * 1e9 / spec.rate_hz)},{name}")
            if on_frame is not None:
                on_frame(frame + 1, len(recording.images))
        write_text(new / "frames.csv", "\n".join(lines) + "\n")
        replace(recording.camera, bits=0).save(new / "camera.toml")
        save_structure(recording.structure, new)
        info = {
            "name": spec.name,
            "seed": spec.seed,
            "rate_hz": spec.rate_hz,
            "cam_from_body": np.eye(4).tolist(),
            "initial_cam_from_world": recording.initial_cam_from_world.matrix.tolist(),
            "content_hash": content_hash,
            "versions": versions(),
            "doubts": [
                *doubts_of_camera(recording.camera),
                *doubts_of_size(recording.structure, recording.initial_cam_from_world),
                *doubts_of_names(recording.images, spec.rate_hz),
                *doubts_of_times(place, spec.rate_hz),
                *levels.doubts(place.name),
                *repeated.doubts(place.name),
            ],
        }
        write_text(new / "sequence.json", json.dumps(info, indent=1) + "\n")
        write_manifest(new)


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
        if not isinstance(given := getattr(found, key), kind):
            raise UserError(f"{name}: its {key} is a {type(given).__name__}; it takes a {kind.__name__}")
    if not found.images or not all(isinstance(image, Path) for image in found.images):
        raise UserError(f"{name}: its images are no paths of files; it takes a tuple of one Path or more, in order")
    same = np.array_equal(found.initial_cam_from_world.matrix, again.initial_cam_from_world.matrix)
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
