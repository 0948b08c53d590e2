"""From a spec to a sequence folder: build, fly, render, and write the ground truth."""

import json
from collections.abc import Callable
from collections.abc import Sequence as Sequenced
from contextlib import nullcontext
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from itertools import count
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from uavbench.scenes.camera_path import Motion, camera_path, mounted_path
from uavbench.scenes.dataset.contact_sheet import write_contact_sheet
from uavbench.scenes.dataset.crlb import FrameBounds
from uavbench.scenes.dataset.disk_guards import disk_errors
from uavbench.scenes.dataset.gimbal_files import cam_from_body_record, gimbal_file, write_readings
from uavbench.scenes.dataset.sequence import DEPTH_M_PER_UNIT, RENDERED, Sequence
from uavbench.scenes.dataset.spec_record import described
from uavbench.scenes.dataset.structure_files import save_structure
from uavbench.scenes.dataset.surfaces.surface_truth import SurfaceFiles
from uavbench.scenes.dataset.table_files import FORMAT
from uavbench.scenes.dataset.verify import write_manifest
from uavbench.scenes.effects.registry import EFFECTS
from uavbench.scenes.frames import Filming, write_frames
from uavbench.scenes.png.encoder import ENCODING
from uavbench.scenes.renderables import BuiltSite, Confines, Room
from uavbench.scenes.rendering import context as gl
from uavbench.scenes.rendering.camera_simulator import CameraSimulator, RenderCamera, ideal_camera, render_camera
from uavbench.scenes.scene import Scene, build_scene, confines_of, obstacles_of
from uavbench.scenes.spec import MAIN, BodyCamera, EffectSpec, SequenceSpec
from uavbench.trajectories import reproducible_math as exact
from uavbench.trajectories.camera_clock import Exposures
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.origin import refuse_foreign
from uavbench.trajectories.files.writing import new_folder, write_text
from uavbench.trajectories.gimbal.gimbal import Gimbal
from uavbench.trajectories.gimbal.motion import GimbalMotion
from uavbench.trajectories.kernels.warm_up import prepare
from uavbench.trajectories.obstacles import ObstacleMesh
from uavbench.trajectories.pose import Array, Pose, rotation_from_quaternion
from uavbench.trajectories.random_streams import stream
from uavbench.trajectories.sensors.registry import check_places, write_flight
from uavbench.trajectories.simulation.checks import check_camera
from uavbench.trajectories.simulation.flight import Flight, fly
from uavbench.trajectories.simulation.summary import flown_summary

__all__ = ["Motion", "camera_path", "check_first_view", "generate", "mounted_path", "with_effects"]

LEAST_SHARE_IN_VIEW = 0.005
LEAST_ABOVE_GROUND_M = 0.1
"""Least height of a camera above the ground of a site, metres; the renderer's near plane is at 0.05 m."""
LEAST_TO_WALLS_M = 0.1
"""Least distance of a camera and of the vehicle's middle from the walls and the ceiling of a room, metres."""


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


def rehearse(spec: SequenceSpec) -> list[str]:
    """Fly a sequence whose scene is not built, and return what its gimbals do not reach.

    UserError as `generate`, for everything but the images.
    """
    confines, obstacles = confines_of(spec), obstacles_of(spec)
    flight = fly(spec.flight, spec.mount.at_rest, obstacles, spec.seed)
    shots = shots_of(spec, obstacles, flight, confines)
    check_places(spec.sensors, flight, obstacles)
    return shots.missed


@dataclass(frozen=True, eq=False)
class Shots:
    """What the cameras of a spec take along a flight, each in the order of `cameras_of`; missed: see `missed_targets`.

    mounts: `cam_from_body` at a time (ns).
    """

    exposures: list[Exposures]
    lenses: list[RenderCamera]
    mounts: list[Callable[[int], Pose]]
    missed: list[str]


def shots_of(spec: SequenceSpec, obstacles: ObstacleMesh, flight: Flight, confines: Confines) -> Shots:
    """The shots along a flight; UserError for a camera that cannot be where it flies, or cannot take its frames."""
    cameras = cameras_of(spec)
    check_confines(spec, flight, confines)
    exposures = [exposures_of(spec, camera, flight) for camera in cameras]
    lenses = [lens_of(spec, camera) for camera in cameras]
    for camera in cameras[1:]:
        check_further_camera(spec, camera, obstacles, flight)
    mounts = [camera.mount.along(flight, aim_of(obstacles)) for camera in cameras]
    return Shots(exposures, lenses, mounts, missed_targets(spec, mounts, [each.times_ns for each in exposures]))


def check_confines(spec: SequenceSpec, flight: Flight, confines: Confines) -> None:
    """UserError when a flight leaves the site or the room of its scene."""
    for camera in cameras_of(spec):
        check_site(spec, camera, confines.site, flight)
        check_room(spec, camera, confines.room, flight)


def aim_of(obstacles: ObstacleMesh) -> Array:
    """What gimbals look at (3,) unless they are told: the middle of the structure's bounds, m."""
    corners = [obstacles.vertices.min(axis=0), obstacles.vertices.max(axis=0)]
    return np.asarray(np.mean(corners, axis=0))


def missed_targets(
    spec: SequenceSpec, mounts: Sequenced[Callable[[int], Pose]], times_ns: Sequenced[NDArray[np.int64]]
) -> list[str]:
    """What keeps each gimbal from its target at the times of its frames, in the order of the cameras.

    UserError when one never sees it.
    """
    found = []
    for camera, mount, stamps_ns in zip(cameras_of(spec), mounts, times_ns, strict=True):
        if not (isinstance(camera.mount, Gimbal) and isinstance(mount, GimbalMotion)):
            continue
        try:
            what = camera.mount.unreached(mount, stamps_ns)
        except UserError as error:
            raise UserError(f"sequence {spec.name}: camera {camera.name}: {error}") from None
        found += [missed_target(camera.name, what)] if what else []
    return found


def missed_target(camera: str, what: str) -> str:
    """Line of `unreached` in a record: what keeps the gimbal of a camera from its target."""
    return f"gimbal of {camera}: {what}"


def cameras_of(spec: SequenceSpec) -> list[BodyCamera]:
    """The cameras of a spec, the main one first."""
    return [BodyCamera(name=MAIN, mount=spec.mount, camera=spec.camera), *spec.cameras]


def folder_of(folder: Path, camera: BodyCamera) -> Path:
    """Folder of a camera's files within a sequence: the sequence folder itself for the main camera."""
    return folder if camera.name == MAIN else folder / "cameras" / camera.name


def exposures_of(spec: SequenceSpec, camera: BodyCamera, flight: Flight) -> Exposures:
    """Exposures of a camera along a flight; UserError for a rate or an offset that the flight cannot provide."""
    try:
        return spec.clock.exposures(flight, spec.rate_hz, stream(spec.seed, "clock"), camera.offset_s)
    except UserError as error:
        raise UserError(f"sequence {spec.name}: {camera.name}: {error}") from None


def lens_of(spec: SequenceSpec, camera: BodyCamera) -> RenderCamera:
    """What is rendered for a camera of a spec; UserError for a lens that cannot be rendered."""
    try:
        return render_camera(camera.camera.camera(), max((getattr(e, "margin_px", 0) for e in spec.effects), default=0))
    except UserError as error:
        raise UserError(f"sequence {spec.name}: {camera.name}: {error}") from None


def check_further_camera(spec: SequenceSpec, camera: BodyCamera, obstacles: ObstacleMesh, flight: Flight) -> None:
    """UserError when a further camera enters the structure or passes below the floor."""
    try:
        check_camera(flight.positions_m, flight.quaternions_wxyz, camera.mount.at_rest, obstacles)
    except UserError as error:
        raise UserError(f"sequence {spec.name}: camera {camera.name}: {error}") from None


def check_site(spec: SequenceSpec, camera: BodyCamera, site: BuiltSite | None, flight: Flight) -> None:
    """UserError when a camera comes closer than LEAST_ABOVE_GROUND_M to the ground of a site, or behind a neighbour."""
    if site is None:
        return
    centres = _centres(camera, flight)
    under = site.height(centres[:, :2]) + LEAST_ABOVE_GROUND_M - centres[:, 2]
    if (under > 0).any():
        row = int(np.argmax(under))
        x, y, z = centres[row]
        raise UserError(
            f"sequence {spec.name}: camera {camera.name}: t = {flight.stamps_ns[row] * 1e-9:.2f} s, at ({x:.2f}, "
            f"{y:.2f}, {z:.2f}) m: the ground there is at {z + under[row] - LEAST_ABOVE_GROUND_M:.2f} m; move the "
            "path, or remove environment.site.embankments"
        )
    if (hidden := site.is_hidden(centres)).any():
        row = int(np.argmax(hidden))
        x, y, z = centres[row]
        raise UserError(
            f"sequence {spec.name}: camera {camera.name}: t = {flight.stamps_ns[row] * 1e-9:.2f} s, at ({x:.2f}, "
            f"{y:.2f}, {z:.2f}) m: a neighbouring building stands there or before the structure; keep the path nearer, "
            "or raise environment.site.neighbours_from_m"
        )


def check_room(spec: SequenceSpec, camera: BodyCamera, room: Room | None, flight: Flight) -> None:
    """UserError when a camera or the vehicle comes closer than LEAST_TO_WALLS_M to a wall or the ceiling of a room."""
    if room is None:
        return
    to_walls = np.minimum(room.to_walls(flight.positions_m), room.to_walls(_centres(camera, flight)))
    row = int(np.argmin(to_walls))
    if to_walls[row] < LEAST_TO_WALLS_M:
        x, y, z = flight.positions_m[row]
        raise UserError(
            f"sequence {spec.name}: camera {camera.name}: t = {flight.stamps_ns[row] * 1e-9:.2f} s, at ({x:.2f}, "
            f"{y:.2f}, {z:.2f}) m: a wall or the ceiling of the room, {room.side_m:.1f} m wide and {room.height_m:.1f} "
            "m high, is in the way; raise environment.room_m or environment.height_m, or bring the path nearer"
        )


def _centres(camera: BodyCamera, flight: Flight) -> Array:
    """Centres (n, 3) of a camera along a flight, m."""
    offset_m = camera.mount.at_rest.cam_from_body.inverse().translation
    turned: Array = exact.product(rotation_from_quaternion(flight.quaternions_wxyz), offset_m)
    return flight.positions_m + turned


@dataclass(frozen=True, eq=False)
class Footage:
    """What a camera records: a scene, along a flight, at its exposures, through a lens.

    mount: `cam_from_body` at a time (ns).
    """

    scene: Scene
    flight: Flight
    exposures: Exposures
    mount: Callable[[int], Pose]
    lens: RenderCamera


def film(
    folder: Path, spec: SequenceSpec, on_body: BodyCamera, footage: Footage, on_frame: Callable[[], None]
) -> float:
    """Write the frames and calibration of a camera into a folder; returns the delay between rows, ns."""
    scene, flight, camera = footage.scene, footage.flight, on_body.camera.camera()
    pinhole, lens = footage.lens
    path, blur_px = mounted_path(flight, footage.mount), on_body.camera.lens_blur_px
    with (
        scene.renderer(pinhole.width, pinhole.height) as renderer,
        FrameBounds(scene.renderer, camera, path, spec.effects, blur_px)
        if spec.crlb_every and on_body.name == MAIN
        else nullcontext() as limit,
    ):
        ideal = ideal_camera(renderer, camera, pinhole, lens, path, blur_px)
        if on_body.name == MAIN:
            check_first_view(spec, ideal, int(footage.exposures.times_ns[0]))
        source = with_effects(ideal, spec.effects, spec.seed, on_body.name)
        filming = Filming(
            source=source,
            mount=footage.mount,
            structure=scene.built.structure,
            limit=limit,
            surfaces=SurfaceFiles.asked(folder, spec.annotations, renderer, source),
        )
        write_frames(folder, spec, filming, flight, footage.exposures, on_frame)
    camera.save(folder / "camera.toml")
    return source.row_delay_ns


def counted(on_frame: Callable[[int, int], None] | None, total: int) -> Callable[[], None]:
    """Progress callback to be called once per finished frame."""
    done = count(1)
    return lambda: on_frame(next(done), total) if on_frame is not None else None


def with_effects(
    source: CameraSimulator, effects: tuple[EffectSpec, ...], seed: int, camera: str = MAIN
) -> CameraSimulator:
    """The camera simulator with effects in the order of `EFFECTS`, each with its own random stream per camera."""
    of_camera = () if camera == MAIN else ("camera", camera)
    order = list(EFFECTS.values())
    ranked = sorted(effects, key=lambda e: order.index(type(e)) if type(e) in order else len(order))
    seen: dict[str, int] = {}
    for effect in ranked:
        name = type(effect).__name__
        seen[name] = seen.get(name, -1) + 1
        source = effect.start(source, stream(seed, *of_camera, "effect", name, seen[name]))
    return source


def check_first_view(spec: SequenceSpec, source: CameraSimulator, time_ns: int = 0) -> None:
    """UserError when the structure fills less than LEAST_SHARE_IN_VIEW of the first image."""
    share = float((source.render(time_ns).instances == 1).mean())
    if share < LEAST_SHARE_IN_VIEW:
        raise UserError(
            f"sequence {spec.name}: frame 0: the structure fills {100 * share:.2f} % of the image, less than "
            f"{100 * LEAST_SHARE_IN_VIEW:g} %; begin closer to it, or turn the mount or the path towards it"
        )


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
