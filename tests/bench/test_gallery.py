"""The gallery: every plug-in that can be seen has a valid example, and its picture shows what it is of."""

from dataclasses import dataclass, fields, replace
from typing import Literal, get_args, get_type_hints

import numpy as np
import pytest

from uavbench.bench.config.plugins import PLUGINS
from uavbench.bench.gallery import examples
from uavbench.bench.gallery.annotations import DRAWN, annotation_picture, flow_colours, normal_colours
from uavbench.bench.gallery.cameras import ROW, cameras_picture
from uavbench.bench.gallery.examples import Example, example_of, options
from uavbench.bench.gallery.flights import path_picture, sensor_picture, unit_of
from uavbench.bench.gallery.page import OPTIONS, SECTIONS
from uavbench.bench.gallery.scenes import (
    BARE,
    effect_picture,
    environment_picture,
    mount_picture,
    site_picture,
    structure_picture,
)
from uavbench.scenes.camera import DISTORTION_COEFFICIENTS
from uavbench.scenes.site.site import Site
from uavbench.scenes.spec import Annotation
from uavbench.scenes.world.registry import ENVIRONMENTS
from uavbench.scenes.world.studio import Studio

BESIDE = 150
"""First column right of the legends in a picture of the ground truth."""
FIELD_FROM = 15
"""Row of a picture of 64 rows above which it shows sky, hills and trees alone."""
ALL = [(protocol, kind) for protocol in SECTIONS for kind in PLUGINS[protocol][0]]


def example(key, kind):
    plugins = next(PLUGINS[protocol][0] for protocol, section in SECTIONS.items() if section.key == key)
    return example_of(key, kind, plugins[kind])


def small(example: Example):
    return replace(example.spec, camera=replace(example.spec.camera, width=96, height=64), environment=Studio())


@pytest.mark.parametrize(("protocol", "kind"), ALL, ids=[kind for _, kind in ALL])
def test_every_plugin_has_a_valid_example(protocol, kind):
    """One that is new needs none in examples.toml, unless something must be given to it."""
    key, plugin = SECTIONS[protocol].key, PLUGINS[protocol][0][kind]
    spec = example_of(key, kind, plugin).spec
    of_key = spec.flight.path if key == "path" else getattr(spec, key)
    assert isinstance(of_key[0] if isinstance(of_key, tuple) else of_key, plugin)


def test_every_part_of_a_site_is_shown():
    sizes = {"neighbours_from_m", "cloud_size_m", "wind_m_s"}
    shown = {key for example in options("sites").values() for key in example.own}
    assert shown - sizes == {field.name for field in fields(Site)} - sizes
    assert all(example.about for example in options("sites").values())


def test_what_has_pictures_is_what_examples_has():
    tables = {*examples.OPTIONS, *(section.key for section in SECTIONS.values())}
    assert set(OPTIONS) == set(examples.OPTIONS)
    assert set(examples._tables()) - {"all"} <= tables


def unseen(environments):
    """Parameters of environments, and words that they can be, of which no picture is shown."""
    shown = [*options("conditions").values(), *(example("environment", kind) for kind in environments)]
    missing = []
    for kind, environment in environments.items():
        own = [e.own for e in shown if isinstance(e.spec.environment, environment)]
        for name, hint in get_type_hints(environment).items():
            values = [table[name] for table in own if name in table]
            missing += [
                f"{kind}.{name} = {word}" for word in get_args(hint) if isinstance(word, str) and word not in values
            ]
            missing += [f"{kind}.{name}"] * (not values and name != "site")
    return missing


def test_every_parameter_of_an_environment_is_shown():
    assert unseen(ENVIRONMENTS) == []
    assert all(e.about for e in options("conditions").values())


def test_a_parameter_without_a_picture_is_noticed(monkeypatch):
    @dataclass(frozen=True)
    class Underground(Studio):
        rock: Literal["granite", "lime"] = "lime"

    found = unseen({"studio": Underground})
    assert {"studio.rock = granite", "studio.rock = lime", "studio.rock"} <= set(found)


def test_every_annotation_and_every_lens_is_shown():
    shown = [kind for e in options("annotations").values() for kind in e.spec.annotations]
    assert sorted(shown) == sorted(get_args(Annotation)) == sorted(DRAWN)
    lenses = {e.spec.camera.distortion_model for e in options("cameras").values()}
    assert lenses == set(DISTORTION_COEFFICIENTS)
    assert {len(e.spec.cameras) for e in options("cameras").values()} == {0, 1, 3}, "alone, a pair, and four"


def test_the_furniture_of_a_room_is_in_its_picture():
    spec = options("conditions")["furnished-room"].spec
    spec = replace(spec, camera=replace(spec.camera, width=96, height=64))
    bare = replace(spec, environment=replace(spec.environment, furniture=0.0))
    shown, empty = (environment_picture(each).astype(int) for each in (spec, bare))
    assert (np.abs(shown - empty).max(axis=2) > 10).mean() > 0.02


@pytest.mark.parametrize(("flow", "colour"), [
    ((0.0, 0.0), (255, 255, 255)), ((1.0, 0.0), (0, 0, 255)), ((-1.0, 0.0), (255, 255, 0)),
    ((np.nan, np.nan), (0, 0, 0)), ((3.0, 0.0), (0, 0, 255)),
])  # fmt: skip
def test_flow_is_white_at_rest_red_to_the_right_and_cyan_to_the_left(flow, colour):
    assert flow_colours(np.array([[flow]]))[0, 0].tolist() == list(colour)


def test_normals_are_red_to_the_right_green_up_and_blue_towards_the_camera():
    right, up, here = ((1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, -1.0))
    colours = normal_colours(np.array([[right, up, here]]))[0].tolist()
    assert colours == [[128, 128, 255], [128, 255, 128], [255, 128, 128]]


@pytest.fixture(scope="module")
def annotated():
    """Pictures of the ground truth of a box before a plain backdrop, by annotation."""
    spec = small(example("structure", "box"))
    flight = replace(spec.flight, path=example("path", "orbit").spec.flight.path)
    spec = replace(spec, flight=flight, rate_hz=1.0, sensors=(), camera=replace(spec.camera, width=320, height=240))
    return {kind: annotation_picture(replace(spec, annotations=(kind,))) for kind in get_args(Annotation)}


def test_ground_truth_is_drawn_where_the_structure_is(annotated):
    box = (np.abs(annotated["mask"].astype(int) - (60, 200, 255)).max(axis=2) == 0)[:, BESIDE:]
    assert 0.05 < box.mean() < 0.9
    nowhere = {kind: (annotated[kind] == 60).all(axis=2)[:, BESIDE:] for kind in ("depth", "normals")}
    for kind, empty in nowhere.items():
        assert (empty == ~box).mean() > 0.97, kind
    green = (annotated["edges"].astype(int)[..., 1] - annotated["edges"][..., 2] > 90)[:, BESIDE:]
    assert green.any() and (green & ~box).sum() < 0.6 * green.sum()
    assert len({picture.tobytes() for picture in annotated.values()}) == 5


def test_a_legend_says_how_to_read_colours(annotated):
    for kind in ("depth", "mask", "flow", "normals"):
        corner = annotated[kind][-20:-9, 8:16]
        assert (corner == 28).all(axis=2).any(), kind


def test_a_pair_is_on_common_rows_and_four_cameras_see_different_things():
    pair, four = (options("cameras")[name].spec for name in ("stereo-pair", "four-cameras"))
    pair, four = (replace(spec, environment=Studio(), clutter=()) for spec in (pair, four))
    seen = cameras_picture(pair)
    assert seen.shape == (320, 480, 3)
    rows = np.flatnonzero((seen == ROW).all(axis=2).all(axis=1)).tolist()
    assert len(rows) == 4
    left, right = (half[40:].astype(int) for half in np.split(seen, 2, axis=1))
    shifts = [np.abs(left[:, 40:] - np.roll(right, shift, axis=1)[:, 40:]).mean() for shift in range(40)]
    assert 3 < int(np.argmin(shifts)) < 40, "what is in the right image lies further left there"
    tiles = [t for row in np.split(cameras_picture(four), 2) for t in np.split(row, 2, axis=1)]
    assert len({t[40:].tobytes() for t in tiles}) == 4


def test_a_site_is_on_the_right_half_alone():
    spec = options("sites")["wet"].spec
    spec = replace(spec, camera=replace(spec.camera, width=96, height=64))
    bare = environment_picture(replace(spec, environment=replace(spec.environment, site=BARE)))[:, 24:72]
    left, right = np.split(site_picture(spec).astype(int), 2, axis=1)
    np.testing.assert_array_equal(left[:, :46], bare[:, :46])
    assert (np.abs(right[:, 2:] - bare[:, 2:]).max(axis=2) > 10).mean() > 0.05
    np.testing.assert_array_equal(right[:FIELD_FROM, 2:], bare[:FIELD_FROM, 2:])


def test_contact_shadows_darken_the_foot_of_the_structure_and_change_nothing_else():
    spec = options("sites")["contact_shadows"].spec
    spec = replace(spec, camera=replace(spec.camera, width=96, height=64))
    bare, shown = (
        environment_picture(replace(spec, environment=replace(spec.environment, site=site))).astype(int)
        for site in (BARE, spec.environment.site)
    )
    np.testing.assert_array_equal(shown[:FIELD_FROM], bare[:FIELD_FROM])
    changed = (np.abs(shown - bare).max(axis=2) > 3).mean()
    assert 0.005 < changed < 0.15, changed
    assert shown.sum() < bare.sum()


def test_the_structure_fills_its_picture():
    picture = structure_picture(small(example("structure", "box")))
    assert picture.shape == (64, 96, 3)
    backdrop = np.abs(picture.astype(int) - picture[0, 0]).max(axis=2) < 3
    assert 0.1 < 1 - backdrop.mean() < 0.9


def test_an_effect_is_on_the_right_half_alone():
    noise = example("effects", "noise")
    picture = effect_picture(small(noise))
    assert picture.shape == (64, 96, 3)
    flat = picture[:12].astype(float)  # the backdrop
    assert flat[:, :40].std() < 1 < flat[:, 56:].std()


def test_lost_frames_are_left_empty():
    picture = effect_picture(small(example("effects", "drops")))
    tiles = [tile for row in np.split(picture, 2) for tile in np.split(row, 3, axis=1)]
    empty = [bool((tile == tile[0, 0]).all()) for tile in tiles]
    assert any(empty) and not empty[0]


def test_with_a_gimbal_the_structure_stays_at_its_height_in_the_frames():
    moved = {}
    for kind in ("fixed", "gimbal"):
        picture = mount_picture(small(example("mount", kind)))
        tiles = [tile for row in np.split(picture, 2) for tile in np.split(row, 3, axis=1)]
        seen = [np.abs(tile.astype(int) - tile[0, 0]).max(axis=2) > 30 for tile in tiles]
        moved[kind] = np.ptp([np.nonzero(mask)[0].mean() for mask in seen])
    assert moved["fixed"] > 2 * moved["gimbal"], moved


def test_a_path_is_drawn_round_its_structure():
    spec = small(example("path", "orbit"))
    orbit = path_picture(spec).astype(int)
    hover = path_picture(replace(spec, flight=example("path", "hover").spec.flight)).astype(int)
    start = [int(((picture[..., 0] - picture[..., 2]) > 40).sum()) for picture in (orbit, hover)]
    assert start[0] > start[1] + 15, "its first, dark blue part"
    assert start[1] > 0, "the dot of the start"


def test_a_sensor_is_plotted_unit_by_unit():
    assert [unit_of(name) for name in ("wx_rad_s", "pressure_pa", "satellites")] == ["rad_s", "pa", ""]
    spec = example("sensors", "baro").spec
    picture = sensor_picture(spec)
    assert picture.shape == (spec.camera.height, spec.camera.width, 3)
    assert 0.01 < (picture.min(axis=2) < 200).mean() < 0.5
