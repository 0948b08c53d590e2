"""The cameras of a spec: which, when they expose, through which lens."""

from uavbench.scenes.rendering.camera_simulator import RenderCamera, render_camera
from uavbench.scenes.spec import BodyCamera, SequenceSpec
from uavbench.trajectories.camera_clock import Exposures
from uavbench.trajectories.camera_mount import MAIN
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.random_streams import stream
from uavbench.trajectories.simulation.flight import Flight


def cameras_of(spec: SequenceSpec) -> list[BodyCamera]:
    """The cameras of a spec, the main one first."""
    return [BodyCamera(name=MAIN, mount=spec.mount, camera=spec.camera), *spec.cameras]


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
