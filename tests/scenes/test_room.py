"""Flights inside a room: its walls and ceiling are in the way."""

import numpy as np
import pytest

from uavbench.scenes.renderables import Room
from uavbench.scenes.shots.cameras import cameras_of
from uavbench.scenes.shots.confines import check_room
from uavbench.scenes.spec import SequenceSpec
from uavbench.scenes.structures.box import Box
from uavbench.scenes.world.indoor import Indoor
from uavbench.scenes.world.outdoor import Outdoor
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.obstacles import ObstacleMesh
from uavbench.trajectories.paths.around import Hover
from uavbench.trajectories.random_streams import stream
from uavbench.trajectories.simulation.flight import FlightSpec, fly
from uavbench.trajectories.vehicle.registry import AIRFRAMES

BOX = Box().unpainted().structure
AIRFRAME = AIRFRAMES["crazyflie"]()


def room_of(indoor: Indoor) -> Room:
    room = indoor.build(BOX.bounds, stream(0, "environment")).room
    assert room is not None
    return room


@pytest.mark.parametrize(
    ("distance_m", "height_m", "indoor", "refused"),
    [
        (1.2, 1.0, Indoor(), False),
        (3.0, 1.0, Indoor(room_m=3.0), True),  # 1.5 m from the middle to a wall, 2.1 m to a corner
        (3.0, 1.0, Indoor(room_m=8.0), False),
        (1.2, 2.6, Indoor(height_m=2.5), True),
        (1.2, 2.6, Indoor(height_m=3.0), False),
    ],
)
def test_a_flight_through_a_wall_or_the_ceiling_is_refused(
    distance_m: float, height_m: float, indoor: Indoor, refused: bool
) -> None:
    path = Hover(duration_s=0.5, distance_m=distance_m, height_m=height_m)
    flight = FlightSpec(airframe=AIRFRAME, path=path)
    spec = SequenceSpec(name="in", seed=0, structure=Box(), flight=flight, environment=indoor)
    flown = fly(flight, spec.mount, ObstacleMesh(BOX.vertices, BOX.triangles), 0)
    (camera,) = cameras_of(spec)
    if refused:
        with pytest.raises(UserError, match=r"sequence in: camera camera: t = .* of the room, .* environment\.room_m"):
            check_room(spec, camera, room_of(indoor), flown)
    else:
        check_room(spec, camera, room_of(indoor), flown)


def test_a_room_ends_at_its_walls() -> None:
    """Against the mesh of the room: each of its corners is on a wall, and points along the walls' normals are apart."""
    room = room_of(Indoor(room_m=4.0, height_m=2.5))
    parts = Indoor(room_m=4.0, height_m=2.5).build(BOX.bounds, stream(0, "environment")).parts
    corners = np.concatenate([part.vertices for part in parts])
    assert room.to_walls(corners).min() > -0.2  # the reveal of the window lies in the wall
    assert np.isclose(room.to_walls(corners[corners[:, 2] > 2.49]), 0, atol=0.03).any()
    middle = room.place + np.array([0.0, 0.0, 1.0])
    assert room.to_walls(middle[None])[0] == pytest.approx(1.5)
    assert room.to_walls((middle + 1.3 * room.turn[:, 0])[None])[0] == pytest.approx(0.7)
    assert room.to_walls((middle - 2.3 * room.turn[:, 1])[None])[0] == pytest.approx(-0.3)


def test_there_is_no_room_outdoors() -> None:
    assert Outdoor().build(BOX.bounds, stream(0, "environment")).room is None
