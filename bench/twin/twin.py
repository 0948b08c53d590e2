"""The twin of a sequence: the same ground truth with path-traced images."""

import json
import os
import shutil
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from uavbench.bench.closed_loop.eye import eye, mount_along
from uavbench.bench.config.suite import recorded_spec
from uavbench.bench.inputs.content_hash import carried_hash, code_hash, content_hash
from uavbench.bench.inputs.touched_files import Stamps, touched_since
from uavbench.bench.twin.blender import Blender, find_blender
from uavbench.bench.twin.path_tracer import TracedScene
from uavbench.scenes.camera_path import camera_path
from uavbench.scenes.dataset.annotations import write_edges
from uavbench.scenes.dataset.contact_sheet import write_contact_sheet
from uavbench.scenes.dataset.disk_guards import disk_errors
from uavbench.scenes.dataset.ground_truth_files import read_row_poses
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.scenes.dataset.table_files import FORMAT, format_of
from uavbench.scenes.dataset.verify import verify, write_manifest
from uavbench.scenes.effects.link import Drops
from uavbench.scenes.rendering.camera_simulator import CameraSimulator
from uavbench.scenes.rendering.radiance import encode
from uavbench.scenes.scene import Scene, build_scene
from uavbench.scenes.spec import SequenceSpec
from uavbench.trajectories.camera_clock import CameraClock
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.limits import ANY, TABLE
from uavbench.trajectories.files.listed import Marker
from uavbench.trajectories.files.origin import refuse_foreign
from uavbench.trajectories.files.reading import opened, read_text
from uavbench.trajectories.files.writing import full_disk_told, new_folder, write_text
from uavbench.trajectories.kernels.warm_up import prepare
from uavbench.trajectories.pose import Pose
from uavbench.trajectories.simulation.flight import Flight, fly

MARKER = Marker("manifest.json", "twin of a sequence")
OF_A_FRAME = ("depth", "mask", "normals")
"""Folders with an image per frame that does not depend on the renderer."""
TO_THE_NEXT = ("flow", "occlusion")
"""The same for all frames but the last, of the motion up to the next frame of the sequence."""
MADE_ANEW = {
    MARKER.name, "sequence.json", "frames.csv", "groundtruth.csv", "row_poses.npy", "contact_sheet.jpg", "crlb.csv",
}  # fmt: skip
"""Files of a sequence that are not copied as they are; the bounds of `crlb.csv` hold only for the original images."""
NOT_WRITTEN = "the twin was not written; render it again"
SAME_M = 1e-6
"""Tolerance in m between a recorded flight and its repetition."""


@dataclass(frozen=True)
class Tracing:
    """How a twin is rendered: every n-th frame of the sequence (`every`), with `samples` per pixel and view."""

    every: int = 1
    samples: int = 64


def make_twin(
    folder: Path, out: Path, tracing: Tracing, on_frame: Callable[[int, int], None] = lambda done, total: None
) -> None:
    """Write the twin of the sequence `folder` into `out`, whole or not at all, unless one that is up to date is there.

    on_frame(frames done, all) reports progress. UserError when the sequence has no spec or this version flies it
    differently, `every` exceeds its frames, Blender is absent, too old or fails, `out` holds anything but a twin, or
    the sequence was written meanwhile.
    """
    before = Stamps.of(folder.rglob("*"))
    sequence = Sequence.load(folder)
    spec = spec_of(sequence)
    stamps = _stamps(sequence, tracing.every)
    _refuse_other(out, folder)
    blender = find_blender()
    provenance = _provenance(sequence, spec, tracing, blender)
    if carried_hash(out / "sequence.json") == content_hash(provenance) and verify(out).ok:
        return
    prepare(__name__)
    scene = build_scene(spec)
    flight = fly(spec.flight, spec.mount.at_rest, scene.obstacles, spec.seed)
    _check_same(sequence, spec, scene, flight)
    arrived = replace(spec, effects=tuple(e for e in spec.effects if not isinstance(e, Drops)))
    traced = TracedScene(scene, blender, tracing.samples)
    with disk_errors(out), new_folder(out, MARKER) as new:
        with eye(arrived, traced, flight, mount_along(spec, scene, flight)) as source:
            _write_frames(new, sequence, source, stamps, on_frame)
        _copy_truth(new, sequence, tracing.every)
        info = _info(sequence, provenance, traced.denoisers[-1])
        write_text(new / "sequence.json", json.dumps(info, indent=1) + "\n")
        write_contact_sheet(Sequence.load(new), new / "contact_sheet.jpg")
        write_manifest(new)
        before.expect_unchanged(NOT_WRITTEN)
        now = lambda: {"twin": content_hash(_provenance(sequence, spec, tracing, blender))}  # noqa: E731
        if (touched := touched_since({"twin": content_hash(provenance)}, now, ["twin"])).jobs:
            raise UserError(f"changed while it was in use: {touched}; {NOT_WRITTEN}")


def left_out(sequence: Sequence, every: int) -> str:
    """What of a sequence its twin of every n-th frame does not have, and why; "" for nothing."""
    missing = []
    if every > 1 and any((sequence.folder / kind).is_dir() for kind in TO_THE_NEXT):
        missing.append(
            "flow and occlusion (to the next frame of the sequence, which the twin has with --every 1 alone)"
        )
    if (sequence.folder / "crlb.csv").is_file():
        missing.append("crlb.csv (bounds of the images of uavbench's renderer)")
    if sequence.cameras:
        missing.append(f"cameras {', '.join(sequence.cameras)} (a twin is of the main camera)")
    return "; ".join(missing)


def spec_of(sequence: Sequence) -> SequenceSpec:
    """The spec that a sequence was rendered from.

    UserError for a twin, for recorded sequences and others without a `config`, for one of an older format, and for one
    with its own camera clock or a gimbal.
    """
    path = sequence.folder / "sequence.json"
    if "twin" in sequence.info:
        raise UserError(f"{sequence.folder}: is itself a twin; name the sequence that it was made from")
    config = sequence.info.get("config")
    if sequence.recorded or not isinstance(config, dict):
        raise UserError(f"{path}: has no `config` to build its scene from, as recordings have none; render a sequence")
    if (older := format_of(path, sequence.info)) != FORMAT:
        raise UserError(
            f"{path}: is of format {older}, not {FORMAT}: this version renders other frames; render it again"
        )
    spec = recorded_spec(config, path)
    if spec.clock != CameraClock():
        raise UserError(f"{path}: its camera has its own `clock`, which twins do not support; render it without")
    if sequence.on_gimbal:
        raise UserError(f"{path}: its camera is on a gimbal, which twins do not support; render it with a fixed mount")
    return spec


def _stamps(sequence: Sequence, every: int) -> NDArray[np.int64]:
    """Stamps in ns of the twin's frames; UserError when `every` exceeds the frames of the sequence."""
    if every > len(sequence):
        raise UserError(f"--every {every}: {sequence.folder} has {len(sequence)} frames; name at most as many")
    return sequence.stamps_ns[::every]


def _refuse_other(out: Path, folder: Path) -> None:
    """UserError when `out` holds anything but a twin, or lies inside the sequence."""
    if out.resolve().is_relative_to(folder.resolve()):
        raise UserError(f"{out}: lies in the sequence itself; name another folder with --out")
    refuse_foreign(out, MARKER)


def _check_same(sequence: Sequence, spec: SequenceSpec, scene: Scene, flight: Flight) -> None:
    """UserError when structure, camera or flight differ from those of the sequence."""
    body_from_world = camera_path(flight, Pose.identity())
    flown = [body_from_world(stamp_ns).inverse().matrix for stamp_ns in sequence.stamps_ns.tolist()]
    recorded = [sequence.ground_truth.pose(frame).matrix for frame in range(len(sequence))]
    here, there = scene.built.structure.vertices, sequence.structure.vertices
    same = np.allclose(flown, recorded, rtol=0, atol=SAME_M)
    if not (same and here.shape == there.shape and np.allclose(here, there, rtol=0, atol=SAME_M)):
        raise UserError(
            f"{sequence.folder}: this version of uavbench builds or flies it differently; render the sequence again"
        )
    if spec.camera.camera() != replace(sequence.camera, readout_ms=0.0):  # which is of the effects
        raise UserError(f"{sequence.folder / 'camera.toml'}: is not the camera of `config`; render the sequence again")


def _write_frames(
    new: Path,
    sequence: Sequence,
    source: CameraSimulator,
    stamps: NDArray[np.int64],
    on_frame: Callable[[int, int], None],
) -> None:
    """Render the frames, list them in frames.csv, and rewrite the edges, whose contrast depends on the image."""
    (new / "frames").mkdir()
    lines = ["frame,stamp_ns,file"]
    edges = (sequence.folder / "edges").is_dir()
    for frame, stamp_ns in enumerate(stamps.tolist()):
        view = source.render(stamp_ns) if edges else None  # first: the image then needs no further view of this instant
        light = source.image(stamp_ns)
        assert light is not None, "only `drops` loses frames, and a twin has no such effect"
        name, image = f"frames/{frame:06d}.png", encode(light)
        (new / name).write_bytes(cv2.imencode(".png", image)[1].tobytes())
        lines.append(f"{frame},{stamp_ns},{name}")
        if view is not None:
            write_edges(new, frame, source, view, sequence.structure, image)
        on_frame(frame + 1, len(stamps))
    write_text(new / "frames.csv", "\n".join(lines) + "\n")


def _copy_truth(new: Path, sequence: Sequence, every: int) -> None:
    """Copy the files that do not depend on the renderer; files per frame for every n-th frame."""
    folder = sequence.folder
    for path in sorted(folder.iterdir()):
        if not path.is_dir() and path.name not in MADE_ANEW:
            _copy(folder, path.name, new / path.name)
    frames = dict.fromkeys(OF_A_FRAME, len(sequence))
    if every == 1:
        frames |= dict.fromkeys(TO_THE_NEXT, len(sequence) - 1)
    for kind, count in frames.items():
        if (folder / kind).is_dir():
            (new / kind).mkdir()
            for frame, of in enumerate(range(0, count, every)):
                _copy(folder, f"{kind}/{of:06d}.png", new / kind / f"{frame:06d}.png")
    head, *rows = read_text(folder / "groundtruth.csv", TABLE, inside=folder).splitlines()
    write_text(new / "groundtruth.csv", "\n".join([head, *_numbered(rows[::every])]) + "\n")
    if os.path.lexists(folder / "row_poses.npy"):
        with full_disk_told(new / "row_poses.npy"):
            np.save(new / "row_poses.npy", read_row_poses(folder, len(sequence), sequence.camera.height)[::every])


def _copy(folder: Path, name: str, to: Path) -> None:
    """Copy a file of a sequence; UserError when it is missing, or a link leads out of the folder."""
    with opened(folder / name, ANY, inside=folder) as source, to.open("xb") as target:
        shutil.copyfileobj(source, target)


def _numbered(rows: Iterable[str]) -> Iterable[str]:
    """Rows of a table with its first column renumbered from 0."""
    return (f"{frame},{row.partition(',')[2]}" for frame, row in enumerate(rows))


def _provenance(sequence: Sequence, spec: SequenceSpec, tracing: Tracing, blender: Blender) -> dict[str, Any]:
    """Inputs that determine a twin: its sequence, the files of its scene, the renderer's settings and the code."""
    return {
        "of": sequence.name,
        "content_hash": sequence.content_hash,
        "images_hash": sequence.images_hash,
        "every": tracing.every,
        "renderer": f"Blender {blender.version}, Cycles on the CPU",
        "samples": tracing.samples,
        "scene": content_hash(spec),
        "code": code_hash("trajectories", "scenes", "bench/closed_loop", "bench/twin"),
    }


def _info(sequence: Sequence, provenance: dict[str, Any], denoiser: str) -> dict[str, Any]:
    """Content of `sequence.json`: the sequence's without further cameras, and the provenance of the twin."""
    return {
        **{key: value for key, value in sequence.info.items() if key != "cameras"},
        "name": f"{sequence.name}-twin",
        "rate_hz": sequence.info["rate_hz"] / provenance["every"],
        "content_hash": content_hash(provenance),
        "twin": {**provenance, "denoiser": denoiser or None},
    }
