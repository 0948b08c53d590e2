"""Neighbours, cloud shadow, wet ground and dirt: what they change, what they leave alone, and what is refused."""

from dataclasses import replace
from functools import lru_cache, partial

import numpy as np
import pytest

from tests.scenes.conftest import FLAT_LIGHT, looking, white_box
from uavbench.scenes.camera import Camera
from uavbench.scenes.materials import painted as materials
from uavbench.scenes.materials.painted import Material
from uavbench.scenes.primitives.solids import block, cover_all, structure_of
from uavbench.scenes.renderables import BuiltSite, BuiltStructure, CloudShadow, Film, Light, Part
from uavbench.scenes.rendering.radiance import RENDERED
from uavbench.scenes.rendering.renderer import Renderer
from uavbench.scenes.rendering.shaders import WET_GAIN, WET_INNER, diffuse_reflectance
from uavbench.scenes.shots.cameras import cameras_of
from uavbench.scenes.shots.confines import check_site
from uavbench.scenes.site.clouds import cloud_shadow
from uavbench.scenes.site.film import STANDING, film
from uavbench.scenes.site.neighbours import STOREY_M, STOREYS, Neighbours, neighbours
from uavbench.scenes.site.site import Site
from uavbench.scenes.site.terrain import Terrain
from uavbench.scenes.spec import SequenceSpec
from uavbench.scenes.structures import facade
from uavbench.scenes.structures.bridge import Bridge
from uavbench.scenes.world.outdoor import Outdoor
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.obstacles import ObstacleMesh
from uavbench.trajectories.paths.around import Hover
from uavbench.trajectories.random_streams import stream
from uavbench.trajectories.simulation.flight import FlightSpec, fly
from uavbench.trajectories.vehicle.registry import AIRFRAMES

PLAIN = Material(np.full((1, 1, 3), 100, dtype=np.uint8), (1.0, 1.0))
GLASSY = Material(np.full((1, 1, 3), 60, dtype=np.uint8), (1.0, 1.0), 0.25)
CAMERA = Camera(64, 48, 60.0, 60.0, 32.0, 24.0)
SUN = Light(to_lamp=(0.3, -0.4, 0.8), lamp=(0.5,) * 3, above=(0.2,) * 3, below=(0.1,) * 3)


@pytest.fixture(autouse=True)
def one_paint(monkeypatch: pytest.MonkeyPatch) -> None:
    """Plain materials: painting takes seconds, and no test here looks at it."""
    for name in ("gravel", "asphalt", "concrete", "painted_steel", "brick", "plaster"):
        monkeypatch.setattr(materials, name, lambda *_, **__: Material(PLAIN.texture.copy(), (1.0, 1.0)))
    monkeypatch.setattr(facade.materials, "window", lambda *_, **__: GLASSY)
    monkeypatch.setattr(facade.materials, "door", lambda *_, **__: GLASSY)


@lru_cache
def hut() -> BuiltStructure:
    """A block of 8 x 0.4 x 4 m with a coping."""
    solids = [
        block((-4.0, 0.0, 0.0), (4.0, 0.4, 4.0), PLAIN, "wall"),
        block((-4.1, -0.1, 4.0), (4.1, 0.5, 4.2), PLAIN, "coping"),
    ]
    return BuiltStructure(structure_of(solids), cover_all(solids))


def site_of(site: Site, seed: int = 3, built: BuiltStructure | None = None) -> BuiltSite:
    return site.build(PLAIN, built or hut(), partial(stream, seed, "site"))


def blocks_of(site: BuiltSite) -> list[Part]:
    return [part for part in site.parts if part.distant]


def floor(**more: object) -> Part:
    """White level ground of 40 x 40 m."""
    at = np.array([[-20.0, -20.0, 0.0], [20.0, -20.0, 0.0], [20.0, 20.0, 0.0], [-20.0, 20.0, 0.0]])
    flat = Part(
        vertices=at, triangles=np.array([[0, 1, 2], [0, 2, 3]]), normals=np.tile([0.0, 0.0, 1.0], (4, 1)),
        uv=at[:, :2], casts_shadow=False, roughness=1.0,
    )  # fmt: skip
    return replace(flat, **more)  # type: ignore[arg-type]


def tile(red: int, green: int = 0) -> np.ndarray[tuple[int, int, int], np.dtype[np.uint8]]:
    return np.array([[[red, green, 0]]], dtype=np.uint8)


def light_at(
    part: Part, light: Light, time_s: float = 0.0, eye: tuple[float, float, float] = (0.0, -3.0, 3.0)
) -> float:
    with Renderer((part,), light, 64, 48) as renderer:
        return float(RENDERED[renderer.color(looking(eye, (0.0, 0.0, 0.0)), CAMERA, time_s)[24, 32, 1]])


def test_neighbours_keep_their_distance_and_have_whole_storeys() -> None:
    bounds = hut().structure.bounds
    site = site_of(Site(neighbours=7, neighbours_from_m=20.0))
    at = np.concatenate([part.vertices for part in blocks_of(site)])
    apart = np.maximum(np.maximum(bounds[0, :2] - at[:, :2], at[:, :2] - bounds[1, :2]), 0).max(axis=1)
    assert apart.min() >= 20.0 - 0.1, "but for copings and plinths that overhang"
    assert apart.max() < 70.0
    assert at[:, 2].min() == 0.0
    assert STOREYS[0] * STOREY_M[0] < at[:, 2].max() < STOREYS[1] * STOREY_M[1] + 3.5
    assert {part.instance for part in blocks_of(site)} == {0}
    assert site.structure == hut().parts, "the structure is left as it is"


def test_as_many_neighbours_as_asked_for_or_a_refusal() -> None:
    level = Terrain(hut().structure.bounds, np.zeros((0, 2, 2)))
    for count in (1, 5):
        low, high = neighbours(count, 20.0, level, None, stream(0, "neighbours")).boxes.transpose(1, 0, 2)
        assert len(low) == count
        apart = np.maximum(low[:, None, :2] - high[None, :, :2], low[None, :, :2] - high[:, None, :2]).max(axis=2)
        assert (apart > 2.0).sum() == count * (count - 1), "but each from itself"
    with pytest.raises(UserError, match=r"neighbours: 40 buildings asked for, but only \d+ plots .* are free"):
        site_of(Site(neighbours=40, neighbours_from_m=5.0))


def test_a_detail_leaves_the_others_as_they_are() -> None:
    alone = site_of(Site(plants=1.0))
    among = site_of(Site(plants=1.0, neighbours=4, cloud_shadow=0.3, wet=0.5, dirt=0.5))
    for a, b in zip(alone.parts, among.parts, strict=False):
        assert a.vertices.tobytes() == b.vertices.tobytes()
    again = site_of(Site(plants=1.0, neighbours=4, dirt=0.5))
    for a, b in zip(blocks_of(among), blocks_of(again), strict=True):
        assert a.vertices.tobytes() == b.vertices.tobytes()
    other = site_of(Site(neighbours=4), seed=4)
    assert any(
        a.vertices.tobytes() != b.vertices.tobytes() for a, b in zip(blocks_of(again), blocks_of(other), strict=False)
    )


def test_nothing_stands_in_a_neighbour_and_none_on_the_road() -> None:
    bridge = Bridge(length_m=12.0, spans=1, girders=2, railing=False).build(np.random.default_rng(0))
    assert bridge.road is not None
    site = site_of(Site(neighbours=4, beneath="river"), built=bridge)
    for part in blocks_of(site):
        low, high = part.vertices.min(axis=0), part.vertices.max(axis=0)
        assert not site.is_free((low + high)[None, :2] / 2)[0]
        assert low[1] > bridge.road.half_width_m or high[1] < -bridge.road.half_width_m
        assert site.height(part.vertices[:, :2]) == pytest.approx(0.0), "on level ground, out of the river"


def test_a_neighbour_hides_what_is_behind_it_and_nothing_before_it() -> None:
    box = np.array([[[10.0, -3.0, 0.0], [14.0, 3.0, 9.0]]])
    beside = Neighbours((), box, hut().structure.bounds)
    eyes = np.array([[6.0, 0.0, 3.0], [12.0, 0.0, 3.0], [20.0, 0.0, 3.0], [20.0, 0.0, 30.0], [20.0, 30.0, 3.0]])
    assert beside.hides(eyes).tolist() == [False, True, True, False, False]


def test_a_camera_behind_a_neighbour_is_refused() -> None:
    flight = FlightSpec(airframe=AIRFRAMES["iris"](), path=Hover(duration_s=0.5, distance_m=3.0, height_m=1.5))
    structure = hut().structure
    spec = SequenceSpec(name="street", seed=0, structure=Bridge(), flight=flight, environment=Outdoor())
    flown = fly(flight, spec.mount, ObstacleMesh(structure.vertices, structure.triangles), 0)
    (camera,) = cameras_of(spec)
    site = site_of(Site(neighbours=6))
    check_site(spec, camera, site, flown)
    away = replace(site, is_hidden=lambda eyes: eyes[:, 2] > 0)
    with pytest.raises(UserError, match=r"sequence street: camera camera: t = 0\.00 s, .* a neighbouring building"):
        check_site(spec, camera, away, flown)


def test_a_neighbours_shadow_reaches_the_ground_and_leaves_near_shadows_sharp() -> None:
    wall = replace(white_box((2.0, -20.0, 0.0), (3.0, 20.0, 12.0)), distant=True, uv=None)
    low_sun = replace(SUN, to_lamp=(1.0, 0.0, 0.3))
    with Renderer((floor(), wall), low_sun, 64, 48) as renderer:
        shaded = RENDERED[renderer.color(looking((-2.0, -3.0, 3.0), (-2.0, 0.0, 0.0)), CAMERA)[24, 32, 1]]
    assert shaded == pytest.approx(0.2, abs=0.01), "ambient light only"
    assert light_at(floor(), low_sun) > 0.3


def test_clouds_cover_the_share_asked_for() -> None:
    for share in (0.1, 0.5, 0.9):
        clouds = cloud_shadow(share, 100.0, 5.0, stream(0, "clouds"))
        passing = clouds.texture[..., 0] / 255
        assert 1 - passing.mean() == pytest.approx(share, abs=0.01)
        assert passing.min() == 0.0
        assert passing.max() == 1.0
        assert np.linalg.norm(clouds.wind_m_s) == pytest.approx(5.0)
    first, again = (cloud_shadow(0.5, 100.0, 5.0, stream(0, "clouds")).texture.tobytes() for _ in range(2))
    assert first == again


def test_a_cloud_takes_the_sun_away_and_leaves_the_sky() -> None:
    lit = light_at(floor(), SUN)
    assert light_at(floor(), replace(SUN, clouds=CloudShadow(tile(255), 50.0))) == pytest.approx(lit, abs=0.01)
    assert light_at(floor(), replace(SUN, clouds=CloudShadow(tile(0), 50.0))) == pytest.approx(0.2, abs=0.01)


def test_clouds_drift_with_the_wind() -> None:
    stripes = np.zeros((1, 64, 3), dtype=np.uint8)
    stripes[:, 16:48] = 255  # across y below a sun in the zenith
    above = replace(SUN, to_lamp=(0.0, 0.0, 1.0), clouds=CloudShadow(stripes, 40.0, (0.0, 10.0, 0.0)))
    shaded, lit, again = (light_at(floor(), above, time_s) for time_s in (0.0, 2.0, 4.0))
    assert shaded == pytest.approx(0.2, abs=0.01)
    assert lit > 0.6
    assert again == shaded, "a whole period later"


def test_a_water_film_reflects_isotropic_light_as_fresnel_says() -> None:
    cosine = (np.arange(20000) + 0.5) / 20000
    inside = np.sqrt(1 - (1 - cosine**2) / 1.33**2)
    across = ((cosine - 1.33 * inside) / (cosine + 1.33 * inside)) ** 2
    along = ((1.33 * cosine - inside) / (1.33 * cosine + inside)) ** 2
    assert diffuse_reflectance(1.33) == pytest.approx(float(((across + along) * cosine).mean()), abs=1e-6)
    assert pytest.approx(1 - (1 - 0.0659) / 1.33**2, abs=1e-3) == WET_INNER


def test_wet_ground_is_as_dark_as_lekner_and_dorf_say() -> None:
    for code in (100, 180):
        dry = floor(texture=np.full((1, 1, 3), code, dtype=np.uint8))
        albedo = (code / 255) ** 2
        wet = replace(dry, film=Film(tile(255), 10.0, stands=False))
        expected = WET_GAIN / (1 - WET_INNER * albedo)
        assert light_at(wet, FLAT_LIGHT) / light_at(dry, FLAT_LIGHT) == pytest.approx(expected, abs=0.02)
        unwetted = replace(dry, film=Film(tile(0), 10.0, stands=False))
        assert light_at(unwetted, FLAT_LIGHT) == light_at(dry, FLAT_LIGHT)


def test_standing_water_mirrors_a_wall_and_is_ground_in_every_truth() -> None:
    red = np.column_stack([np.tile([1.0, 0.0, 0.0], (8, 1)), np.ones(8)])
    wall = replace(white_box((-9.0, 6.0, 0.0), (9.0, 7.0, 6.0)), tint=red)
    black = floor(texture=np.zeros((1, 1, 3), dtype=np.uint8))
    pose, seen = looking((0.0, -8.0, 1.0), (0.0, 2.0, 0.0)), []
    for part in (black, replace(black, film=Film(tile(255, 255), 10.0))):
        with Renderer((part, wall), FLAT_LIGHT, 64, 48) as renderer:
            seen.append((RENDERED[renderer.color(pose, CAMERA)][24, 32], *renderer.geometry(pose, CAMERA)))
    assert seen[0][0].max() < 0.01
    assert seen[1][0][2] > 0.05 > 5 * seen[1][0][0], "red, as the wall"
    assert np.array_equal(seen[0][1], seen[1][1])
    assert np.array_equal(seen[0][2], seen[1][2])


def test_water_covers_the_share_asked_for() -> None:
    for share in (0.2, 0.6, 1.0):
        water = film(share, stream(0, "water")).texture / 255
        assert water[..., 0].mean() == pytest.approx(share, abs=0.03)
        assert water[..., 1].mean() == pytest.approx(STANDING * share, abs=0.03)
        assert (water[..., 0] >= water[..., 1] - 0.01).all(), "water stands on wet ground only"


def test_meadows_soak_water_up() -> None:
    for soaks in (False, True):
        ground = replace(PLAIN, texture=PLAIN.texture.copy(), soaks=soaks)
        site = Site(wet=0.5).build(ground, hut(), partial(stream, 3, "site"))
        films = [part.film for part in site.parts if part.film is not None]
        assert [each.stands for each in films] == [not soaks]


def test_dirt_is_below_ledges_and_at_the_foot() -> None:
    site = site_of(Site(dirt=1.0))
    (wall,) = (part for part in site.structure if part.name == "wall")
    assert wall.soil is not None
    assert wall.soil_uv is not None
    assert wall.normals is not None
    front = wall.normals[:, 1] < -0.9
    h, w = wall.soil.shape[:2]

    def mean_at(low_m: float, high_m: float) -> float:
        """Mean share of the light left between two heights of the front."""
        v = wall.soil_uv[front, 1]  # type: ignore[index]
        z = wall.vertices[front, 2]
        rows = h * (1 - np.interp([low_m, high_m], np.sort(z), v[np.argsort(z)]))
        columns = w * wall.soil_uv[front, 0]  # type: ignore[index]
        patch = wall.soil[round(rows[1]) : round(rows[0]), round(columns.min()) : round(columns.max())]
        return float(patch.mean() / 255)

    ledge, free, foot = mean_at(3.6, 3.95), mean_at(1.0, 1.6), mean_at(0.02, 0.2)
    assert ledge < free - 0.08
    assert foot < free - 0.15
    assert free > 0.85


def test_dirt_changes_no_truth_and_only_darkens() -> None:
    pose, seen = looking((-1.0, -5.0, 2.0), (0.0, 0.0, 2.0)), []
    for dirt in (0.0, 1.0):
        parts = site_of(Site(dirt=dirt, plants=0.01)).structure
        with Renderer(parts, FLAT_LIGHT, 64, 48) as renderer:
            seen.append((renderer.color(pose, CAMERA).astype(int), *renderer.geometry(pose, CAMERA)))
    assert (seen[1][0] <= seen[0][0] + 1).all()
    assert (seen[1][0] < seen[0][0] - 3).mean() > 0.1
    assert np.array_equal(seen[0][1], seen[1][1])
    assert np.array_equal(seen[0][2], seen[1][2])


@pytest.mark.parametrize("name", ["neighbours", "cloud_shadow", "wet", "dirt"])
def test_details_are_off_by_default(name: str) -> None:
    assert getattr(Site(), name) == 0
    assert Outdoor(site=Site()) == Outdoor()
