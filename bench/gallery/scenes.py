"""Pictures of structures, environments, clutter, and image effects."""

from dataclasses import replace
from functools import lru_cache
from typing import Any, cast

import cv2
import numpy as np

from uavbench.bench.closed_loop.eye import eye, mount_along
from uavbench.bench.filming.outside_view import looking_at
from uavbench.scenes.rendering.camera_simulator import light_of
from uavbench.scenes.rendering.radiance import Radiance, encode
from uavbench.scenes.scene import Scene, build_scene
from uavbench.scenes.site.site import Site
from uavbench.scenes.spec import SequenceSpec
from uavbench.tracker.protocol import Image
from uavbench.trajectories.camera_mount import Mount
from uavbench.trajectories.sensors.sensor import sample_stamps, sampled
from uavbench.trajectories.simulation.flight import fly

ABOVE_DEG = 12.0
"""Downward tilt of the view: small enough to show the sky."""
AROUND = 1.8
"""Extent of the view of an environment, in multiples of the structure's."""
FRAMES = 6
"""Consecutive frames rendered with an effect: enough for dropped ones among them."""
WHITE = (255, 255, 255)
BARE = Site(wind_m_s=1.0)
"""A site without details: wind moves clouds only. Its ground has the tones of all sites, a field's are others."""


def structure_picture(spec: SequenceSpec) -> Image:
    """Image (h, w, 3) BGR of the spec's scene, the structure filling the view."""
    return _from_outside(spec, 1.0)


def environment_picture(spec: SequenceSpec) -> Image:
    """Image (h, w, 3) BGR of the spec's scene, with AROUND times the structure's extent in view."""
    return _from_outside(spec, AROUND)


def site_picture(spec: SequenceSpec) -> Image:
    """Image (h, w, 3) BGR of the spec's scene: left half on a site without, right half with details."""
    bare: Any = replace(cast(Any, spec.environment), site=BARE)
    pictures = [environment_picture(replace(spec, environment=environment)) for environment in (bare, spec.environment)]
    return _halves(pictures[0], pictures[1], 0.5 * pictures[0].shape[1])


def _halves(left: Image, right: Image, centre_px: float) -> Image:
    """The same half of two images side by side: the columns around centre_px."""
    half = left.shape[1] // 2
    first = int(np.clip(round(centre_px - half / 2), 0, half))
    picture = np.hstack([image[:, first : first + half] for image in (left, right)])
    cv2.line(picture, (half, 0), (half, picture.shape[0]), WHITE, 2)
    return picture


def _from_outside(spec: SequenceSpec, wide: float) -> Image:
    """The scene with `wide` times the structure's extent in view."""
    camera, scene = spec.camera.camera(), build_scene(spec)
    low, high = scene.built.structure.bounds
    middle, half = (low + high) / 2, wide * (high - low) / 2
    ends = middle - half, middle + half
    pose = looking_at(np.maximum(ends[0], [*ends[0][:2], 0.0]), ends[1], camera, ABOVE_DEG)
    with scene.renderer(camera.width, camera.height) as renderer:
        return encode(light_of(renderer.color(pose, camera)))


def effect_picture(spec: SequenceSpec) -> Image:
    """Frame (h, w, 3) BGR at the highest speed of a flight: left half without, right half with the spec's effects.

    Where the effects drop frames: FRAMES consecutive frames with them, dropped ones left grey.
    """
    scene = _scene(replace(spec, name="", effects=()))
    flight = fly(spec.flight, spec.mount.at_rest, scene.obstacles, spec.seed)
    times = sample_stamps(flight, spec.rate_hz)
    fastest = int(np.argmax(np.linalg.norm(sampled(flight, flight.velocities_m_s, times[:-FRAMES]), axis=1)))
    stamps = times[fastest : fastest + FRAMES].tolist()
    mount = mount_along(spec, scene, flight)
    with eye(replace(spec, effects=()), scene, flight, mount) as source:
        before = _first(source.image(stamps[0]))
        middle = source.cam_from_world(stamps[0]).transform(scene.built.structure.bounds.mean(axis=0)[None])
        centre_px = float(source.camera.project(middle)[0, 0])
    with eye(spec, scene, flight, mount) as source:
        taken = [source.image(stamp) for stamp in stamps]
    if any(light is None for light in taken):
        return _strip([None if light is None else encode(light) for light in taken], before)
    return _halves(before, _first(taken[0]), centre_px)


def mount_picture(spec: SequenceSpec) -> Image:
    """FRAMES frames (h, w, 3) BGR of a flight with the spec's mount, from half its time on."""
    scene = _scene(replace(spec, name="", mount=Mount()))
    flight = fly(spec.flight, spec.mount.at_rest, scene.obstacles, spec.seed)
    times = sample_stamps(flight, spec.rate_hz)
    stamps = times[len(times) // 2 :][:FRAMES].tolist()
    with eye(spec, scene, flight, mount_along(spec, scene, flight)) as source:
        taken = [_first(source.image(stamp)) for stamp in stamps]
    return _strip(list(taken), taken[0])


@lru_cache(maxsize=1)
def _scene(spec: SequenceSpec) -> Scene:
    """The scene of a spec, cached: most effects share one."""
    return build_scene(spec)


def _first(light: Radiance | None) -> Image:
    assert light is not None, "an effect lost its first frame"
    return encode(light)


def _strip(taken: list[Image | None], size_of: Image) -> Image:
    """Two rows of downscaled frames, dropped ones grey."""
    height, width = size_of.shape[:2]
    small = (width * 2 // FRAMES, height * 2 // FRAMES)
    empty = np.full((small[1], small[0], 3), 90, dtype=np.uint8)
    frames = [empty if image is None else cv2.resize(image, small, interpolation=cv2.INTER_AREA) for image in taken]
    return np.asarray(np.vstack([np.hstack(frames[: FRAMES // 2]), np.hstack(frames[FRAMES // 2 :])]), dtype=np.uint8)
