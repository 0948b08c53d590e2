"""Writes the frames of one camera along a flight: images, stamps, ground truth, annotations."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from uavbench.scenes.camera_path import camera_path
from uavbench.scenes.dataset.annotations import as_camera, row_poses, write_depth, write_edges, write_mask
from uavbench.scenes.dataset.crlb import FrameBounds, write_bounds
from uavbench.scenes.dataset.gimbal_files import write_mounts
from uavbench.scenes.dataset.ground_truth_files import write_ground_truth
from uavbench.scenes.dataset.surfaces.surface_truth import SurfaceFiles
from uavbench.scenes.png.encoder import png
from uavbench.scenes.rendering.camera_simulator import CameraSimulator
from uavbench.scenes.spec import SequenceSpec
from uavbench.scenes.structure import Structure
from uavbench.trajectories.camera_clock import Exposures
from uavbench.trajectories.files.writing import full_disk_told, write_text
from uavbench.trajectories.flight_record import Flight
from uavbench.trajectories.gimbal.motion import GimbalMotion
from uavbench.trajectories.pose import Array, Pose
from uavbench.trajectories.sensors.sensor import sampled


@dataclass(frozen=True, eq=False, kw_only=True)
class Filming:
    """A camera in flight: its simulator and mount, the structure in view, and the ground truth derived from frames.

    mount: `cam_from_body` at a time (ns); surfaces: writer of what the rays of pixels meet.
    """

    source: CameraSimulator
    mount: Callable[[int], Pose]
    structure: Structure
    limit: FrameBounds | None = None
    surfaces: SurfaceFiles | None = None


def write_frames(
    folder: Path,
    spec: SequenceSpec,
    filming: Filming,
    flight: Flight,
    exposures: Exposures,
    on_frame: Callable[[], None],
) -> None:
    """Write images, frames.csv, groundtruth.csv and the annotations of each frame into a folder."""
    (folder / "frames").mkdir(parents=True)
    source, limit = filming.source, filming.limit
    arrived: list[int] = []
    row_ground_truth: list[Array] = []
    row_mounts: list[Array] = []
    bounds: dict[int, Array] = {}
    lines = ["frame,stamp_ns,file"]
    for number, (time_ns, stamp_ns) in enumerate(
        zip(exposures.times_ns.tolist(), exposures.stamps_ns.tolist(), strict=True)
    ):
        image = source.frame(time_ns)
        if image is not None:
            frame = len(arrived)
            name = f"frames/{frame:06d}.png"
            write_image(folder / name, image)
            lines.append(f"{frame},{stamp_ns},{name}")
            arrived.append(number)
            write_annotations(folder, spec, frame, filming, image, time_ns)
            if source.row_delay_ns:
                row_ground_truth.append(row_poses(source, _world_from_body(filming), time_ns))
                if isinstance(filming.mount, GimbalMotion):
                    row_mounts.append(row_poses(source, filming.mount, time_ns))
            if limit and frame % spec.crlb_every == 0 and (P := limit.covariance(image, time_ns)) is not None:
                bounds[frame] = P
        on_frame()
    write_text(folder / "frames.csv", "\n".join(lines) + "\n")
    if row_ground_truth:
        _save(folder / "row_poses.npy", row_ground_truth)
    if isinstance(filming.mount, GimbalMotion):
        write_mounts(folder, filming.mount, exposures.times_ns[arrived], exposures.stamps_ns[arrived])
    if row_mounts:
        _save(folder / "row_mounts.npy", row_mounts)
    if limit is not None:
        write_bounds(folder, bounds)
    write_ground_truth(folder, exposures.stamps_ns[arrived], states_at(flight, exposures.times_ns[arrived]))


def _save(path: Path, rows: list[Array]) -> None:
    with full_disk_told(path):
        np.save(path, np.array(rows))


def write_annotations(
    folder: Path, spec: SequenceSpec, frame: int, filming: Filming, image: NDArray[np.uint8], time_ns: int
) -> None:
    """Write the annotations that a spec requests of a frame exposed at time_ns."""
    asked, source = set(spec.annotations), filming.source
    if filming.surfaces is not None:
        asked -= filming.surfaces.annotations
    if {"depth", "mask", "edges"} & asked:
        view = source.render(time_ns)
        if "depth" in asked:
            write_depth(folder, frame, as_camera(source, view.depth))
        if "mask" in asked:
            write_mask(folder, frame, as_camera(source, view.instances))
        if "edges" in asked:
            write_edges(folder, frame, source, view, filming.structure, image)
    if filming.surfaces is not None:
        seen = filming.surfaces.write(frame, time_ns)
        if seen is not None and "depth" in filming.surfaces.annotations:
            write_depth(folder, frame, seen.depth_m)
        if seen is not None and "mask" in filming.surfaces.annotations:
            write_mask(folder, frame, seen.instances)


def write_image(path: Path, image: NDArray[np.uint8]) -> None:
    """Write an image (h, w, 3) as PNG."""
    path.write_bytes(png(image))


def states_at(flight: Flight, times_ns: NDArray[np.int64]) -> Array:
    """States (n, 16) of the body at times: the columns of groundtruth.csv from px_m on.

    Taken from the record at its rows; between rows the pose is interpolated with constant twist, as the camera's, and
    velocities, rates and accelerations linearly.
    """
    record = np.hstack(
        [
            flight.positions_m,
            flight.quaternions_wxyz,
            flight.velocities_m_s,
            flight.angular_velocities_rad_s,
            flight.accelerations_m_s2,
        ]
    )
    states = sampled(flight, record, times_ns) if len(times_ns) else np.zeros((0, record.shape[1]))
    body_from_world = camera_path(flight, Pose.identity())
    for i in np.flatnonzero(~np.isin(times_ns, flight.stamps_ns)).tolist():
        pose = body_from_world(int(times_ns[i])).inverse()
        q = pose.quaternion_wxyz
        states[i, :3] = pose.translation
        states[i, 3:7] = q if q @ states[i, 3:7] >= 0 else -q
    return states


def _world_from_body(filming: Filming) -> Callable[[int], Pose]:
    return lambda time_ns: filming.source.cam_from_world(time_ns).inverse() @ filming.mount(time_ns)
