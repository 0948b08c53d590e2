"""Pictures of cameras: what each camera of a vehicle sees at one instant."""

import cv2
import numpy as np

from uavbench.reports.figures.tracker_pictures import write_text_on
from uavbench.scenes.camera_path import mounted_path
from uavbench.scenes.rendering.camera_simulator import ideal_camera
from uavbench.scenes.rendering.radiance import encode
from uavbench.scenes.scene import Scene, build_scene
from uavbench.scenes.shots.cameras import cameras_of, lens_of
from uavbench.scenes.spec import BodyCamera, SequenceSpec
from uavbench.tracker.protocol import Image
from uavbench.trajectories.simulation.flight import Flight, fly

ROW = (120, 255, 255)
ROWS = 5
"""Colour (BGR) of the rows that are drawn across a stereo pair, and in how many parts they divide it."""
ALIKE = 1e-9
"""Largest difference of the rotations of two cameras of a pair whose rows correspond."""


def cameras_picture(spec: SequenceSpec) -> Image:
    """Image (h, w, 3) BGR with a tile for each camera, in rows of two, in the middle of the flight.

    A pair that looks the same way has rows drawn across: a point is on the same row of both images.
    """
    scene = build_scene(spec)
    flight = fly(spec.flight, spec.mount.at_rest, scene.obstacles, spec.seed)
    time_ns = int(flight.stamps_ns[len(flight) // 2])
    cameras = cameras_of(spec)
    tiles = [_seen(spec, scene, each, flight, time_ns) for each in cameras]
    if len(cameras) > 1:
        for tile, each in zip(tiles, cameras, strict=True):
            write_text_on(tile, each.name)
    picture = np.vstack([np.hstack(tiles[k : k + 2]) for k in range(0, len(tiles), 2)])
    if len(cameras) == 2 and _alike(*cameras):
        for row in np.linspace(0, picture.shape[0], ROWS + 1)[1:-1].astype(int).tolist():
            cv2.line(picture, (0, row), (picture.shape[1], row), ROW, 1)
    return np.asarray(picture, dtype=np.uint8)


def _seen(spec: SequenceSpec, scene: Scene, on_body: BodyCamera, flight: Flight, time_ns: int) -> Image:
    """What a camera sees at a time, without the effects of shutter, sensor and link."""
    mount = on_body.mount.along(flight, scene.obstacles.centre)
    pinhole, lens = lens_of(spec, on_body)
    with scene.renderer(pinhole.width, pinhole.height) as renderer:
        path, blur_px = mounted_path(flight, mount), on_body.camera.lens_blur_px
        light = ideal_camera(renderer, on_body.camera.camera(), pinhole, lens, path, blur_px).image(time_ns)
    assert light is not None, "only drops lose frames"
    return encode(light)


def _alike(one: BodyCamera, other: BodyCamera) -> bool:
    rotations = [camera.mount.at_rest.cam_from_body.rotation for camera in (one, other)]
    return bool(np.abs(rotations[0] - rotations[1]).max() < ALIKE) and one.camera == other.camera
