"""From a spec to a sequence folder: build, fly, render, and write the ground truth."""

import json
from collections.abc import Callable
from contextlib import nullcontext
from importlib.metadata import PackageNotFoundError, version
from itertools import count
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from uavbench.scenes.camera_path import Motion, camera_path
from uavbench.scenes.dataset.contact_sheet import write_contact_sheet
from uavbench.scenes.dataset.crlb import FrameBounds
from uavbench.scenes.dataset.disk_guards import disk_errors
from uavbench.scenes.dataset.sequence import DEPTH_M_PER_UNIT, Sequence, write_manifest
from uavbench.scenes.dataset.spec_record import described
from uavbench.scenes.dataset.structure_files import save_structure
from uavbench.scenes.dataset.surface_truth import SurfaceFiles
from uavbench.scenes.effects.registry import EFFECTS
from uavbench.scenes.frames import Exposures, Filming, write_frames
from uavbench.scenes.rendering import context as gl
from uavbench.scenes.rendering.camera_simulator import CameraSimulator, ideal_camera, render_camera
from uavbench.scenes.scene import Scene, build_scene
from uavbench.scenes.spec import EffectSpec, SequenceSpec
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.writing import new_folder, refuse_foreign, write_text
from uavbench.trajectories.kernels.warm_up import prepare
from uavbench.trajectories.random_streams import stream
from uavbench.trajectories.sensors.registry import write_flight
from uavbench.trajectories.simulation.flight import Flight, fly
from uavbench.trajectories.simulation.summary import flown_summary

__all__ = ["Motion", "camera_path", "check_first_view", "generate", "with_effects"]

LEAST_SHARE_IN_VIEW = 0.005


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
    exposures = exposures_of(flight, spec)
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
        filming = Filming(
            source=source,
            cam_from_body=spec.mount.cam_from_body,
            structure=scene.built.structure,
            limit=limit,
            surfaces=SurfaceFiles.asked(new, spec.annotations, renderer, source),
        )
        write_frames(new, spec, filming, flight, exposures, counted(on_frame, len(exposures.times_ns)))
        _, *readings = write_flight(flight, spec.sensors, scene.obstacles, spec.seed, new)
        camera.save(new / "camera.toml")
        save_structure(scene.built.structure, new)
        summary = flown_summary(spec.flight, spec.mount, scene.obstacles, spec.seed, flight)
        more = {"flight": summary.to_json(), "sensors": _by_file(spec, readings), "content_hash": content_hash}
        _write_info(new, spec, scene, source, more)
        write_contact_sheet(Sequence.load(new), new / "contact_sheet.jpg")
        write_manifest(new)


def exposures_of(flight: Flight, spec: SequenceSpec) -> Exposures:
    """Times and stamps of a camera's frames; UserError for a rate that the flight's record cannot serve."""
    stamps = flight.stamps_ns[flight.frame_rows(spec.rate_hz)]
    return Exposures(times_ns=stamps, stamps_ns=stamps)


def counted(on_frame: Callable[[int, int], None] | None, total: int) -> Callable[[], None]:
    """Report to be called once for each frame that is done."""
    done = count(1)
    return lambda: on_frame(next(done), total) if on_frame is not None else None


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
