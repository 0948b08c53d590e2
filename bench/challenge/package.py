"""The package for participants: what a tracker may know of each sequence, and nothing else.

    package.json        the challenge's identifier, its rate, sequences and files
    README.md           description of the files, and the format of submissions
    sequence-01/        as the job folder of an external tracker (`uavbench.bench.external.job_folder`), without a seed

Images are encoded again without metadata, and all files get the same modification time.
"""

import json
import os
from collections.abc import Mapping
from pathlib import Path

import cv2

from uavbench.bench.challenge.organizer import Challenge
from uavbench.bench.external.job_folder import write_frames, write_known, write_sensors
from uavbench.scenes.dataset.body import body_of
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.scenes.dataset.table_files import ANEW
from uavbench.scenes.image_files import load_image
from uavbench.tracker.initialization import Initialization
from uavbench.tracker.run import initial_pose, stride
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.listed import Marker, tree
from uavbench.trajectories.files.writing import new_folder, write_text

PACKAGE = Marker("package.json", "package of a challenge")
NO_TIME_S = 946_684_800
"""Modification time of every file of a package: 2000-01-01, which all archive formats can represent."""
README = """# A challenge in model-based localization

Each folder `sequence-NN` holds one flight around a structure whose model is known. The task is to estimate the pose of
the camera in the model's frame for every image.

| file | what it holds |
|---|---|
| `frames.csv`, `frames/` | `stamp_ns,file`: the images and their times in ns |
| `camera.toml` | size, intrinsics in px, distortion; x right, y down, z forward, pixel centres at whole numbers |
| | of a rolling shutter `readout_ms`, from the first row to the last; stamps are those of the middle row |
| `model.obj`, `model.cao`, `edges.csv` | the structure as designed, in metres: planar faces, as polygons, its edges |
| `init.toml` | `cam_from_model` at the first image, as participants may use it |
| `sensors.toml`, `imu.csv` ... | `cam_from_body`, the sensors' calibration, and what they measured |

Send a folder with one file for each sequence, `sequence-NN.csv` or `sequence-NN.tum`:

- CSV: the header `stamp_ns,status,px_m,py_m,pz_m,qw,qx,qy,qz`, then one row for each image. `status` is `ok` or
  `lost`; the pose is `cam_from_model`.
- TUM: `timestamp_s tx ty tz qx qy qz qw`, the pose of the camera in the model's frame, or of the body where the first
  line is `# frame: world_from_body`.

For up to five runs, put these files into folders `run-1` ... `run-5`; the run with the median score counts.
`submission.toml` may hold `name = "..."`. Every image without a pose counts as failed, and so does every sequence
without a file.
"""


def write_package(out: Path, challenge: Challenge, sequences: Mapping[str, Sequence], start: Initialization) -> None:
    """Write the package of a challenge, completely or not at all; sequences: by public name."""
    with new_folder(out, PACKAGE) as new:
        write_text(new / "README.md", README)
        about = {
            "challenge": challenge.challenge,
            "rate_hz": challenge.rate_hz,
            "sequences": list(challenge.sequences),
        }
        write_text(new / PACKAGE.name, json.dumps(about, indent=1) + "\n")
        for name, sequence in sequences.items():
            (new / name).mkdir()
            _write_sequence(new / name, sequence, start, challenge.rate_hz)
    _take_times(out)


def _write_sequence(folder: Path, sequence: Sequence, start: Initialization, rate_hz: float) -> None:
    first = initial_pose(start, sequence, 0, int(sequence.info["seed"]))
    write_known(folder, sequence.structure, sequence.camera, first)
    write_sensors(folder, body_of(sequence))
    write_frames(folder, sequence, range(0, len(sequence), stride(sequence, rate_hz)))
    for path in sorted((folder / "frames").iterdir()):
        path.write_bytes(bare_png(path))


def bare_png(path: Path) -> bytes:
    """The image as PNG with the chunks IHDR, IDAT and IEND only: no text, times or colour profiles.

    UserError when it cannot be encoded.
    """
    done, encoded = cv2.imencode(".png", load_image(path, cv2.IMREAD_UNCHANGED))
    if not done:
        raise UserError(f"{path}: cannot be encoded as PNG; {ANEW}")
    return encoded.tobytes()


def _take_times(folder: Path) -> None:
    """Set the same modification time for all files and folders."""
    files = [folder / name for name in tree(folder)]
    folders = {above for file in files for above in file.parents if above.is_relative_to(folder)}
    for path in (*files, *folders):
        os.utime(path, (NO_TIME_S, NO_TIME_S))
