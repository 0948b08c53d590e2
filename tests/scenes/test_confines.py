"""What a dry run knows of a scene without building it: its room, its ground, and whether clutter has room."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from uavbench.scenes.clutter.people import People
from uavbench.scenes.clutter.trees import Trees
from uavbench.scenes.scene import build_scene, confines_of
from uavbench.scenes.shots.shots import rehearse
from uavbench.scenes.site.site import Site
from uavbench.scenes.spec import SequenceSpec
from uavbench.scenes.structures.box import Box
from uavbench.scenes.structures.bridge import Bridge
from uavbench.scenes.structures.building import Building
from uavbench.scenes.world.indoor import Indoor
from uavbench.scenes.world.outdoor import Outdoor
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.paths.around import Hover, Orbit
from uavbench.trajectories.simulation.flight import FlightSpec
from uavbench.trajectories.vehicle.registry import AIRFRAMES

PLACES = np.random.default_rng(0).uniform([-60.0, -60.0, 0.0], [60.0, 60.0, 20.0], (2000, 3))
HOVER = FlightSpec(airframe=AIRFRAMES["crazyflie"](), path=Hover(duration_s=0.5, distance_m=1.2, height_m=1.0))
FAR = FlightSpec(
    airframe=AIRFRAMES["iris"](), path=Orbit(distance_m=8.0, height_m=2.0, start_deg=0.0, turns=0.05, speed_m_s=1.0)
)
BOX = SequenceSpec(name="it", seed=3, structure=Box(), flight=HOVER, environment=Indoor())
ON_SITE = replace(BOX, structure=Bridge(), flight=FAR, environment=Outdoor())
CROWD = (People(density=20.0, nearest_m=0.1, furthest_m=0.1000001),)


@pytest.mark.slow
@pytest.mark.parametrize(
    "spec",
    [
        BOX,
        replace(ON_SITE, environment=Outdoor(site=Site(beneath="river", embankments=True))),
        replace(ON_SITE, structure=Building(), environment=Outdoor(site=Site(neighbours=6))),
    ],
    ids=["room", "river", "neighbours"],
)
def test_the_confines_are_those_of_the_scene_that_is_built(spec: SequenceSpec) -> None:
    scene, found = build_scene(spec), confines_of(spec)
    assert (scene.room is None, scene.site is None) == (found.room is None, found.site is None)
    if scene.room and found.room:
        assert scene.room.to_walls(PLACES).tobytes() == found.room.to_walls(PLACES).tobytes()
    if scene.site and found.site:
        ground = PLACES[:, :2]
        assert scene.site.height(ground).tobytes() == found.site.height(ground).tobytes()
        assert scene.site.is_free(ground).tobytes() == found.site.is_free(ground).tobytes()
        assert scene.site.is_hidden(PLACES).tobytes() == found.site.is_hidden(PLACES).tobytes()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"clutter": CROWD}, r"sequence it: clutter\[0\]: no room for object 1 of 200"),
        (
            {"clutter": (Trees(density=0.1, nearest_m=3.0, furthest_m=3.0000001),)},
            r"sequence it: clutter\[0\]: no room for object 1 of 2",
        ),
        ({"environment": Outdoor(site=Site(embankments=True))}, "need a structure that carries a road"),
        ({"environment": Outdoor(site=Site(neighbours=40))}, "40 buildings asked for, but only"),
    ],
)
def test_what_has_no_room_is_told_as_by_the_scene_that_is_built(changed: dict[str, Any], message: str) -> None:
    told = []
    for way in (build_scene, confines_of, rehearse):
        with pytest.raises(UserError, match=message) as error:
            way(replace(BOX, **changed))
        told.append(str(error.value))
    assert len(set(told)) == 1


def test_a_rehearsal_refuses_a_flight_through_a_wall_or_into_the_ground() -> None:
    with pytest.raises(UserError, match=r"sequence it: camera camera: t = .* a wall or the ceiling of the room"):
        rehearse(replace(BOX, environment=Indoor(room_m=2.2)))
    banks = Outdoor(site=Site(embankments=True))
    with pytest.raises(UserError, match=r"sequence it: camera camera: t = .* the ground there is at .* m"):
        rehearse(replace(ON_SITE, environment=banks))
