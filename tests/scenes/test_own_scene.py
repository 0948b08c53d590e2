"""Structures, environments and clutter of users: what would be drawn wrong, or not as trackers get it, is told."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from uavbench.scenes.own_scene import clutter_same_twice, own_clutter, own_environment, own_structure, same_twice
from uavbench.scenes.renderables import BuiltClutter, BuiltEnvironment, BuiltSite, BuiltStructure, Mover, nowhere
from uavbench.scenes.scene import build_scene, confines_of, obstacles_of
from uavbench.scenes.spec import SequenceSpec
from uavbench.scenes.structure import Structure
from uavbench.scenes.structures.box import Box
from uavbench.scenes.structures.building import Building
from uavbench.scenes.structures.truss import Truss
from uavbench.scenes.world.indoor import Indoor
from uavbench.scenes.world.outdoor import Outdoor
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.paths.around import Hover
from uavbench.trajectories.pose import Pose
from uavbench.trajectories.simulation.flight import FlightSpec

BOX = Box().build(np.random.default_rng(0))
ROOM = Indoor().build(BOX.structure.bounds, np.random.default_rng(0))
TREE = replace(BOX.parts[0], instance=7, name="tree")


@dataclass(frozen=True)
class Own:
    """A plug-in of a user."""


@dataclass(frozen=True)
class GlobalRandom:
    """A structure that does not take its random numbers from `rng`."""

    def build(self, rng: np.random.Generator) -> BuiltStructure:
        return Box(width_m=0.3 + 0.1 * np.random.random()).build(rng)  # noqa: NPY002


def with_parts(**changes: Callable[[Any], Any]) -> BuiltStructure:
    return replace(
        BOX, parts=tuple(replace(part, **{key: of(part) for key, of in changes.items()}) for part in BOX.parts)
    )


def with_structure(vertices: np.ndarray, triangles: np.ndarray) -> BuiltStructure:
    return replace(BOX, structure=Structure.from_mesh(vertices, triangles))


@pytest.mark.parametrize("kind", [Box, Building, Truss])
def test_a_structure_whose_edges_are_drawn_is_taken_as_it_is(kind: Any) -> None:
    built = kind().build(np.random.default_rng(3))
    found = own_structure(Own(), replace(built, parts=iter(built.parts)))
    assert found.parts == built.parts and found.structure is built.structure


def test_a_structure_may_have_parts_of_other_instances_and_of_no_triangles() -> None:
    bare = replace(BOX.parts[0], instance=1, triangles=np.zeros((0, 3), dtype=np.int64))
    label = [replace(part, instance=2) for part in BOX.parts]
    sign = replace(BOX.parts[0], instance=1)
    assert own_structure(Own(), replace(BOX, parts=(bare, *label, sign))).parts == (*label, sign)


def test_what_differs_between_two_builds_of_one_seed_is_told() -> None:
    fickle, calls = np.random.default_rng(1), []

    def build(rng: np.random.Generator, wide: float) -> BuiltStructure:
        calls.append(wide)
        return own_structure(Own(), Box(width_m=0.3 + 0.1 * wide).build(rng))

    with pytest.raises(UserError, match=r"test_own_scene:Own: build gives something else each time; take all random"):
        same_twice(Own(), lambda: build(np.random.default_rng(0), float(fickle.random())))
    drawn = same_twice(Own(), lambda: build(np.random.default_rng(0), 0.5))
    assert len(calls) == 4 and drawn.structure.bounds[1, 1] == pytest.approx(0.175)
    with pytest.raises(UserError, match="something else each time"):
        same_twice(Own(), lambda: replace(BOX, parts=(replace(BOX.parts[0], tint=fickle.random((1, 4))),)))


def test_a_users_structure_of_global_random_numbers_is_told_before_it_is_rendered() -> None:
    spec = SequenceSpec(
        name="box", seed=0, structure=GlobalRandom(), environment=Indoor(), flight=FlightSpec(path=Hover())
    )
    with pytest.raises(UserError, match="GlobalRandom: build gives something else each time"):
        obstacles_of(spec)


def test_movers_that_go_elsewhere_in_a_second_build_are_told() -> None:
    fickle = np.random.default_rng(1)

    def build(speed: float) -> BuiltClutter:
        return BuiltClutter(movers=(Mover(BOX.parts[0], lambda t: Pose(np.eye(3), np.array([speed * t, 0, 0]))),))

    assert same_twice(Own(), lambda: build(0.5)).movers
    with pytest.raises(UserError, match="something else each time"):
        same_twice(Own(), lambda: build(float(fickle.random())))


@pytest.mark.parametrize("drawn", [np.random.random, iter(range(1, 99)).__next__])
def test_a_mover_whose_poses_become_random_later_is_told_when_it_is_drawn(drawn: Any) -> None:
    def moved(time_s: float) -> Pose:
        return Pose(np.eye(3), np.array([drawn() if time_s > 3 else time_s, 0, 0]))

    (mover,) = clutter_same_twice(Own(), lambda: BuiltClutter(movers=(Mover(BOX.parts[0], moved),))).movers
    assert mover.world_from_part(2.0).translation[0] == 2.0
    with pytest.raises(UserError, match=r"clutter .*:Own: movers\[0\]: world_from_part gives two poses for 3\.500 s"):
        mover.world_from_part(3.5)


@dataclass(frozen=True)
class GlobalLight:
    """An environment whose light, or ground, is not drawn from the generators given to it."""

    what: str

    def build(self, bounds: Any, rng: np.random.Generator) -> BuiltEnvironment:
        drawn = np.random.random()  # noqa: NPY002
        if self.what == "light":
            return replace(ROOM, light=replace(ROOM.light, haze_per_m=1e-3 * drawn))
        return replace(ROOM, site=self.site if self.what == "site" else None)

    def site(self, built: BuiltStructure, streams: Any) -> BuiltSite:
        shifted = replace(built.parts[0], vertices=built.parts[0].vertices + np.random.random())  # noqa: NPY002
        return BuiltSite((shifted,), built.parts, lambda at: np.zeros(len(at)), nowhere)


@pytest.mark.parametrize("what", ["light", "site", ""])
def test_a_users_environment_of_global_random_numbers_is_told(what: str) -> None:
    spec = SequenceSpec(
        name="box", seed=0, structure=Box(), environment=GlobalLight(what), flight=FlightSpec(path=Hover())
    )
    for make in (confines_of, build_scene):
        if what:
            with pytest.raises(UserError, match="GlobalLight: build gives something else each time"):
                make(spec)
        else:
            make(spec)


@pytest.mark.parametrize(("built", "told"), [
    (None, "build gives a NoneType; it takes a BuiltStructure"),
    ((BOX.structure, BOX.parts), "build gives a tuple; it takes a BuiltStructure"),
    (with_parts(vertices=lambda p: p.vertices * 1000), "of the edges .* lie more than 0.02 m beside the parts"),
    (with_parts(vertices=lambda p: p.vertices + 0.3 * np.eye(3)[0]), "that trackers get lie more than 0.02 m bes"),
    (with_parts(vertices=lambda p: p.vertices * [1, 1, 0.5]), "give both in metres and in the same frame"),
    (with_structure(BOX.structure.vertices * 1000, BOX.structure.triangles), "100% of the edges that trackers get"),
    (with_structure(BOX.structure.vertices, BOX.structure.triangles[:, ::-1]), "its Structure is inside out; list the"),
    (with_parts(instance=lambda _: 0), "none of its parts has instance = 1"),
    (replace(BOX, parts=()), "none of its parts has instance = 1"),
    (with_parts(texture=lambda p: p.texture / 255), r"parts.0.: its texture is float64 .*; it takes uint8 .h, w, 3 or"),
    (with_parts(vertices=lambda p: p.vertices * np.nan), "its vertices are .*; they take finite numbers"),
    (with_parts(uv=lambda p: p.uv[:-1]), "its uv are .*; they take finite numbers .*, one row a vertex"),
    (with_parts(triangles=lambda p: p.triangles + 1), "its triangles are .*; they take integers from 0 to"),
    (with_parts(triangles=lambda p: p.triangles.astype(float)), "its triangles are float64 .*; they take integers"),
])  # fmt: skip
def test_a_structure_that_is_not_drawn_as_trackers_get_it_is_told(built: Any, told: str) -> None:
    with pytest.raises(UserError, match=rf"structure .*test_own_scene:Own: .*{told}"):
        own_structure(Own(), built)


def noise(_: float) -> Pose:
    return Pose(np.eye(3), np.random.default_rng().normal(size=3))


@pytest.mark.parametrize(("built", "told"), [
    ((TREE,), "build gives a tuple; it takes a BuiltClutter"),
    (BuiltClutter((replace(TREE, instance=1),)), r"parts.0.: instance = 1 is the structure's; clutter has 2 to 255"),
    (BuiltClutter((replace(TREE, instance=300),)), r"parts.0. .tree.: instance = 300: must be a whole"),
    (BuiltClutter((replace(TREE, instance=-1),)), "instance = -1: must be a whole number"),
    (BuiltClutter((replace(TREE, instance=2.7),)), "instance = 2.7: must be a whole number"),  # type: ignore[arg-type]
    (BuiltClutter((), (Mover(replace(TREE, instance=1), lambda t: Pose.identity()),)), "movers: parts.0.: instance"),
    (BuiltClutter((), (Mover(TREE, lambda t: np.eye(4)),)), "gives a float64 .4, 4.; it takes a Pose"),  # type: ignore
    (BuiltClutter((), (Mover(TREE, noise),)), "movers.0.: world_from_part gives two poses for one time; draw random"),
])  # fmt: skip
def test_clutter_that_would_count_as_something_else_is_told(built: Any, told: str) -> None:
    with pytest.raises(UserError, match=rf"clutter .*:Own: .*{told}"):
        own_clutter(Own(), built)


def test_clutter_may_come_as_a_generator() -> None:
    """Its parts are drawn, and then traced for ranges and annotations."""
    found = own_clutter(Own(), BuiltClutter(part for part in (TREE, TREE)))  # type: ignore[arg-type]
    assert found.parts == (TREE, TREE)


def with_light(**keys: Any) -> BuiltEnvironment:
    return replace(ROOM, light=replace(ROOM.light, **keys))


@pytest.mark.parametrize(("built", "told"), [
    (None, "build gives a NoneType; it takes a BuiltEnvironment"),
    (with_light(above=(255.0, 255.0, 255.0)), "light.above = .*: must be three numbers of linear light from 0 to 100"),
    (with_light(lamp=(float("nan"), 1.0, 1.0)), "light.lamp = .*: must be three numbers of linear light"),
    (with_light(to_lamp=(0.0, 0.0, 0.0)), "light.to_lamp = .*: must be a direction"),
    (replace(ROOM, sky=np.ones((8, 16, 3))), "its sky is float64 .8, 16, 3.; it takes uint8 .h, 2h, 3."),  # type: ignore
])  # fmt: skip
def test_light_that_leaves_images_black_or_white_is_told(built: Any, told: str) -> None:
    with pytest.raises(UserError, match=rf"environment .*:Own: .*{told}"):
        own_environment(Own(), built)


@pytest.mark.parametrize("kind", [Indoor, Outdoor])
def test_an_environment_that_can_be_drawn_is_taken_as_it_is(kind: Any) -> None:
    built = kind().build(BOX.structure.bounds, np.random.default_rng(0))
    assert own_environment(Own(), built).parts == built.parts
