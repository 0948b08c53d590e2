"""Specification of a sequence: plug-ins, their parameters, and a seed."""

import re
from dataclasses import dataclass, field, replace
from typing import Annotated, Literal, Protocol

import numpy as np
from annotated_types import Ge, Gt, Interval, Le, Lt

from uavbench.scenes.camera import Camera
from uavbench.scenes.renderables import BuiltClutter, BuiltEnvironment, BuiltStructure
from uavbench.scenes.rendering.camera_simulator import CameraSimulator
from uavbench.scenes.structures.as_built import Deviation
from uavbench.trajectories.camera_clock import CameraClock
from uavbench.trajectories.camera_mount import MAIN, Mount, MountSpec
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.paths.recorded import Recorded
from uavbench.trajectories.pose import Array
from uavbench.trajectories.sensors.barometer import Barometer
from uavbench.trajectories.sensors.imu import Imu
from uavbench.trajectories.sensors.optical_flow import FlowDeck
from uavbench.trajectories.sensors.sensor import SensorSpec
from uavbench.trajectories.simulation.flight import FlightSpec


class StructureSpec(Protocol):
    """A structure: parameters, and a method that builds it."""

    def build(self, rng: np.random.Generator) -> BuiltStructure:
        """The structure standing on z = 0; deterministic in rng."""
        ...


class EnvironmentSpec(Protocol):
    """Ground, walls, sky and light around a structure of the given bounds (2, 3) in metres."""

    def build(self, bounds: Array, rng: np.random.Generator) -> BuiltEnvironment:
        """The environment; deterministic in rng."""
        ...


class ClutterSpec(Protocol):
    """Objects around a structure of the given bounds (2, 3) in metres."""

    def build(self, bounds: Array, rng: np.random.Generator) -> BuiltClutter:
        """The clutter; deterministic in rng."""
        ...


class EffectSpec(Protocol):
    """An effect of the camera or its link on the images; effects act in the order of `EFFECTS`, the physical one.

    The class attribute `only_one`, where it is true, says that of two such effects only one would count; `sets`, where
    there is one, names what effects of other kinds must not set, too. Effects with `readout_ms` or `exposure_ms` are as
    short as a frame's period; `margin_px` are rendered beyond the image.
    """

    def start(self, source: CameraSimulator, rng: np.random.Generator) -> CameraSimulator:
        """The camera simulator with the effect applied; each frame is requested once, in order."""
        ...


Annotation = Literal["depth", "mask", "edges", "flow", "normals"]
"""Ground truth of each frame in addition to its pose."""


STEEPEST = 11.43
"""Tangent of the greatest angle from the optical axis to a side of a pinhole image, that of a field of view of 170
degrees."""
LARGEST_SIDE_PX = 16_384
"""Largest width or height of a rendered image in px: that of a framebuffer of OpenGL's software renderer (llvmpipe)."""


@dataclass(frozen=True, kw_only=True)
class CameraSpec:
    """A camera by its field of view, or by explicit intrinsics in px (all four of fx_px fy_px cx_px cy_px).

    The field of view is that of the pinhole without distortion. lens_blur_px is the standard deviation of the lens's
    point spread function, in addition to the pixel area; at 0 rendered edges alias, otherwise a frame takes 16 renders.
    UserError when the intrinsics are incomplete or out of range, or a field of view is given beside them.
    """

    width: Annotated[int, Interval(ge=16, le=LARGEST_SIDE_PX)] = 640
    height: Annotated[int, Interval(ge=16, le=LARGEST_SIDE_PX)] = 480
    horizontal_fov_deg: Annotated[float, Gt(1), Lt(170)] = 78.7
    fx_px: Annotated[float, Gt(0)] | None = None
    fy_px: Annotated[float, Gt(0)] | None = None
    cx_px: float | None = None
    cy_px: float | None = None
    distortion_model: Literal["none", "radtan", "equidistant"] = "none"
    distortion: tuple[float, ...] = ()
    lens_blur_px: Annotated[float, Interval(ge=0, le=5)] = 0.0

    def __post_init__(self) -> None:
        self.camera()

    def camera(self) -> Camera:
        """The calibrated camera; UserError when the intrinsics are incomplete or out of range."""
        explicit = (self.fx_px, self.fy_px, self.cx_px, self.cy_px)
        given = [value for value in explicit if value is not None]
        if given and len(given) < 4:
            raise UserError("give all of fx_px, fy_px, cx_px, cy_px, or none of them and horizontal_fov_deg")
        if given and self.horizontal_fov_deg != CameraSpec.horizontal_fov_deg:
            raise UserError("give either fx_px, fy_px, cx_px, cy_px, or horizontal_fov_deg, not both")
        try:
            if not given:
                plain = Camera.from_field_of_view(self.width, self.height, self.horizontal_fov_deg)
                given = [plain.fx, plain.fy, plain.cx, plain.cy]
            fx, fy, cx, cy = given
            for axis, side, focal, centre in (("x", self.width, fx, cx), ("y", self.height, fy, cy)):
                if not max(abs(centre + 0.5), abs(side - 0.5 - centre)) <= STEEPEST * focal:
                    raise UserError(
                        f"c{axis}_px {centre:g}: with f{axis}_px {focal:g} a side of the image is more than 85 degrees "
                        f"from the optical axis; both are in pixels: give c{axis}_px near the middle of {side} px"
                    )
            return Camera(self.width, self.height, fx, fy, cx, cy, self.distortion_model, self.distortion)
        except ValueError as error:
            raise UserError(str(error)) from None


@dataclass(frozen=True, kw_only=True)
class BodyCamera:
    """A further camera of the vehicle: its name, mount, intrinsics, and exposure offset from the main camera.

    Rate, clock, effects and annotations are those of the main camera; with offset_s = 0 the exposures are simultaneous.
    """

    name: str
    mount: MountSpec = field(default_factory=Mount)
    camera: CameraSpec = field(default_factory=CameraSpec)
    offset_s: Annotated[float, Interval(ge=0, le=10)] = 0.0


CAMERA_NAME = re.compile(r"[a-z][a-z0-9_]{0,39}")
"""Valid name of a further camera: it becomes the name of a folder, and of topics and frames in ROS."""


@dataclass(frozen=True, kw_only=True)
class SequenceSpec:
    """Specification of one sequence: structure, flight, environment, camera and image effects.

    sensors are all sensors on the body; deviation is that of the structure as built from its design; annotations are
    the ground truth written for every frame in addition to its pose; every crlb_every-th frame of the main camera gets
    its Cramer-Rao bound (0: none); neither changes the images. cameras are those in addition to the main one, which
    mount and camera specify and trackers receive; clock triggers and stamps the frames of all of them. UserError for
    duplicate camera names, for cameras that see the same, for recorded poses of a camera that has no fixed mount, for
    effects of which one has no effect or contradicts another, and for exposures, readouts and jitter that do not fit
    the period of a frame.
    """

    name: str
    seed: Annotated[int, Ge(0)]
    structure: StructureSpec
    flight: FlightSpec
    environment: EnvironmentSpec
    mount: MountSpec = field(default_factory=Mount)
    camera: CameraSpec = field(default_factory=CameraSpec)
    clutter: tuple[ClutterSpec, ...] = ()
    effects: tuple[EffectSpec, ...] = ()
    rate_hz: Annotated[float, Gt(0), Le(500)] = 15.0
    sensors: tuple[SensorSpec, ...] = (Imu(), FlowDeck(), Barometer())
    deviation: Deviation = field(default_factory=Deviation)
    annotations: tuple[Annotation, ...] = ()
    crlb_every: Annotated[int, Ge(0)] = 0
    cameras: tuple[BodyCamera, ...] = ()
    clock: CameraClock = field(default_factory=CameraClock)

    def __post_init__(self) -> None:
        names = [camera.name for camera in self.cameras]
        for i, name in enumerate(names):
            if not CAMERA_NAME.fullmatch(name):
                raise UserError(
                    f"cameras[{i}].name {name!r}: use lower-case letters, digits and _, a letter first, 40 at most"
                )
            if name == MAIN or name in names[:i]:
                other = "the main camera" if name == MAIN else f"cameras[{names.index(name)}]"
                raise UserError(f"cameras[{i}].name {name!r}: {other} has this name already; give it another one")
        self._check_views()
        self._check_effects()
        try:
            self.clock.check(self.rate_hz)
        except UserError as error:
            raise UserError(f"clock.{error}") from None
        path = self.flight.path
        if isinstance(path, Recorded) and path.frame == "camera" and not isinstance(self.mount, Mount):
            raise UserError(
                "flight.path.frame 'camera': poses of the body follow from those of a camera only with a fixed mount; "
                "record poses of the body, or choose a fixed mount"
            )

    def _check_views(self) -> None:
        """UserError for a camera that sees what another one sees at the same time."""
        main = BodyCamera(name=MAIN, mount=self.mount, camera=self.camera)
        views = [replace(each, name="") for each in (main, *self.cameras)]
        for i, view in enumerate(views[1:], start=1):
            if (first := views.index(view)) != i:
                other = "the main camera" if first == 0 else f"cameras[{first - 1}]"
                raise UserError(
                    f"cameras[{i - 1}].name {self.cameras[i - 1].name!r}: has mount, lens and offset_s of {other}, and "
                    "sees the same; give it another mount.offset_m, or remove it"
                )

    def _check_effects(self) -> None:
        """UserError for an effect that another replaces or contradicts, and for one longer than a frame's period."""
        period_ms = 1e3 / self.rate_hz
        kinds = [type(effect) for effect in self.effects]
        for i, effect in enumerate(self.effects):
            if (first := kinds.index(kinds[i])) != i and getattr(kinds[i], "only_one", False):
                raise UserError(
                    f"effects[{i}]: is of the kind of effects[{first}], of which only one would count; remove one"
                )
            for j, kind in enumerate(kinds[:i]):
                what = getattr(kind, "sets", None)
                if what is not None and kind is not kinds[i] and what == getattr(kinds[i], "sets", None):
                    raise UserError(f"effects[{i}]: contradicts effects[{j}], since both set the {what}; remove one")
            for key in ("readout_ms", "exposure_ms"):
                if (ms := getattr(effect, key, 0.0)) > period_ms:
                    raise UserError(
                        f"effects[{i}].{key} {ms:g}: is longer than the {period_ms:.3g} ms of a frame at rate_hz "
                        f"{self.rate_hz:g}; lower it, or rate_hz"
                    )
