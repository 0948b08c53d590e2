"""The folder that an external tracker works in: all that a tracker may know, and never the truth.

    job.toml       mode, rate_hz, seed
    camera.toml    width height fx fy cx cy distortion_model distortion
    model.obj      the structure: vertices, triangles, one group for each planar face
    model.cao      the same as polygons, one for each planar face, as ViSP reads it
    edges.csv      its true edges: vertex_0, vertex_1, face_0, face_1 (from 0; -1: no face)
    init.toml      cam_from_model at the first frame, a 4x4 matrix

and, where the tracker gets all frames at once,

    frames.csv     stamp_ns, file
    frames/*.png   the images
    imu.csv        as the sequence has it

In the stream form images and IMU samples come on standard input, each at its time.
"""

import shutil
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from scenes.camera import Camera
from scenes.cao import write_cao
from scenes.model_files import save_structure
from scenes.sequence import Sequence as Frames
from scenes.structure import Structure
from scenes.tables import read_integers
from trajectories.files import new_folder, write_text
from trajectories.pose import Pose


@contextmanager
def job_folder() -> Iterator[Path]:
    """An empty folder away from the dataset, removed at the end."""
    with tempfile.TemporaryDirectory(prefix="uavbench-job-", ignore_cleanup_errors=True) as name:
        yield Path(name).resolve()


def write_job(
    folder: Path, structure: Structure, camera: Camera, cam_from_world: Pose, *, mode: str, rate_hz: float, seed: int
) -> None:
    """Write what both forms get."""
    write_text(folder / "job.toml", f'mode = "{mode}"\nrate_hz = {rate_hz!r}\nseed = {seed}\n')
    camera.save(folder / "camera.toml")
    save_structure(structure, folder)
    write_cao(structure, folder / "model.cao")
    rows = ",\n".join(f"    {row!r}" for row in cam_from_world.matrix.tolist())
    write_text(folder / "init.toml", f"cam_from_model = [\n{rows},\n]\n")


def write_frames(folder: Path, sequence: Frames, frames: Sequence[int]) -> None:
    """Write the images at these indices, their stamps, and the IMU; copies, so that a dataset cannot be changed."""
    (folder / "frames").mkdir()
    lines = ["stamp_ns,file\n"]
    for number, frame in enumerate(frames):
        name = f"frames/{number:06d}{Path(sequence.files[frame]).suffix}"
        (folder / name).write_bytes(sequence.image_bytes(frame))
        lines.append(f"{sequence.stamps_ns[frame]},{name}\n")
    write_text(folder / "frames.csv", "".join(lines))
    imu = sequence.body_sensor("imu.csv")
    if imu is not None:
        write_text(folder / "imu.csv", imu)


def keep(folder: Path, kept: Path, faults: Sequence[object]) -> None:
    """Keep a job folder whose run went wrong, with the faults in faults.txt; links in it are not followed."""
    with new_folder(kept) as new:
        shutil.copytree(folder, new, symlinks=True, dirs_exist_ok=True, ignore=_not_worth_keeping)
        write_text(new / "faults.txt", "".join(f"{fault}\n" for fault in faults))


def _not_worth_keeping(folder: str, names: list[str]) -> list[str]:
    """Temporary files, pipes, sockets and devices."""
    return [n for n in names if n == "tmp" or not ((p := Path(folder, n)).is_symlink() or p.is_file() or p.is_dir())]


def imu_lines(sequence: Frames) -> list[tuple[int, bytes]]:
    """Stamp and line `imu,...` of each IMU sample of a sequence, none where it has no IMU."""
    text = sequence.body_sensor("imu.csv")
    if text is None:
        return []
    stamps = read_integers(sequence.folder / "imu.csv", ["stamp_ns"])[:, 0].tolist()
    lines = [line for line in text.splitlines()[1:] if line]
    return [(stamp, f"imu,{line}\n".encode()) for stamp, line in zip(stamps, lines, strict=True)]
