"""Films a scene with one camera: its simulator with its effects, its frames, its calibration."""

from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from uavbench.scenes.camera_path import mounted_path
from uavbench.scenes.dataset.crlb import FrameBounds
from uavbench.scenes.dataset.surfaces.surface_truth import SurfaceFiles
from uavbench.scenes.effects.own_images import Seen, checked, name_of, own_copy, same_twice
from uavbench.scenes.effects.registry import EFFECTS
from uavbench.scenes.filming.frames import Filming, write_frames
from uavbench.scenes.rendering.camera_simulator import CameraSimulator, RenderCamera, ideal_camera
from uavbench.scenes.scene import Scene
from uavbench.scenes.spec import BodyCamera, EffectSpec, SequenceSpec
from uavbench.trajectories.camera_clock import Exposures
from uavbench.trajectories.camera_mount import MAIN
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.pose import Pose
from uavbench.trajectories.random_streams import stream
from uavbench.trajectories.simulation.flight import Flight

LEAST_SHARE_IN_VIEW = 0.005
"""Least share of the first image that the structure must fill."""


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


def with_effects(
    source: CameraSimulator, effects: tuple[EffectSpec, ...], seed: int, camera: str = MAIN
) -> CameraSimulator:
    """The camera simulator with effects in the order of `EFFECTS`, each with its own random stream per camera.

    Images of effects that are not ours are checked, and must be the same in each run.
    """
    of_camera = () if camera == MAIN else ("camera", camera)
    order = list(EFFECTS.values())
    ranked = sorted(effects, key=lambda e: order.index(type(e)) if type(e) in order else len(order))

    number = dict.fromkeys((type(effect).__name__ for effect in ranked), -1)
    streams: list[Callable[[], np.random.Generator]] = []
    for effect in ranked:
        name = type(effect).__name__
        number[name] += 1
        streams.append(partial(stream, seed, *of_camera, "effect", name, number[name]))
    ours = sum(type(effect) in order for effect in ranked)
    for effect, rng in zip(ranked[:ours], streams, strict=False):
        source = effect.start(source, rng())

    def start(found: CameraSimulator, seen: Seen) -> CameraSimulator:
        for effect, rng in zip(ranked[ours:], streams[ours:], strict=True):
            found = checked(effect, own_copy(effect).start(found, rng()), found, seen)
        return found

    names = ", ".join(map(name_of, ranked[ours:]))
    return same_twice(source, names, start) if names else source


def check_first_view(spec: SequenceSpec, source: CameraSimulator, time_ns: int = 0) -> None:
    """UserError when the structure fills less than LEAST_SHARE_IN_VIEW of the first image."""
    share = float((source.render(time_ns).instances == 1).mean())
    if share < LEAST_SHARE_IN_VIEW:
        raise UserError(
            f"sequence {spec.name}: frame 0: the structure fills {100 * share:.2f} % of the image, less than "
            f"{100 * LEAST_SHARE_IN_VIEW:g} %; begin closer to it, or turn the mount or the path towards it"
        )
