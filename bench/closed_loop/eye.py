"""The camera in flight: renders frames while the vehicle's trajectory is still being simulated."""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from uavbench.scenes.camera_path import Motion, mounted_path
from uavbench.scenes.filming.film import check_first_view, with_effects
from uavbench.scenes.rendering.camera_simulator import CameraSimulator, SceneRenderer, ideal_camera, render_camera
from uavbench.scenes.scene import Scene
from uavbench.scenes.spec import SequenceSpec
from uavbench.trajectories.pose import Pose
from uavbench.trajectories.record_columns import RECORD
from uavbench.trajectories.simulation.simulate import Simulation
from uavbench.trajectories.vehicle.quadrotor import STEP_NS


class WayFlown:
    """True world_from_body of a flight in progress, up to its current row."""

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation
        self.stamps_ns: NDArray[np.int64] = np.arange(simulation.steps, dtype=np.int64) * STEP_NS

    def __len__(self) -> int:
        return self._simulation.step + 1

    def pose(self, row: int) -> Pose:
        """Pose of a row that has been flown."""
        state = self._simulation.record[row]
        return Pose.from_quaternion(state[RECORD["quaternions_wxyz"]], state[RECORD["positions_m"]])


class CameraInFlight(NamedTuple):
    """The camera in flight: its simulator, and its mount: the true `cam_from_body` at a time (ns)."""

    source: CameraSimulator
    mount: Callable[[int], Pose]


class DrawnScene(Protocol):
    """A scene with a renderer: a `Scene`, or one with another renderer."""

    def renderer(self, width: int, height: int) -> AbstractContextManager[SceneRenderer]:
        """A renderer of the scene, closed when done."""
        ...


def mount_along(spec: SequenceSpec, scene: Scene, way: Motion) -> Callable[[int], Pose]:
    """True `cam_from_body` at a time (ns) of a motion; a gimbal may point at the middle of the structure."""
    return spec.mount.along(way, scene.obstacles.centre)


@contextmanager
def eye(spec: SequenceSpec, scene: DrawnScene, way: Motion, mount: Callable[[int], Pose]) -> Iterator[CameraSimulator]:
    """The camera with every effect of the spec, along a motion of the body; mount: `cam_from_body` at a time (ns)."""
    camera = spec.camera.camera()
    pinhole, lens = render_camera(camera, max((getattr(e, "margin_px", 0) for e in spec.effects), default=0))
    with scene.renderer(pinhole.width, pinhole.height) as renderer:
        path = mounted_path(way, mount)
        ideal = ideal_camera(renderer, camera, pinhole, lens, path, spec.camera.lens_blur_px)
        check_first_view(spec, ideal)
        yield with_effects(ideal, spec.effects, spec.seed)


def exposed_after_ns(spec: SequenceSpec, source: CameraSimulator) -> int:
    """Time in ns from a frame's stamp until its exposure ends."""
    exposed_ms = max((getattr(effect, "exposure_ms", 0.0) for effect in spec.effects), default=0.0)
    readout_ns = abs(source.row_delay_ns) * (source.camera.height - 1)
    return int(np.ceil(0.5e6 * exposed_ms + 0.5 * readout_ns))
