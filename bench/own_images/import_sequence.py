"""`uavbench.import_sequence`: images of one's own with known poses as a sequence folder."""

import warnings
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from uavbench.bench.inputs.content_hash import content_hash
from uavbench.bench.own_images.true_poses import rate_of, true_poses
from uavbench.reports.evaluation.trajectory_input import found_in
from uavbench.scenes.calibrations.camera_plausibility import implausible
from uavbench.scenes.camera import Camera
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.scenes.dataset.verify import file_hash
from uavbench.scenes.structure import Structure
from uavbench.tracker.images.recorded_sequence import Recording, images_in, write_recording
from uavbench.tracker.images.track_images import load_model
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.origin import refuse_no_folder
from uavbench.trajectories.files.reading import given_path, read_toml
from uavbench.trajectories.pose import Pose

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from uavbench.reports.evaluation.trajectory_input import Given


def import_sequence(
    out: str | Path,
    images: "str | Path | Iterable[str | Path]",
    *,
    model: str | Path | Structure,
    camera: str | Path | Camera,
    ground_truth: "Given",
    cam_from_body: "Pose | ArrayLike | None" = None,
    rate_hz: float | None = None,
) -> Sequence:
    """Write images with known poses as a new sequence folder, and open it.

    out: the folder, which must not exist yet or be empty; the sequence has its name. images: a folder, whose images are
    taken in the order of their names, or files in order. model: a file in metres, z up, or a `Structure`; camera: a
    `Camera` or its camera.toml. ground_truth: poses `world_from_cam` of the images, the world being the model's frame,
    as `evaluate` takes them: a file, an array (n, 8), a DataFrame or a `Trajectory`; a file may declare
    `cam_from_world` or `world_from_body`. cam_from_body: the camera on the body, a `Pose` or a matrix (4, 4) in metres;
    with it poses are those of the body unless their file declares others. rate_hz: of the images, where neither their
    names nor a pose for each tell their times. Motion in groundtruth.csv is that of differences of the poses.

    UserError for an invalid file, an image without a pose, a rate that is not that of the stamps, poses at which the
    first image does not show the model, and a folder with content. UserWarning for each doubt.

    >>> import uavbench as ub
    >>> drawn = ub.open_sequence(folder / "sequences" / "drawn-s0")
    >>> poses = ub.Trajectory.from_poses(drawn.stamps_ns, [frame.cam_from_world.inverse() for frame in drawn])
    >>> files = {"model": drawn.structure, "camera": drawn.folder / "camera.toml"}
    >>> made = ub.import_sequence(folder / "imported", drawn.folder / "frames", **files, ground_truth=poses)
    >>> made.name, len(made) == len(drawn), made.info["rate_hz"]
    ('imported', True, 15.0)
    """
    folder = given_path("out", out)
    _refuse_content(folder)
    structure = load_model(Path(model)) if isinstance(model, str | Path) else model
    lens = Camera.load(Path(camera)) if isinstance(camera, str | Path) else camera
    if not isinstance(lens, Camera) or not isinstance(structure, Structure):
        raise UserError("camera takes a Camera or its camera.toml, model a Structure or its file")
    if why := implausible(lens):
        raise UserError(f"camera: {why}")
    files = images_in(Path(images)) if isinstance(images, str | Path) else tuple(map(Path, images))
    if not files:
        raise UserError("images: none given; give a folder, or files in order")
    if rate_hz is not None and not 0 < rate_hz < np.inf:
        raise UserError(f"rate_hz = {rate_hz!r}: must be a positive number")
    recording = Recording(files, lens, structure)
    found = found_in(ground_truth, "ground truth")
    truth = true_poses(found, recording, cam_from_body=_pose(cam_from_body), rate_hz=rate_hz)
    about = {
        "name": folder.resolve().name,
        "seed": 0,
        "rate_hz": rate_hz or rate_of(truth.world_from_body.stamps_ns),
        "content_hash": content_hash([*map(file_hash, files)], lens, structure, truth),
    }
    write_recording(recording, truth, folder, about)
    made = Sequence.load(folder)
    for doubt in made.info["doubts"]:
        warnings.warn(doubt, stacklevel=2)
    return made


def read_mount(path: Path) -> Pose:
    """The camera's pose on the body, by a TOML file with the one key `cam_from_body`, four rows of four, in metres.

    UserError naming the file when it is missing or invalid.
    """
    values = read_toml(path)
    if set(values) != {"cam_from_body"}:
        raise UserError(f"{path}: has the keys {sorted(values)}; give cam_from_body alone, four rows of four")
    try:
        return Pose.from_matrix(values["cam_from_body"])
    except (ValueError, TypeError, OverflowError) as error:
        raise UserError(f"{path}: cam_from_body: {error}; give four rows of four numbers, in metres") from None


def _refuse_content(folder: Path) -> None:
    """UserError where something stands in the place of a new folder."""
    refuse_no_folder(folder)
    if folder.is_dir() and any(folder.iterdir()):
        raise UserError(f"{folder}: exists, and is not overwritten; name a new folder, or remove this one")


def _pose(given: Any) -> Pose | None:
    if given is None or isinstance(given, Pose):
        return given
    try:
        return Pose.from_matrix(given)
    except (ValueError, TypeError, OverflowError) as error:
        raise UserError(f"cam_from_body: {error}; give a Pose or a homogeneous matrix (4, 4)") from None
