"""From a spec to a sequence folder: build, fly, render, and write the ground truth."""

import json
from collections.abc import Callable
from importlib.metadata import PackageNotFoundError, version
from itertools import count
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from uavbench.scenes.dataset.contact_sheet import write_contact_sheet
from uavbench.scenes.dataset.disk_guards import disk_errors
from uavbench.scenes.dataset.gimbal_files import cam_from_body_record, gimbal_file, write_readings
from uavbench.scenes.dataset.sequence import DEPTH_M_PER_UNIT, RENDERED, Sequence
from uavbench.scenes.dataset.spec_record import described
from uavbench.scenes.dataset.structure_files import save_structure
from uavbench.scenes.dataset.table_files import FORMAT
from uavbench.scenes.dataset.verify import write_manifest
from uavbench.scenes.filming.film import Footage, film
from uavbench.scenes.png.encoder import ENCODING
from uavbench.scenes.renderables import Confines
from uavbench.scenes.rendering import context as gl
from uavbench.scenes.scene import Scene, build_scene
from uavbench.scenes.shots.cameras import cameras_of
from uavbench.scenes.shots.shots import shots_of
from uavbench.scenes.spec import BodyCamera, SequenceSpec
from uavbench.trajectories.camera_mount import MAIN
from uavbench.trajectories.files.origin import refuse_foreign
from uavbench.trajectories.files.writing import new_folder, write_text
from uavbench.trajectories.gimbal.motion import GimbalMotion
from uavbench.trajectories.kernels.warm_up import prepare
from uavbench.trajectories.sensors.registry import write_flight
from uavbench.trajectories.simulation.flight import fly
from uavbench.trajectories.simulation.summary import flown_summary


def generate(
    spec: SequenceSpec, folder: Path, *, content_hash: str, on_frame: Callable[[int, int], None] | None = None
) -> None:
    """Write the sequence `folder` atomically; on_frame(frames done, total) reports progress.

    UserError when the flight fails, the first image does not show the structure, no GL context can be made, the disk is
    full, or the folder holds anything other than a sequence.
    """
    refuse_foreign(folder, RENDERED)
    prepare(__name__)
    scene = build_scene(spec)
    flight = fly(spec.flight, spec.mount.at_rest, scene.obstacles, spec.seed)
    cameras = cameras_of(spec)
    shots = shots_of(spec, scene.obstacles, flight, Confines(scene.site, scene.room))
    done = counted(on_frame, sum(len(each.times_ns) for each in shots.exposures))
    with disk_errors(folder), new_folder(folder, RENDERED) as new:
        _, *readings = write_flight(flight, spec.sensors, scene.obstacles, spec.seed, new)
        gimbals = {
            gimbal_file(camera.name): write_readings(new, camera, mount, flight, spec.seed)
            for camera, mount in zip(cameras, shots.mounts, strict=True)
            if isinstance(mount, GimbalMotion)
        }
        delays = {
            camera.name: film(folder_of(new, camera), spec, camera, Footage(scene, flight, each, mount, lens), done)
            for camera, each, mount, lens in zip(cameras, shots.exposures, shots.mounts, shots.lenses, strict=True)
        }
        save_structure(scene.built.structure, new)
        summary = flown_summary(spec.flight, spec.mount.at_rest, scene.obstacles, spec.seed, flight)
        sensors = _by_file(spec, readings) | gimbals
        more = {"flight": summary.to_json(), "sensors": sensors, **_camera_records(spec, delays)}
        more |= {"unreached": shots.missed} if shots.missed else {}
        _write_info(new, spec, scene, delays[MAIN], more | {"content_hash": content_hash})
        write_contact_sheet(Sequence.load(new), new / "contact_sheet.jpg")
        write_manifest(new)


def folder_of(folder: Path, camera: BodyCamera) -> Path:
    """Folder of a camera's files within a sequence: the sequence folder itself for the main camera."""
    return folder if camera.name == MAIN else folder / "cameras" / camera.name


def counted(on_frame: Callable[[int, int], None] | None, total: int) -> Callable[[], None]:
    """Progress callback to be called once per finished frame."""
    done = count(1)
    return lambda: on_frame(next(done), total) if on_frame is not None else None


def _by_file(spec: SequenceSpec, readings: list[str]) -> dict[str, Any]:
    """Parameters of each sensor, by the file of its readings."""
    return {name: described(sensor) for name, sensor in zip(readings, spec.sensors, strict=True)}


def _camera_records(spec: SequenceSpec, delays: dict[str, float]) -> dict[str, Any]:
    """Entries of the record for further cameras and a non-default camera clock."""
    record: dict[str, Any] = {}
    if spec.clock.shift_ns:
        record["timeshift_cam_imu_ns"] = spec.clock.shift_ns
    if spec.cameras:
        record["cameras"] = {
            camera.name: {
                "cam_from_body": cam_from_body_record(camera),
                "offset_s": camera.offset_s,
                "row_delay_ns": delays[camera.name],
            }
            for camera in spec.cameras
        }
    return record


def _write_info(folder: Path, spec: SequenceSpec, scene: Scene, row_delay_ns: float, more: dict[str, Any]) -> None:
    try:
        own = version("uavbench")
    except PackageNotFoundError:
        own = "not installed"
    info = {
        "format": FORMAT,
        "name": spec.name,
        "seed": spec.seed,
        "rate_hz": spec.rate_hz,
        "cam_from_body": cam_from_body_record(cameras_of(spec)[0]),
        "row_delay_ns": row_delay_ns,
        "depth_m_per_unit": DEPTH_M_PER_UNIT,
        "deviation": scene.built.deviation,
        "config": described(spec),
        **more,
        "versions": {
            "uavbench": own,
            "numpy": np.__version__,
            "opencv": cv2.__version__,
            "png": ENCODING,
            "gl": gl.version(),
        },
    }
    write_text(folder / "sequence.json", json.dumps(info, indent=1) + "\n")
