"""Where a flight may be: above the ground, before the neighbours, within the room, outside the structure."""

import numpy as np

from uavbench.scenes.renderables import BuiltSite, Confines, Room
from uavbench.scenes.shots.cameras import cameras_of
from uavbench.scenes.spec import BodyCamera, SequenceSpec
from uavbench.trajectories import reproducible_math as exact
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.obstacles import ObstacleMesh
from uavbench.trajectories.pose import Array, rotation_from_quaternion
from uavbench.trajectories.simulation.checks import check_camera
from uavbench.trajectories.simulation.flight import Flight

LEAST_ABOVE_GROUND_M = 0.1
"""Least height of a camera above the ground of a site, metres; the renderer's near plane is at 0.05 m."""
LEAST_TO_WALLS_M = 0.1
"""Least distance of a camera and of the vehicle's middle from the walls and the ceiling of a room, metres."""


def check_confines(spec: SequenceSpec, flight: Flight, confines: Confines) -> None:
    """UserError when a flight leaves the site or the room of its scene."""
    for camera in cameras_of(spec):
        check_site(spec, camera, confines.site, flight)
        check_room(spec, camera, confines.room, flight)


def check_site(spec: SequenceSpec, camera: BodyCamera, site: BuiltSite | None, flight: Flight) -> None:
    """UserError when a camera comes closer than LEAST_ABOVE_GROUND_M to the ground of a site, or behind a neighbour."""
    if site is None:
        return
    centres = _centres(camera, flight)
    under = site.height(centres[:, :2]) + LEAST_ABOVE_GROUND_M - centres[:, 2]
    if (under > 0).any():
        row = int(np.argmax(under))
        ground_m = centres[row, 2] + under[row] - LEAST_ABOVE_GROUND_M
        raise UserError(
            f"{_place(spec, camera, flight, row, centres[row])}: the ground there is at {ground_m:.2f} m; move the "
            "path, or remove environment.site.embankments"
        )
    if (hidden := site.is_hidden(centres)).any():
        row = int(np.argmax(hidden))
        raise UserError(
            f"{_place(spec, camera, flight, row, centres[row])}: a neighbouring building stands there or before the "
            "structure; keep the path nearer, or raise environment.site.neighbours_from_m"
        )


def check_room(spec: SequenceSpec, camera: BodyCamera, room: Room | None, flight: Flight) -> None:
    """UserError when a camera or the vehicle comes closer than LEAST_TO_WALLS_M to a wall or the ceiling of a room."""
    if room is None:
        return
    to_walls = np.minimum(room.to_walls(flight.positions_m), room.to_walls(_centres(camera, flight)))
    row = int(np.argmin(to_walls))
    if to_walls[row] < LEAST_TO_WALLS_M:
        raise UserError(
            f"{_place(spec, camera, flight, row, flight.positions_m[row])}: a wall or the ceiling of the room, "
            f"{room.side_m:.1f} m wide and {room.height_m:.1f} m high, is in the way; raise environment.room_m or "
            "environment.height_m, or bring the path nearer"
        )


def check_further_camera(spec: SequenceSpec, camera: BodyCamera, obstacles: ObstacleMesh, flight: Flight) -> None:
    """UserError when a further camera enters the structure or passes below the floor."""
    try:
        check_camera(flight.positions_m, flight.quaternions_wxyz, camera.mount.at_rest, obstacles)
    except UserError as error:
        raise UserError(f"sequence {spec.name}: camera {camera.name}: {error}") from None


def _place(spec: SequenceSpec, camera: BodyCamera, flight: Flight, row: int, at: Array) -> str:
    """Whose camera is where, and when, for an error."""
    x, y, z = at
    when_s = flight.stamps_ns[row] * 1e-9
    return f"sequence {spec.name}: camera {camera.name}: t = {when_s:.2f} s, at ({x:.2f}, {y:.2f}, {z:.2f}) m"


def _centres(camera: BodyCamera, flight: Flight) -> Array:
    """Centres (n, 3) of a camera along a flight, m."""
    offset_m = camera.mount.at_rest.cam_from_body.inverse().translation
    turned: Array = exact.product(rotation_from_quaternion(flight.quaternions_wxyz), offset_m)
    return flight.positions_m + turned
