"""Sites: slopes and markings have the cited sizes, light changes no truth, and nothing of a site is the structure's."""

from dataclasses import replace
from functools import lru_cache, partial

import numpy as np
import pytest

from tests.scenes.conftest import FLAT_LIGHT, looking, white_box
from uavbench.scenes.camera import Camera
from uavbench.scenes.clutter.placing import ring_places
from uavbench.scenes.materials import painted as materials
from uavbench.scenes.materials.painted import Material
from uavbench.scenes.primitives.meshes import joined
from uavbench.scenes.renderables import BuiltSite, BuiltStructure, Light, Part
from uavbench.scenes.rendering.gpu import covering_levels
from uavbench.scenes.rendering.light_baking import bake
from uavbench.scenes.rendering.radiance import RENDERED
from uavbench.scenes.rendering.renderer import Renderer
from uavbench.scenes.shots.cameras import cameras_of
from uavbench.scenes.shots.confines import check_site
from uavbench.scenes.site import plants, water
from uavbench.scenes.site.roads import DASH_M, GAP_M, LINE_M, Carriageway
from uavbench.scenes.site.site import Site
from uavbench.scenes.site.terrain import BANK_SLOPE, BED_M, FILL_SLOPE, SUNK_M, WATER_M, Course, Embankment, Terrain
from uavbench.scenes.spec import SequenceSpec
from uavbench.scenes.structures.bridge import Bridge
from uavbench.scenes.structures.building import Building
from uavbench.scenes.structures.wall import Wall
from uavbench.scenes.world.outdoor import Outdoor
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.obstacles import ObstacleMesh
from uavbench.trajectories.paths.around import Hover
from uavbench.trajectories.pose import Array
from uavbench.trajectories.random_streams import stream
from uavbench.trajectories.simulation.flight import FlightSpec, fly
from uavbench.trajectories.vehicle.registry import AIRFRAMES

PLAIN = Material(np.full((1, 1, 3), 100, dtype=np.uint8), (1.0, 1.0))
STREAMS = partial(stream, 0, "site")
WHITE = np.full((1, 1, 3), 200, dtype=np.uint8)


@pytest.fixture(autouse=True)
def one_paint(monkeypatch: pytest.MonkeyPatch) -> None:
    """Plain materials: painting takes seconds, and no test here looks at it."""
    for name in ("gravel", "asphalt", "concrete", "painted_steel", "window", "door"):
        monkeypatch.setattr(materials, name, lambda *_, **__: PLAIN)


@lru_cache
def bridge() -> BuiltStructure:
    return Bridge().build(np.random.default_rng(0))


def site_of(site: Site, seed: int = 3) -> BuiltSite:
    return site.build(PLAIN, bridge(), partial(stream, seed, "site"))


def area(part: Part) -> float:
    a, b, c = (part.vertices[part.triangles[:, k]] for k in range(3))
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def test_without_a_site_the_ground_stays_plain() -> None:
    assert Outdoor() == Outdoor(site=Site())
    asked = Site()
    assert (asked.beneath, asked.embankments, asked.markings, asked.plants, asked.contact_shadows) == (
        "ground",
        False,
        False,
        0.0,
        False,
    )


def test_hills_and_sky_are_the_same_with_and_without_a_site(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(materials.PAINTS, "grass", lambda rng: PLAIN)
    bounds = bridge().structure.bounds
    without, on_site = (Outdoor(site=site).build(bounds, np.random.default_rng(5)) for site in (Site(), Site(wet=0.5)))
    assert on_site.sky is not None and without.sky is not None and on_site.sky.tobytes() == without.sky.tobytes()
    assert len(on_site.parts) == len(without.parts) - 1
    for ours, theirs in zip(on_site.parts, without.parts[1:], strict=True):
        assert ours.texture.tobytes() == theirs.texture.tobytes()


def test_contact_shadows_leave_plants_and_the_tones_of_the_ground() -> None:
    plain, shaded = (site_of(Site(beneath="river", plants=1.0, contact_shadows=contact)) for contact in (False, True))
    tufts, same = ([p for p in site.parts if p.instance == plants.INSTANCE] for site in (plain, shaded))
    for a, b in zip(tufts, same, strict=True):
        assert a.vertices.tobytes() == b.vertices.tobytes()
    tones = []
    for site in (plain, shaded):
        ground = [p for p in site.parts if p.instance == 0 and p.tint is not None and not p.casts_shadow]
        tones.append({tuple(v.round(3)): t[0] for p in ground for v, t in zip(p.vertices, p.tint, strict=True)})
    common = tones[0].keys() & tones[1].keys()
    assert len(common) > 500 and len(tones[1]) > len(tones[0])
    assert np.std([tones[0][at] for at in common]) > 0.03
    assert max(abs(tones[0][at] - tones[1][at]) for at in common) < 1e-12


def test_a_bank_has_its_slope_and_a_river_its_depth() -> None:
    terrain = Terrain(bridge().structure.bounds, np.zeros((0, 2, 2)), Course("river", 1.0, 7.0))
    x = np.array([1.0, 8.0 - BANK_SLOPE * BED_M, 8.0 - BANK_SLOPE * WATER_M, 7.0, 8.0, 9.0, -6.0, -30.0])
    expected = [-BED_M, -BED_M, -WATER_M, -1 / BANK_SLOPE, 0.0, 0.0, 0.0, 0.0]
    assert terrain.height(np.column_stack([x, np.zeros(len(x))])) == pytest.approx(expected)
    vertices, triangles = terrain.mesh()
    near = np.abs(vertices[:, 1]) < 5
    assert np.interp(7.0, *vertices[near][np.argsort(vertices[near, 0])][:, [0, 2]].T) == pytest.approx(-0.5, abs=0.01)
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    assert (np.cross(b - a, c - a)[:, 2] > 0).all(), "the grid does not fold over, however the river bends"


def test_an_embankment_has_its_slope_and_leaves_the_way_beneath_open() -> None:
    road = bridge().road
    assert road is not None
    bank = Embankment.of(road)
    top = road.level_m - SUNK_M
    crest = np.array([[bank.start_m + 20, 0.0], [-bank.start_m - 20, bank.half_m]])
    assert bank.height(crest) == pytest.approx([top, top])
    down = np.array([[bank.start_m + 20, bank.half_m + 3.0]])
    assert bank.height(down) == pytest.approx([top - 3 / FILL_SLOPE])
    beneath = np.column_stack([np.linspace(-road.front_m, road.front_m, 50), np.zeros(50)])
    assert bank.height(beneath) == pytest.approx(0.0)


def test_markings_have_the_cited_widths_and_lengths() -> None:
    length = 10 * (DASH_M + GAP_M)
    asphalt, paint = Carriageway(start_m=0, end_m=length, half_m=3.0, level_m=1.0).parts(PLAIN, WHITE, marked=True)
    assert paint.texture is WHITE
    middle = (np.abs(paint.vertices[paint.triangles][:, :, 1]) < 0.1).all(axis=1)
    edges, dashes = (replace(paint, triangles=paint.triangles[chosen]) for chosen in (~middle, middle))
    assert area(edges) == pytest.approx(2 * LINE_M * length)
    assert area(dashes) == pytest.approx(10 * LINE_M * DASH_M)
    assert area(asphalt) + area(paint) == pytest.approx(6.0 * length), "side by side, neither gap nor overlap"
    starts = np.unique(dashes.vertices[dashes.triangles][:, :, 0].min(axis=1).round(6))
    assert np.diff(starts) == pytest.approx(DASH_M + GAP_M)


def test_markings_change_the_light_of_the_deck_and_no_truth() -> None:
    camera = Camera(160, 120, 120.0, 120.0, 80.0, 60.0)
    seen = {}
    for marked in (False, True):
        parts = site_of(Site(markings=marked, plants=0.01)).structure
        with Renderer(parts, FLAT_LIGHT, 160, 120) as renderer:
            pose = looking((-16.0, -5.0, 9.0), (0.0, 0.0, 5.0))
            seen[marked] = renderer.color(pose, camera), *renderer.geometry(pose, camera)
    assert (np.abs(seen[True][0].astype(int) - seen[False][0]).max(axis=2) > 40).sum() > 30
    assert np.array_equal(seen[True][2], seen[False][2])
    moved = np.abs(seen[True][1] - seen[False][1]) > 2e-4 * seen[False][1]  # 5 mm where a GPU's 1/512 px are 4 mm
    assert moved.mean() < 2e-3, "but for pixels whose centre lies on an edge"


def test_contact_shadows_change_no_truth() -> None:
    camera = Camera(160, 120, 120.0, 120.0, 80.0, 60.0)
    seen = []
    for contact in (False, True):
        site = site_of(Site(beneath="river", contact_shadows=contact))
        with Renderer((*site.structure, *site.parts), FLAT_LIGHT, 160, 120) as renderer:
            seen.append(renderer.geometry(looking((-6.0, -12.0, 3.0), (1.0, 0.0, 2.0)), camera))
    assert (seen[0][1] != seen[1][1]).mean() < 1e-3
    same = seen[0][1] == seen[1][1]
    assert np.quantile(np.abs(seen[0][0] - seen[1][0])[same], 0.99) < 0.05, "the same ground, cut finer"


def test_contact_shadows_darken_the_foot_of_a_wall_and_not_the_free_wall() -> None:
    wall = white_box((-2.0, 0.0, 0.0), (2.0, 0.3, 4.0))
    built = BuiltStructure(bridge().structure, (replace(wall, uv=np.zeros((8, 2))),))
    cut = Site(contact_shadows=True).build(PLAIN, built, STREAMS).structure[0]
    ground = white_box((-9.0, -9.0, -0.1), (9.0, 9.0, 0.0))
    occluder = ObstacleMesh(*joined((p.vertices, p.triangles) for p in (wall, ground)))
    light = Light(to_lamp=(0.0, 0.0, 1.0), lamp=(0.5,) * 3, above=(0.4,) * 3, below=(0.2,) * 3)
    (baked,) = bake((cut,), occluder, light, reach_m=1.0)
    assert baked.normals is not None and baked.tint is not None
    front = (baked.normals[:, 1] < -0.9) & (np.abs(baked.vertices[:, 0]) < 1.2)
    z, shade = baked.vertices[front, 2], baked.tint[front, 0]
    foot, near, free = (shade[(z >= low) & (z <= high)].mean() for low, high in ((0, 0.05), (0.2, 0.6), (1.5, 4.0)))
    assert foot < near < free
    assert foot < 0.75
    assert free == pytest.approx(1.0, abs=0.02)


def test_water_mirrors_what_stands_over_it() -> None:
    terrain = Terrain(np.array([[-4.0, -1.0, 0.0], [4.0, 1.0, 4.0]]), np.zeros((0, 2, 2)), Course("river", 0.0, 40.0))
    calm = replace(water.surface(terrain, np.random.default_rng(0)), ripples=np.full((1, 1, 3), 128, dtype=np.uint8))
    red = np.column_stack([np.tile([1.0, 0.0, 0.0], (8, 1)), np.ones(8)])
    block = replace(white_box((-4.0, 30.0, 0.0), (4.0, 31.0, 3.0)), tint=red)
    camera, pose = Camera(320, 240, 300.0, 300.0, 160.0, 60.0), looking((0.0, 0.0, 1.0), (0.0, 10.0, 1.0))
    sky = np.full((8, 16, 3), 40, dtype=np.uint8)
    with Renderer((calm, block), FLAT_LIGHT, 320, 240, sky=sky) as renderer:
        light = RENDERED[renderer.color(pose, camera)]
        instances = renderer.geometry(pose, camera)[1]
    turned_over = np.array([0.0, 30.0, -2 * WATER_M - 1.5])  # the mirror image of a point on the block's face
    ((u, v),) = camera.project(pose.transform(turned_over[None]))
    blue, _, mirrored = light[round(v), round(u)]
    assert mirrored > 5 * blue, "red, as the block"
    assert instances[round(v), round(u)] == 0
    (beside,) = camera.project(pose.transform(turned_over[None] + [9.0, 0.0, 0.0]))
    assert np.ptp(light[round(beside[1]), round(beside[0])]) < 0.3 * mirrored, "sky, beside it"


def test_small_ripples_break_up_reflections() -> None:
    """A fifth of the slopes' variance is of waves below 0.2 m, without which reflections are blots of half a metre."""
    slopes = water.ripples(np.random.default_rng(5))[..., :2].astype(float) - 128
    per_m = np.fft.fftfreq(water.TILE_PX) * water.TILE_PX / water.TILE_M
    short = np.hypot(per_m[:, None], per_m) > 1 / 0.2
    power = np.abs(np.fft.fft2(slopes, axes=(0, 1))) ** 2
    assert power[short].sum() > 0.2 * power.sum()


def test_a_mirror_image_is_as_bright_as_fresnel_says() -> None:
    """At normal incidence 2 %, near grazing nearly all (Schlick 1994)."""
    terrain = Terrain(np.array([[-4.0, -1.0, 0.0], [4.0, 1.0, 4.0]]), np.zeros((0, 2, 2)), Course("river", 0.0, 80.0))
    calm = replace(water.surface(terrain, np.random.default_rng(0)), ripples=np.full((1, 1, 3), 128, dtype=np.uint8))
    calm = replace(calm, tint=np.column_stack([np.zeros((len(calm.vertices), 3)), np.ones(len(calm.vertices))]))
    camera, sky = Camera(64, 48, 300.0, 300.0, 32.0, 24.0), np.full((8, 16, 3), 255, dtype=np.uint8)
    with Renderer((calm,), FLAT_LIGHT, 64, 48, sky=sky) as renderer:
        for eye, at in (((0.0, 0.0, 9.0), (0.0, 0.5, 0.0)), ((0.0, 0.0, 1.0), (0.0, 12.0, -WATER_M))):
            pose = looking(eye, at)
            away = np.subtract(at, eye) / np.linalg.norm(np.subtract(at, eye))
            expected = 0.02 + 0.98 * (1 + away[2]) ** 5
            assert RENDERED[renderer.color(pose, camera)[24, 32, 1]] == pytest.approx(expected, abs=0.01)


def test_nothing_of_a_site_is_the_structures() -> None:
    site = site_of(Site(beneath="river", embankments=True, markings=True, plants=1.0))
    assert {part.instance for part in site.parts} == {0, plants.INSTANCE}
    assert {part.instance for part in site.structure} == {1}
    assert not any(part.instance == 2 and not part.cutout for part in site.parts)


def test_piers_in_a_river_stand_on_footings() -> None:
    site = site_of(Site(beneath="river"))
    above_bed = site.height(np.array([[0.0, 2.0]]))
    assert above_bed == pytest.approx([-BED_M])
    reaching = [p for p in site.parts if p.vertices[:, 2].min() < -BED_M and p.vertices[:, 2].max() > -0.05]
    spans = [(p.vertices.min(axis=0), p.vertices.max(axis=0)) for p in reaching if np.ptp(p.vertices[:, 0]) < 5]
    assert any((low[:2] < [-0.38, -2.4]).all() and (high[:2] > [0.38, 2.4]).all() for low, high in spans)


def test_a_road_beneath_passes_between_the_piers() -> None:
    site = site_of(Site(beneath="road"))
    feet: list[Array] = [p.vertices[p.vertices[:, 2] < 0.1] for p in bridge().parts]
    at = np.concatenate([points[:, :2] for points in feet])
    assert (site.height(at) == 0).all(), "no foot stands on the road"
    assert not site.is_free(np.array([[-6.0, 40.0]]))[0] or not site.is_free(np.array([[6.0, 40.0]]))[0]


def test_the_same_seed_gives_the_same_site() -> None:
    asked = Site(beneath="river", plants=1.0, embankments=True)
    first, again, other = (site_of(asked, seed) for seed in (3, 3, 4))
    for a, b in zip(first.parts, again.parts, strict=True):
        assert a.vertices.tobytes() == b.vertices.tobytes()
    assert any(a.vertices.tobytes() != b.vertices.tobytes() for a, b in zip(first.parts, other.parts, strict=True))


def test_things_stand_on_free_ground() -> None:
    site = site_of(Site(beneath="river", embankments=True))
    places = ring_places(bridge().structure.bounds, 200, (1.0, 30.0), np.random.default_rng(0), site.is_free)
    assert site.height(places[:, :2]) == pytest.approx(0.0, abs=1e-6)


def test_a_camera_that_flies_into_an_embankment_is_refused() -> None:
    flight = FlightSpec(
        airframe=AIRFRAMES["iris"](), path=Hover(duration_s=0.5, distance_m=1.0, height_m=1.5, from_deg=-12.0)
    )
    spec = SequenceSpec(name="earth", seed=0, structure=Bridge(), flight=flight, environment=Outdoor())
    structure = bridge().structure
    flown = fly(flight, spec.mount, ObstacleMesh(structure.vertices, structure.triangles), 0)
    (camera,) = cameras_of(spec)
    check_site(spec, camera, None, flown)
    check_site(spec, camera, site_of(Site(beneath="river")), flown)
    with pytest.raises(UserError, match=r"sequence earth: camera camera: t = .* the ground there is at 2\.\d\d m"):
        check_site(spec, camera, site_of(Site(embankments=True)), flown)


@pytest.mark.parametrize("site", [Site(markings=True), Site(embankments=True)])
def test_a_structure_without_a_road_has_no_markings(site: Site) -> None:
    with pytest.raises(UserError, match="site: embankments and markings need a structure that carries a road"):
        site.build(PLAIN, replace(bridge(), road=None), STREAMS)


def test_a_bridge_too_narrow_for_a_road_is_refused() -> None:
    narrow = Bridge(length_m=6.0, spans=2).build(np.random.default_rng(0))
    with pytest.raises(UserError, match="no gap beneath the structure is wide enough"):
        Site(beneath="road").build(PLAIN, narrow, STREAMS)


def test_plants_do_not_thin_out_from_afar() -> None:
    """What plants cover of the view falls with the square of the distance alone."""
    feet = np.array([[[-2.0, -0.5], [2.0, 0.5]]])
    terrain = Terrain(np.array([[-2.0, -0.5, 0.0], [2.0, 0.5, 4.0]]), feet)
    rng = np.random.default_rng(2)
    tufts = plants.cards(plants.at_feet(terrain, np.zeros((0, 2, 2)), 2.0, rng), terrain, plants.tufts(rng), rng)
    camera = Camera(640, 480, 400.0, 400.0, 319.5, 239.5)

    def covered(renderer: Renderer, away_m: float) -> float:
        """Plants' pixels times the squared distance, mean of views that lie differently on the grid of pixels."""
        views = [looking((0.1 * k, -away_m, 0.3 + 0.05 * k), (0.01 * k, 0.0, 0.3 + 0.013 * k)) for k in range(12)]
        masks = [renderer.geometry(pose, camera)[1] == plants.INSTANCE for pose in views]
        return float(np.mean(masks)) * away_m**2

    left = {}
    for keeps in (True, False):
        with Renderer((replace(tufts, keeps_cover=keeps),), FLAT_LIGHT, 640, 480) as renderer:
            left[keeps] = covered(renderer, 96.0) / covered(renderer, 12.0)
    assert left[True] == pytest.approx(0.93, abs=0.08)
    assert left[False] < 0.7, "with the mean alpha of blades and gaps"


def test_no_plant_grows_before_a_door() -> None:
    """Not even where a card is turned or leans towards the door; beside the way to it they do."""
    for structure in (Wall(), Building(), Wall(bays=1)):
        built = structure.build(np.random.default_rng(0))
        assert built.doors.shape == (1, 2, 2)
        start, end = built.doors[0]
        assert end[0] - start[0] == pytest.approx(1.0) and start[1] == end[1]
        site = Site(plants=5.0).build(PLAIN, built, STREAMS)
        (grown,) = [p for p in site.parts if p.instance == plants.INSTANCE]
        x, y = grown.vertices[:, 0], grown.vertices[:, 1]
        in_front = y < start[1]
        assert not (in_front & (x > start[0]) & (x < end[0])).any()
        assert (in_front & (x > start[0] - 1.5) & (x < end[0] + 1.5)).sum() > 20


def test_plants_along_a_wall_are_no_row() -> None:
    """They stand in clumps of different heights: gaps and heights vary more than those of independent places."""
    feet = np.array([[[-20.0, -0.5], [20.0, 0.5]]])
    terrain = Terrain(np.array([[-20.0, -0.5, 0.0], [20.0, 0.5, 4.0]]), feet)
    stand = plants.at_feet(terrain, np.zeros((0, 2, 2)), 1.0, np.random.default_rng(4))
    counts = np.histogram(stand.places[:, 0], np.arange(-20.0, 20.5, 0.5))[0]
    assert counts.var() > 2 * counts.mean(), "a Poisson process has the same variance and mean"
    assert np.log(stand.heights_m).std() > 0.42
    assert (stand.heights_m >= plants.TUFT_M[0]).all() and (stand.heights_m <= plants.TUFT_M[1]).all()
    nearest = np.abs(stand.places[:, 1]) - 0.5
    near = nearest < 0.1
    assert stand.heights_m[near].mean() > 1.2 * stand.heights_m[~near].mean(), "lower away from the wall"
    assert 0.1 < nearest[np.abs(stand.places[:, 0]) < 19].mean() < 0.3


def test_plants_surround_a_footprint() -> None:
    low, high = np.array([1.0, 2.0]), np.array([4.0, 3.0])
    along = np.array([0.0, 2.0, 3.5, 5.0, 7.5])
    expected = [[1, 1.9], [3, 1.9], [4.1, 2.5], [3.0, 3.1], [0.9, 2.5]]
    assert plants._beside(low, high, along, np.full(5, 0.1)) == pytest.approx(np.array(expected))


def test_every_mipmap_of_blades_has_as_many_opaque_pixels() -> None:
    image = plants.blades(np.random.default_rng(1), 26, (118.0, 126.0, 66.0), 0.07)
    share = (image[..., 3] > 127).mean()
    levels = covering_levels(image)
    assert [level.shape[0] for level in levels] == [128, 64, 32, 16, 8]
    assert [(level[..., 3] > 127).mean() for level in levels] == pytest.approx([share] * 5, abs=0.04)
    means = [level[..., :3].mean() for level in levels]
    assert means == pytest.approx([image[..., :3].mean()] * 5, abs=1.0), "only alpha is scaled"
