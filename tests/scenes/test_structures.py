from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.scenes.conftest import looking
from uavbench.scenes.camera import Camera
from uavbench.scenes.clutter.placing import ring_places
from uavbench.scenes.clutter.registry import CLUTTER
from uavbench.scenes.model_files.mesh_checks import closedness
from uavbench.scenes.primitives.solids import ear_clip
from uavbench.scenes.renderables import Mover
from uavbench.scenes.scene import _environment, build_scene
from uavbench.scenes.spec import SequenceSpec
from uavbench.scenes.structures.as_built import Deviation
from uavbench.scenes.structures.box import Box
from uavbench.scenes.structures.bridge import Bridge
from uavbench.scenes.structures.building import Building
from uavbench.scenes.structures.checkerboard import Checkerboard
from uavbench.scenes.structures.registry import STRUCTURES
from uavbench.scenes.structures.truss import Truss
from uavbench.scenes.structures.wall import Wall
from uavbench.scenes.world.indoor import Indoor
from uavbench.scenes.world.outdoor import Outdoor
from uavbench.scenes.world.registry import ENVIRONMENTS
from uavbench.scenes.world.studio import Studio
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.paths.pilot.hand_pilot import HandPilot
from uavbench.trajectories.pose import Array
from uavbench.trajectories.random_streams import stream
from uavbench.trajectories.simulation.flight import FlightSpec

PARAMETRIC = [name for name in STRUCTURES if name != "mesh"]


def rng(seed: int = 3) -> np.random.Generator:
    return np.random.default_rng(seed)


@pytest.mark.parametrize("name", PARAMETRIC)
def test_a_structure_is_closed_stands_on_the_ground_and_has_true_edges(name: str) -> None:
    built = STRUCTURES[name]().build(rng())
    structure = built.structure
    borders, volume = closedness(structure.vertices, structure.triangles)
    assert borders == 0
    assert volume > 0
    assert structure.bounds[0, 2] == pytest.approx(0.0, abs=1e-9)
    assert np.abs(structure.bounds[:, :2].mean(axis=0)).max() < 0.1 * np.ptp(structure.bounds[:, :2])
    first, second = (structure.face_normals[structure.edge_faces[:, k]] for k in (0, 1))
    assert (structure.edge_faces >= 0).all()
    assert (np.einsum("ij,ij->i", first, second) < np.cos(np.radians(15.0)) + 1e-9).all()
    assert all(part.instance == 1 and part.texture is not None for part in built.parts)
    assert all(part.texture is not None and part.texture.std() > 2 for part in built.parts if part.name != "board")


@pytest.mark.slow
@pytest.mark.parametrize("name", PARAMETRIC)
def test_the_same_rng_builds_the_same_structure(name: str) -> None:
    first, second = (STRUCTURES[name]().build(rng()) for _ in range(2))
    assert np.array_equal(first.structure.vertices, second.structure.vertices)
    for a, b in zip(first.parts, second.parts, strict=True):
        assert a.texture is not None
        assert b.texture is not None
        assert np.array_equal(a.vertices, b.vertices)
        assert np.array_equal(a.texture, b.texture)


@pytest.mark.parametrize("built", [Box(), Wall(), Building(), Truss(), Bridge(), Checkerboard()])
def test_what_is_drawn_lies_where_the_model_is(built: Box) -> None:
    thing = built.build(rng())
    drawn = np.concatenate([part.vertices for part in thing.parts])
    assert np.abs(np.array([drawn.min(axis=0), drawn.max(axis=0)]) - thing.structure.bounds).max() < 1e-3


def test_a_box_has_twelve_edges_of_its_own_lengths() -> None:
    structure = Box(0.5, 0.3, 0.2).build(rng()).structure
    lengths = np.linalg.norm(np.diff(structure.edge_segments, axis=1)[:, 0], axis=1)
    assert sorted(np.round(lengths, 9).tolist()) == [0.2] * 4 + [0.3] * 4 + [0.5] * 4


def test_a_concave_polygon_is_cut_into_its_own_area() -> None:
    profile = np.array([(0, 0), (4, 0), (4, 1), (1, 1), (1, 3), (4, 3), (4, 4), (0, 4)], dtype=float)
    a, b, c = (profile[ear_clip(profile)[:, k]] for k in range(3))
    areas = np.cross(np.pad(b - a, ((0, 0), (0, 1))), np.pad(c - a, ((0, 0), (0, 1))))[:, 2] / 2
    assert (areas > 0).all()
    assert areas.sum() == pytest.approx(10.0)


def test_deviations_are_seeded_recorded_and_as_large_as_asked() -> None:
    built = Wall(bays=6, storeys=3, width_m=18.0, height_m=9.0).build(rng())
    bounds = built.structure.bounds
    deviation = Deviation(scale_percent=1.0, displaced_share=0.5, displaced_m=0.05, missing_share=0.3, bend_m=0.1)
    parts, record = deviation.apply(built.parts, bounds, rng(5))
    again, same = deviation.apply(built.parts, bounds, rng(5))
    assert record == same
    assert all(np.array_equal(a.vertices, b.vertices) for a, b in zip(parts, again, strict=True))
    missing = sum(key.startswith("missing") for key in record)
    assert len(parts) == len(built.parts) - missing
    assert missing > 0
    assert any(key.startswith("displaced_m: sill") for key in record)
    assert {"scale_x", "scale_y", "scale_z", "bend_m"} <= set(record)


@pytest.mark.parametrize("key", ["displaced_share", "missing_share"])
def test_a_share_of_the_pieces_of_a_structure_that_has_none_is_told(key: str) -> None:
    built, deviation = Box().build(rng()), Deviation(**{key: 0.3})
    with pytest.raises(UserError, match=rf"deviation\.{key} 0\.3: the structure has no pieces beside its largest one"):
        deviation.apply(built.parts, built.structure.bounds, rng())


def test_no_deviation_changes_nothing() -> None:
    built = Box().build(rng())
    parts, record = Deviation().apply(built.parts, built.structure.bounds, rng())
    assert record == {}
    assert all(a is b for a, b in zip(parts, built.parts, strict=True))


@pytest.mark.parametrize("name", ["indoor", "outdoor"])
def test_an_environment_surrounds_the_structure_and_is_seeded(name: str) -> None:
    bounds = np.array([[-1.0, -1.0, 0.0], [1.0, 1.0, 1.5]])
    first, second = (ENVIRONMENTS[name]().build(bounds, rng()) for _ in range(2))
    assert all(np.array_equal(a.vertices, b.vertices) for a, b in zip(first.parts, second.parts, strict=True))
    low = np.min([part.vertices.min(axis=0) for part in first.parts], axis=0)
    high = np.max([part.vertices.max(axis=0) for part in first.parts], axis=0)
    assert (low[:2] < bounds[0, :2] - 1).all()
    assert (high > bounds[1]).all()
    assert first.light == second.light


def test_a_studio_shows_each_face_in_one_colour_before_another() -> None:
    """The colours of a box in it, seen from above a corner: three faces and what is behind, and nothing else."""
    spec = SequenceSpec(
        name="plain", seed=1, structure=Box(), environment=Studio(backdrop=0.04), flight=FlightSpec(path=HandPilot())
    )
    scene, camera = build_scene(spec), Camera(160, 120, 150.0, 150.0, 79.5, 59.5)
    with scene.renderer(camera.width, camera.height) as renderer:
        image = renderer.color(looking((0.6, -0.7, 0.9), (0.0, 0.0, 0.15)), camera)
    colours, counts = np.unique(image.reshape(-1, 3), axis=0, return_counts=True)
    often = colours[counts > 300].astype(int)
    assert len(often) == 4
    assert (often == round(255 * 0.2)).all(axis=1).sum() == 1
    assert min(np.abs(a - b).max() for i, a in enumerate(often) for b in often[:i]) > 15


def test_a_scene_that_was_used_leaves_the_structure_as_it_was() -> None:
    """Scenes of the same parameters share it, whatever was made of it in between."""
    deviation = Deviation(scale_percent=1.0, bend_m=0.1)
    spec = SequenceSpec(
        name="plain", seed=4, structure=Box(), environment=Studio(), flight=FlightSpec(path=HandPilot())
    )
    new = spec.structure.build(stream(4, "structure"))
    with build_scene(replace(spec, environment=Indoor(), deviation=deviation)).renderer(64, 48) as renderer:
        renderer.color(looking((0.6, -0.7, 0.9), (0.0, 0.0, 0.15)), Camera(64, 48, 60.0, 60.0, 31.5, 23.5))
    again, other = build_scene(replace(spec, environment=Indoor())).built, build_scene(replace(spec, seed=5)).built
    assert np.array_equal(again.structure.vertices, new.structure.vertices)
    for one, two, third in zip(again.parts, new.parts, other.parts, strict=True):
        assert np.array_equal(one.vertices, two.vertices)
        assert one.texture is not None and two.texture is not None and third.texture is not None
        assert np.array_equal(one.texture, two.texture)
        assert third.texture.shape != two.texture.shape  # of one colour, as in a studio


@pytest.mark.parametrize("name", ["indoor", "outdoor"])
def test_a_scene_that_was_used_leaves_its_environment_as_it_was(name: str) -> None:
    environment, flight = ENVIRONMENTS[name](), FlightSpec(path=HandPilot())
    spec = SequenceSpec(name="it", seed=4, structure=Box(), environment=environment, flight=flight)
    scene = build_scene(replace(spec, clutter=(CLUTTER["lookalikes"](density=0.1),)))
    with scene.renderer(64, 48) as renderer:
        renderer.color(looking((0.6, -0.7, 0.9), (0.0, 0.0, 0.15)), Camera(64, 48, 60.0, 60.0, 31.5, 23.5))
    again = _environment(spec, scene.built.structure.bounds)
    new = environment.build(scene.built.structure.bounds, stream(4, "environment"))
    other = _environment(replace(spec, seed=5), scene.built.structure.bounds)
    assert again is _environment(spec, scene.built.structure.bounds)
    assert again.light == new.light != other.light
    assert (again.sky is None) == (new.sky is None) and np.array_equal(again.sky, new.sky)
    for one, two in zip(again.parts, new.parts, strict=True):
        assert np.array_equal(one.vertices, two.vertices) and np.array_equal(one.texture, two.texture)
        assert (one.tint is None) == (two.tint is None) and np.array_equal(one.tint, two.tint)


def test_clouds_and_sun_change_the_sky_and_the_light() -> None:
    bounds = np.array([[-1.0, -1.0, 0.0], [1.0, 1.0, 1.5]])
    clear = Outdoor(cloudiness=0.0, sun_azimuth_deg=0.0).build(bounds, rng())
    grey = Outdoor(cloudiness=1.0, sun_azimuth_deg=0.0).build(bounds, rng())
    assert clear.sky is not None
    assert grey.sky is not None
    upper = slice(0, 300)
    assert np.ptp(clear.sky[upper].mean(axis=(0, 1))) > np.ptp(grey.sky[upper].mean(axis=(0, 1)))
    assert sum(grey.light.lamp) < 0.1 * sum(clear.light.lamp)
    assert clear.light.to_lamp[0] > 0.5


def test_a_room_grows_with_its_structure() -> None:
    bounds = np.array([[-5.0, -5.0, 0.0], [5.0, 5.0, 6.0]])
    parts = Indoor().build(bounds, rng()).parts
    assert max(part.vertices[:, 2].max() for part in parts) > 6.0


@pytest.mark.parametrize("name", list(CLUTTER))
def test_clutter_keeps_its_number_its_distance_and_its_seed(name: str) -> None:
    bounds = np.array([[-0.5, -0.5, 0.0], [0.5, 0.5, 1.0]])
    assert CLUTTER[name](density=0.0).build(bounds, rng()).parts == ()
    first, second = (CLUTTER[name](density=1.0).build(bounds, rng()) for _ in range(2))
    assert all(np.array_equal(a.vertices, b.vertices) for a, b in zip(first.parts, second.parts, strict=True))
    assert len(first.parts) + len(first.movers) > 0
    for part in first.parts:
        assert part.instance > 1
        inside = (np.abs(part.vertices[:, :2]) < 0.5).all(axis=1)
        assert not inside.any()


@pytest.mark.parametrize("name", ["people", "birds"])
def test_what_moves_moves_without_jumps(name: str) -> None:
    bounds = np.array([[-0.5, -0.5, 0.0], [0.5, 0.5, 1.0]])
    movers: tuple[Mover, ...] = CLUTTER[name](density=1.0).build(bounds, rng()).movers
    assert movers
    for mover in movers:
        places = np.array([mover.world_from_part(t).translation for t in np.arange(0, 5, 0.02)])
        steps = [float(np.linalg.norm(b - a)) for a, b in pairwise(places)]
        assert max(steps) < 0.25
        assert sum(steps) > 1.0


def test_where_there_is_no_room_that_is_told() -> None:
    bounds = np.array([[-2.0, -1.0, 0.0], [2.0, 1.0, 1.0]])

    def third_is_not(places: Array) -> NDArray[np.bool_]:
        room = len(taken) < 2
        taken.extend([0] * room)
        return np.full(len(places), room)

    taken: list[int] = []
    told = r"no room for object 3 of 4: of 100,000 positions .* 1 to 5 m from the structure; raise furthest_m, or lower"
    with pytest.raises(UserError, match=told):
        ring_places(bounds, 4, (1.0, 5.0), rng(), third_is_not)


def test_places_are_evenly_outside_the_bounds() -> None:
    bounds = np.array([[-2.0, -1.0, 0.0], [2.0, 1.0, 1.0]])
    places = ring_places(bounds, 400, (1.0, 5.0), rng())
    gap = np.linalg.norm(
        np.maximum(np.maximum(bounds[0, :2] - places[:, :2], places[:, :2] - bounds[1, :2]), 0), axis=1
    )
    assert gap.min() >= 1.0
    assert gap.max() <= 5.0
    assert (places[:, 0] > 0).mean() == pytest.approx(0.5, abs=0.1)


@pytest.mark.parametrize("name", PARAMETRIC)
def test_an_unpainted_structure_has_the_geometry_of_the_painted_one(name: str) -> None:
    painted, unpainted = STRUCTURES[name]().build(rng()), STRUCTURES[name]().unpainted()
    assert unpainted.structure.vertices.tobytes() == painted.structure.vertices.tobytes()
    assert unpainted.structure.edges.tobytes() == painted.structure.edges.tobytes()
    assert unpainted.road == painted.road
    for bare, part in zip(unpainted.parts, painted.parts, strict=True):
        assert bare.name == part.name
        assert bare.vertices.tobytes() == part.vertices.tobytes()
