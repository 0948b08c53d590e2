"""Job folder of an external tracker: everything that a tracker may know, never the ground truth.

    job.toml       mode, rate_hz, seed
    camera.toml    width height fx fy cx cy distortion_model distortion [response]
    model.obj      the structure: vertices, triangles, one group for each planar face
    model.cao      the same as polygons, one for each planar face, as ViSP reads it
    edges.csv      its true edges: vertex_0, vertex_1, face_0, face_1 (from 0; -1: no face)
    init.toml      cam_from_model at the first frame, a 4x4 matrix
    sensors.toml   cam_from_body, and each sensor of the body: its columns, rate, noise and mounting

and, in the folder form, in which the tracker gets all frames at once,

    frames.csv     stamp_ns, file
    frames/*.png   the images
    imu.csv ...    measurements of each sensor, by its name: stamp_ns and its columns

In the stream form images and sensor samples arrive on standard input in the order of their stamps. What trackers may
know of the body and its sensors is defined in `uavbench.scenes.dataset.body`.
"""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

from uavbench.scenes.camera import Camera
from uavbench.scenes.dataset.body import Body, Samples, body_of, samples_of
from uavbench.scenes.dataset.sequence import Sequence as Frames
from uavbench.scenes.dataset.structure_files import save_structure
from uavbench.scenes.model_files.cao.writing import write_cao
from uavbench.scenes.structure import Structure
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.writing import write_text
from uavbench.trajectories.pose import Pose
from uavbench.trajectories.processes.guard import Guard


def job_folder() -> Guard:
    """Context with an empty folder outside of the dataset; on exit it is removed and its processes are killed."""
    try:
        return Guard("uavbench-job-")
    except OSError as error:
        raise UserError(f"{error}; name a folder with room in TMPDIR") from None


def write_job(
    folder: Path, structure: Structure, camera: Camera, cam_from_world: Pose, *, mode: str, rate_hz: float, seed: int
) -> None:
    """Write the files of both forms, stream and folder."""
    write_text(folder / "job.toml", f'mode = "{mode}"\nrate_hz = {rate_hz!r}\nseed = {seed}\n')
    write_known(folder, structure, camera, cam_from_world)


def write_known(folder: Path, structure: Structure, camera: Camera, cam_from_world: Pose) -> None:
    """Write camera, structure and initial pose."""
    camera.save(folder / "camera.toml")
    save_structure(structure, folder)
    write_cao(structure, folder / "model.cao")
    write_text(folder / "init.toml", _matrix("cam_from_model", cam_from_world))


def write_sensors(folder: Path, body: Body) -> None:
    """Write `sensors.toml`: mounting, rates and noise of the body's sensors; no `cam_from_body` for a gimbal."""
    text = "" if body.cam_from_body is None else _matrix("cam_from_body", body.cam_from_body)
    for name, sensor in body.sensors.items():
        about = {"kind": sensor.kind, "columns": list(sensor.columns), **sensor.parameters}
        text += f"\n[sensors.{name}]\n" + "".join(f"{key} = {json.dumps(value)}\n" for key, value in about.items())
    write_text(folder / "sensors.toml", text)


def _matrix(key: str, pose: Pose) -> str:
    rows = ",\n".join(f"    {row!r}" for row in pose.matrix.tolist())
    return f"{key} = [\n{rows},\n]\n"


def write_frames(folder: Path, sequence: Frames, frames: Sequence[int]) -> None:
    """Write the images at these indices, their stamps, and the sensors' measurements up to the last of them.

    Images are copied, not linked, so that a tracker cannot modify the dataset.
    """
    (folder / "frames").mkdir()
    lines = ["stamp_ns,file\n"]
    for number, frame in enumerate(frames):
        name = f"frames/{number:06d}{Path(sequence.files[frame]).suffix}"
        (folder / name).write_bytes(sequence.image_bytes(frame))
        lines.append(f"{sequence.stamps_ns[frame]},{name}\n")
    write_text(folder / "frames.csv", "".join(lines))
    last_ns = int(sequence.stamps_ns[frames[-1]])
    for name, sensor in body_of(sequence).sensors.items():
        samples = samples_of(sequence, name, sensor).between(None, last_ns)
        rows = [",".join(("stamp_ns", *sensor.columns)), *(row for _, row in samples.rows())]
        write_text(folder / f"{name}.csv", "\n".join(rows) + "\n")


def sample_lines(samples: Mapping[str, Samples]) -> bytes:
    """Samples of all sensors as lines `NAME,stamp_ns,...`, in the order of their stamps."""
    rows = [(stamp, f"{name},{row}\n") for name, some in samples.items() for stamp, row in some.rows()]
    return "".join(line for _, line in sorted(rows, key=lambda row: row[0])).encode()
