"""What the cameras of a spec take along a flight, with a scene or before there is one."""

from collections.abc import Callable
from dataclasses import dataclass

from uavbench.scenes.renderables import Confines
from uavbench.scenes.rendering.camera_simulator import RenderCamera
from uavbench.scenes.scene import confines_of, obstacles_of
from uavbench.scenes.shots.cameras import cameras_of, exposures_of, lens_of
from uavbench.scenes.shots.confines import check_confines, check_further_camera
from uavbench.scenes.shots.targets import missed_targets
from uavbench.scenes.spec import SequenceSpec
from uavbench.trajectories.camera_clock import Exposures
from uavbench.trajectories.obstacles import ObstacleMesh
from uavbench.trajectories.pose import Pose
from uavbench.trajectories.sensors.registry import check_places
from uavbench.trajectories.simulation.flight import Flight, fly


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
    mounts = [camera.mount.along(flight, obstacles.centre) for camera in cameras]
    return Shots(exposures, lenses, mounts, missed_targets(spec, mounts, [each.times_ns for each in exposures]))


def rehearse(spec: SequenceSpec) -> list[str]:
    """Fly a sequence whose scene is not built, and return what its gimbals do not reach.

    UserError as `generate`, for everything but the images.
    """
    confines, obstacles = confines_of(spec), obstacles_of(spec)
    flight = fly(spec.flight, spec.mount.at_rest, obstacles, spec.seed)
    shots = shots_of(spec, obstacles, flight, confines)
    check_places(spec.sensors, flight, obstacles)
    return shots.missed
