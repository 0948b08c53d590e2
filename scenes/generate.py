"""From a spec to a sequence folder: build, fly, render, and write the ground truth."""

import json
from collections.abc import Callable
from contextlib import nullcontext
from functools import lru_cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from uavbench.scenes.dataset.annotations import row_poses, write_depth, write_edges, write_mask
from uavbench.scenes.dataset.contact_sheet import write_contact_sheet
from uavbench.scenes.dataset.crlb import FrameBounds, write_bounds
from uavbench.scenes.dataset.disk_guards import disk_errors
from uavbench.scenes.dataset.sequence import DEPTH_M_PER_UNIT, GROUND_TRUTH_COLUMNS, Sequence, write_manifest
from uavbench.scenes.dataset.spec_record import described
from uavbench.scenes.dataset.structure_files import save_structure
from uavbench.scenes.effects.registry import EFFECTS
from uavbench.scenes.rendering import context as gl
from uavbench.scenes.rendering.camera_simulator import CameraSimulator, ideal_camera, render_camera
from uavbench.scenes.rendering.radiance import encode
from uavbench.scenes.scene import Scene, build_scene
from uavbench.scenes.spec import EffectSpec, SequenceSpec
from uavbench.scenes.structure import Structure
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.writing import new_folder, refuse_foreign, write_text
from uavbench.trajectories.kernels.warm_up import prepare
from uavbench.trajectories.pose import Array, Pose
from uavbench.trajectories.random_streams import stream
from uavbench.trajectories.sensors.registry import write_flight
from uavbench.trajectories.simulation.flight import Flight, fly
from uavbench.trajectories.simulation.summary import flown_summary

LEAST_SHARE_IN_VIEW = 0.005
PNG = [cv2.IMWRITE_PNG_COMPRESSION, 1, cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_HUFFMAN_ONLY]
PNG += [cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_AVG]
"""For noisy images smaller than the default, and twice as fast."""


def generate(
    spec: SequenceSpec, folder: Path, *, content_hash: str, on_frame: Callable[[int, int], None] | None = None
) -> None:
    """Write the sequence `folder`, whole or not at all; on_frame(frames done, total) reports progress.

    UserError when the flight fails, the structure is out of the first view, no GL context can be made, the disk is
    full, or the folder holds something else than a sequence.
    """
    refuse_foreign(folder, "manifest.json")
    prepare(__name__)
    scene = build_scene(spec)
    flight = fly(spec.flight, spec.mount, scene.obstacles, spec.seed)
    camera = spec.camera.camera()
    pinhole, lens = render_camera(camera, max((getattr(e, "margin_px", 0) for e in spec.effects), default=0))
    path = camera_path(flight, spec.mount.cam_from_body)
    with (
        disk_errors(folder),
        new_folder(folder, "manifest.json") as new,
        scene.renderer(pinhole.width, pinhole.height) as renderer,
        FrameBounds(scene.renderer, camera, path, spec.effects, spec.camera.lens_blur_px)
        if spec.crlb_every
        else nullcontext() as limit,
    ):
        ideal = ideal_camera(renderer, camera, pinhole, lens, path, spec.camera.lens_blur_px)
        check_first_view(spec, ideal)
        source = with_effects(ideal, spec.effects, spec.seed)
        rows = _write_frames(new, spec, source, flight, scene.built.structure, limit, on_frame)
        _write_ground_truth(new, flight, rows)
        _, *readings = write_flight(flight, spec.sensors, scene.obstacles, spec.seed, new)
        camera.save(new / "camera.toml")
        save_structure(scene.built.structure, new)
        summary = flown_summary(spec.flight, spec.mount, scene.obstacles, spec.seed, flight)
        more = {"flight": summary.to_json(), "sensors": _by_file(spec, readings), "content_hash": content_hash}
        _write_info(new, spec, scene, source, more)
        write_contact_sheet(Sequence.load(new), new / "contact_sheet.jpg")
        write_manifest(new)


class Motion(Protocol):
    """World_from_body at the rows of a flight, which may still be growing."""

    @property
    def stamps_ns(self) -> NDArray[np.int64]:
        """Stamps of the rows, those to come among them."""
        ...

    def __len__(self) -> int:
        """Rows that there are."""
        ...

    def pose(self, row: int) -> Pose:
        """Pose of a row."""
        ...


def camera_path(flight: Motion, cam_from_body: Pose) -> Callable[[int], Pose]:
    """cam_from_world at any time: constant twist between the rows of a flight, and beyond its ends."""
    stamps = flight.stamps_ns

    @lru_cache(maxsize=8)
    def start_and_twist(row: int) -> tuple[Pose, Array]:
        world_from_body = flight.pose(row)
        return world_from_body, (world_from_body.inverse() @ flight.pose(row + 1)).log()

    def at(stamp_ns: int) -> Pose:
        rows = len(flight)
        if rows == 1:
            return cam_from_body @ flight.pose(0).inverse()
        row = int(np.clip(np.searchsorted(stamps[:rows], stamp_ns, side="right") - 1, 0, rows - 2))
        world_from_body, twist = start_and_twist(row)
        share = (stamp_ns - int(stamps[row])) / int(stamps[row + 1] - stamps[row])
        if share != 0.0:
            world_from_body = world_from_body @ Pose.exp(share * twist)
        return cam_from_body @ world_from_body.inverse()

    return at


def with_effects(source: CameraSimulator, effects: tuple[EffectSpec, ...], seed: int) -> CameraSimulator:
    """The source with the effects on it, in the order of `EFFECTS`, each with its own stream."""
    order = list(EFFECTS.values())
    ranked = sorted(effects, key=lambda e: order.index(type(e)) if type(e) in order else len(order))
    seen: dict[str, int] = {}
    for effect in ranked:
        name = type(effect).__name__
        seen[name] = seen.get(name, -1) + 1
        source = effect.start(source, stream(seed, "effect", name, seen[name]))
    return source


def check_first_view(spec: SequenceSpec, source: CameraSimulator) -> None:
    """UserError when the structure fills less than LEAST_SHARE_IN_VIEW of the first image."""
    share = float((source.render(0).instances == 1).mean())
    if share < LEAST_SHARE_IN_VIEW:
        raise UserError(
            f"sequence {spec.name}: frame 0: the structure fills {100 * share:.2f} % of the image, less than "
            f"{100 * LEAST_SHARE_IN_VIEW:g} %; begin nearer to it, or turn the mount or the path towards it"
        )


def _write_frames(
    folder: Path,
    spec: SequenceSpec,
    source: CameraSimulator,
    flight: Flight,
    structure: Structure,
    limit: FrameBounds | None,
    on_frame: Callable[[int, int], None] | None,
) -> NDArray[np.int64]:
    """Write images, frames.csv and the annotations of each frame; returns the flight's rows of frames that arrived."""
    rows = flight.frame_rows(spec.rate_hz)
    (folder / "frames").mkdir()
    arrived: list[int] = []
    row_ground_truth: list[Array] = []
    bounds: dict[int, Array] = {}
    lines = ["frame,stamp_ns,file"]
    for number, row in enumerate(rows.tolist()):
        stamp_ns = int(flight.stamps_ns[row])
        light = source.image(stamp_ns)
        if light is not None:
            frame, image = len(arrived), encode(light)
            name = f"frames/{frame:06d}.png"
            _write_image(folder / name, image)
            lines.append(f"{frame},{stamp_ns},{name}")
            arrived.append(row)
            if spec.annotations:
                _write_annotations(folder, spec, frame, source, structure, image, stamp_ns)
            if source.row_delay_ns:
                row_ground_truth.append(row_poses(source, _world_from_body(source, spec), stamp_ns))
            if limit and frame % spec.crlb_every == 0 and (P := limit.covariance(image, stamp_ns)) is not None:
                bounds[frame] = P
        if on_frame is not None:
            on_frame(number + 1, len(rows))
    write_text(folder / "frames.csv", "\n".join(lines) + "\n")
    if row_ground_truth:
        np.save(folder / "row_poses.npy", np.array(row_ground_truth))
    if limit is not None:
        write_bounds(folder, bounds)
    return np.array(arrived, dtype=np.int64)


def _write_annotations(
    folder: Path,
    spec: SequenceSpec,
    frame: int,
    source: CameraSimulator,
    structure: Structure,
    image: NDArray[np.uint8],
    stamp_ns: int,
) -> None:
    view = source.render(stamp_ns)
    if "depth" in spec.annotations:
        write_depth(folder, frame, source, view)
    if "mask" in spec.annotations:
        write_mask(folder, frame, source, view)
    if "edges" in spec.annotations:
        write_edges(folder, frame, source, view, structure, image)


def _world_from_body(source: CameraSimulator, spec: SequenceSpec) -> Callable[[int], Pose]:
    return lambda stamp_ns: source.cam_from_world(stamp_ns).inverse() @ spec.mount.cam_from_body


def _write_image(path: Path, image: NDArray[np.uint8]) -> None:
    done, data = cv2.imencode(".png", image, PNG)
    if not done:
        raise RuntimeError(f"{path.name}: OpenCV cannot encode the image")
    path.write_bytes(data.tobytes())


def _write_ground_truth(folder: Path, flight: Flight, rows: NDArray[np.int64]) -> None:
    values = np.hstack(
        [
            flight.positions_m[rows],
            flight.quaternions_wxyz[rows],
            flight.velocities_m_s[rows],
            flight.angular_velocities_rad_s[rows],
            flight.accelerations_m_s2[rows],
        ]
    ).tolist()
    stamps = flight.stamps_ns[rows].tolist()
    lines = [",".join(map(repr, [i, stamp, *row])) for i, (stamp, row) in enumerate(zip(stamps, values, strict=True))]
    write_text(folder / "groundtruth.csv", "\n".join([",".join(GROUND_TRUTH_COLUMNS), *lines]) + "\n")


def _by_file(spec: SequenceSpec, readings: list[str]) -> dict[str, Any]:
    """Parameters of each sensor, by the file of its readings."""
    return {name: described(sensor) for name, sensor in zip(readings, spec.sensors, strict=True)}


def _write_info(folder: Path, spec: SequenceSpec, scene: Scene, source: CameraSimulator, more: dict[str, Any]) -> None:
    try:
        own = version("uavbench")
    except PackageNotFoundError:
        own = "not installed"
    info = {
        "name": spec.name,
        "seed": spec.seed,
        "rate_hz": spec.rate_hz,
        "cam_from_body": spec.mount.cam_from_body.matrix.tolist(),
        "row_delay_ns": source.row_delay_ns,
        "depth_m_per_unit": DEPTH_M_PER_UNIT,
        "deviation": scene.built.deviation,
        "config": described(spec),
        **more,
        "versions": {"uavbench": own, "numpy": np.__version__, "opencv": cv2.__version__, "gl": gl.version()},
    }
    write_text(folder / "sequence.json", json.dumps(info, indent=1) + "\n")
