"""Bytes of a rendered sequence, estimated from its spec: measured bytes per pixel by kind of scene."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from uavbench.bench.disk_space.image_bytes import image_bytes
from uavbench.scenes.dataset.contact_sheet import COLUMNS, ROWS, WIDTH_PX
from uavbench.scenes.effects.exposure import RollingShutter
from uavbench.scenes.effects.image_sensor import Noise
from uavbench.scenes.effects.link import AnalogLink, Drops
from uavbench.scenes.spec import BodyCamera, SequenceSpec
from uavbench.scenes.structures.box import Box
from uavbench.scenes.structures.bridge import Bridge
from uavbench.scenes.structures.building import Building
from uavbench.scenes.structures.checkerboard import Checkerboard
from uavbench.scenes.structures.truss import Truss
from uavbench.scenes.structures.wall import Wall
from uavbench.scenes.world.studio import Studio
from uavbench.trajectories.camera_mount import MAIN
from uavbench.trajectories.gimbal.gimbal import Gimbal
from uavbench.trajectories.paths.pilot.hand_pilot import HandPilot
from uavbench.trajectories.sensors.imu import Imu
from uavbench.trajectories.sensors.lidar import Lidar2d
from uavbench.trajectories.sensors.registry import FLIGHT_RATE_HZ


@dataclass(frozen=True, kw_only=True)
class FrameBytes:
    """Bytes of a frame's files: per pixel of an image of MEASURED_PX, and of its file of edges as a whole.

    image, noisy: the PNG without and with sensor noise; depth; flow: with occlusion, at MEASURED_HZ; normals; mask;
    sheet: the contact sheet, per pixel of its images. model: bytes of the model of the default structure.
    """

    image: float
    noisy: float
    depth: float
    flow: float
    normals: float
    edges: float
    sheet: float
    model: float
    mask: float = 0.007


MEASURED_PX, MEASURED_HZ = 640 * 480, 15.0
MEASURED: Mapping[type, FrameBytes] = {
    Box: FrameBytes(image=0.98, noisy=1.40, depth=0.21, flow=0.51, normals=0.023, edges=650, sheet=0.23, model=400),
    Wall: FrameBytes(
        image=1.45, noisy=1.60, depth=0.07, flow=0.055, normals=0.024, edges=5500, sheet=0.295, model=21000
    ),
    Bridge: FrameBytes(
        image=1.16, noisy=1.50, depth=0.23, flow=0.38, normals=0.055, edges=25000, sheet=0.315, model=150000
    ),
    Building: FrameBytes(
        image=1.11, noisy=1.48, depth=0.29, flow=0.24, normals=0.040, edges=17500, sheet=0.29, model=77000
    ),
    Truss: FrameBytes(
        image=1.18, noisy=1.56, depth=0.36, flow=0.41, normals=0.144, edges=41500, sheet=0.315, model=45000
    ),
    Checkerboard: FrameBytes(
        image=0.85, noisy=1.40, depth=0.17, flow=0.38, normals=0.023, edges=2000, sheet=0.205, model=400
    ),
}
"""Seen by a level camera: means over flights of the suites and over ground, floors and surfaces, indoors and outdoors.
Depth, flow and normals: means of 2 to 5 flights a structure, 6 frames each; single flights have 0.07 to 0.39 of depth
on bridges and 0.02 to 0.33 on checkerboards, least where a plane fills the view. A wall of bricks and one of panels are
0.2 of `image` apart from this mean of theirs."""
DOWN = {"image": 0.013, "noisy": 0.006, "depth": 0.002}
DOWN_DEG = (-20.0, 40.0)
"""More bytes per pixel for each degree that the camera looks down, onto ground in place of sky or of plain walls, and
the angles at which box, bridge and building were measured; in a studio there are none."""
OTHER = FrameBytes(image=1.12, noisy=1.49, depth=0.22, flow=0.33, normals=0.052, edges=15000, sheet=0.275, model=50000)
"""A model from a file, or a structure of one's own: the mean of the others."""
STUDIO = {"image": 0.10, "noisy": 1.40, "depth": 0.06, "sheet": 0.05}
"""The same before a plain backdrop: of 0.02 (box) to 0.2 (truss) without noise, and 0.01 to 0.1."""
NOISY_SHEET = 0.18
"""Least bytes per pixel of a contact sheet of images with noise, before a plain backdrop."""
PILOT_FLOW, FLOW_PER_OCTAVE, LEAST_FLOW = 0.15, 0.09, 0.01
"""More flow, per pixel, where a pilot turns the view; where frames are twice as far apart; and of a view at rest."""
FINER = {"image": -0.08, "noisy": -0.04, "depth": -0.29, "flow": -0.05, "normals": -0.38, "mask": -0.45}
"""Exponents of bytes per pixel over the number of pixels, from 64x48 to 1280x960: borders become fewer."""
SHEET_FINER = 0.07
"""The same of the contact sheet, whose images are enlarged or reduced to one width, measured from 64x48 to 640x480."""
FRAME_ROWS_BYTES, LISTED_BYTES, ROW_POSE_BYTES, BOUND_BYTES = 380.0, 105.0, 56.0, 480.0
"""Bytes of a frame in tables, of each of its files in the manifest, of the pose of an image row, and of a bound in
crlb.csv."""
MOUNT_BYTES, ENCODER_BYTES = 190.0, 140.0
"""Bytes of a frame in mounts.csv, and of a reading of a gimbal's encoders, of three axes."""
RAY_BYTES = 16.0
"""Bytes of a lidar ray, measured and true range; a step adds half as much, two stamps and the azimuth."""
IMU_BYTES, READING_BYTES, FLIGHT_ROW_BYTES, RECORDS_BYTES = 264.0, 50.0, 560.0, 6e3
"""Bytes of a reading of the IMU and of other sensors, of a row of flight.csv, and of the records."""


def sequence_bytes(spec: SequenceSpec, frames: int, duration_s: float) -> float:
    """Estimated bytes of a sequence of so many frames of each camera, from a flight of duration_s."""
    lost = sum(float(effect.lost) for effect in spec.effects if isinstance(effect, Drops))
    cameras = (BodyCamera(name=MAIN, mount=spec.mount, camera=spec.camera), *spec.cameras)
    taken = frames * (1 - lost)
    per_frame = sum(_of_a_frame(spec, each) for each in cameras)
    readings = sum(_per_second(sensor) for sensor in spec.sensors)
    gimbals = [each.mount for each in cameras if isinstance(each.mount, Gimbal)]
    readings += ENCODER_BYTES * sum(gimbal.encoder.rate_hz for gimbal in gimbals)
    once = RECORDS_BYTES + _scene(spec, cameras[0]).model + _sheet(spec, cameras[0], taken)
    return once + taken * per_frame + (readings + FLIGHT_ROW_BYTES * FLIGHT_RATE_HZ) * duration_s


def _sheet(spec: SequenceSpec, main: BodyCamera, frames: float) -> float:
    """Bytes of the contact sheet, of images of one width."""
    camera, found = main.camera, _scene(spec, main).sheet
    shown_px = min(frames, COLUMNS * ROWS) * WIDTH_PX**2 * camera.height / camera.width
    least = NOISY_SHEET if _is_noisy(spec) else 0.0
    size = float(camera.width * camera.height / MEASURED_PX)
    return float(shown_px * max(found, least) * size**SHEET_FINER)


def _is_noisy(spec: SequenceSpec) -> bool:
    """Whether the sensor or the link adds noise to the images."""
    return any(isinstance(effect, Noise | AnalogLink) for effect in spec.effects)


def _of_a_frame(spec: SequenceSpec, on_body: BodyCamera) -> float:
    """Bytes of all files of a frame of a camera."""
    camera, scene = on_body.camera, _scene(spec, on_body)
    pixels = camera.width * camera.height
    size = pixels / MEASURED_PX
    per_px: dict[str, float] = {name: getattr(scene, name) * size**power for name, power in FINER.items()}
    kinds = {type(effect) for effect in spec.effects}
    image = image_bytes(per_px["image"], per_px["noisy"], spec.effects)
    annotations = sum(per_px.get(name, 0.0) for name in spec.annotations)
    files = 1 + len(spec.annotations) + ("flow" in spec.annotations)
    tables = FRAME_ROWS_BYTES + LISTED_BYTES * files + scene.edges * ("edges" in spec.annotations)
    poses = 1
    if isinstance(on_body.mount, Gimbal):
        tables, poses = tables + MOUNT_BYTES, 2
    rows = poses * ROW_POSE_BYTES * camera.height * (RollingShutter in kinds)
    if spec.crlb_every and on_body.name == MAIN:
        tables += BOUND_BYTES / spec.crlb_every
    return pixels * (image + annotations) + tables + rows


def _scene(spec: SequenceSpec, on_body: BodyCamera) -> FrameBytes:
    """Bytes per pixel of the kind of scene as the camera sees it, with the flow of path and rate."""
    found = MEASURED.get(type(spec.structure), OTHER)
    turning = PILOT_FLOW * isinstance(spec.flight.path, HandPilot)
    flow = found.flow + turning + FLOW_PER_OCTAVE * math.log2(MEASURED_HZ / spec.rate_hz)
    found = replace(found, flow=max(flow, LEAST_FLOW))
    if isinstance(spec.environment, Studio):
        return replace(found, **STUDIO)
    ahead = on_body.mount.at_rest.cam_from_body.rotation[2]
    down = float(np.clip(-np.degrees(np.arcsin(np.clip(ahead[2], -1, 1))), *DOWN_DEG))
    return replace(found, **{name: getattr(found, name) + per_deg * down for name, per_deg in DOWN.items()})


def _per_second(sensor: object) -> float:
    """Bytes per second of the readings of a body sensor."""
    if isinstance(sensor, Lidar2d):
        return RAY_BYTES * (sensor.rays_per_s + 1.5 * sensor.steps_per_s)
    each = IMU_BYTES if isinstance(sensor, Imu) else READING_BYTES
    return each * float(getattr(sensor, "rate_hz", 0.0))
