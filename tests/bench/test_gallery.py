"""The gallery: every plug-in that can be seen has a valid example, and its picture shows what it is of."""

from dataclasses import fields, replace

import numpy as np
import pytest

from uavbench.bench.config.plugins import PLUGINS
from uavbench.bench.gallery.examples import Example, example_of, sites
from uavbench.bench.gallery.flights import path_picture, sensor_picture, unit_of
from uavbench.bench.gallery.page import SECTIONS
from uavbench.bench.gallery.scenes import (
    BARE,
    effect_picture,
    environment_picture,
    mount_picture,
    site_picture,
    structure_picture,
)
from uavbench.scenes.site.site import Site
from uavbench.scenes.world.studio import Studio

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
    shown = {key for example in sites().values() for key in example.own}
    assert shown - sizes == {field.name for field in fields(Site)} - sizes
    assert all(example.about for example in sites().values())


def test_a_site_is_on_the_right_half_alone():
    spec = sites()["wet"].spec
    spec = replace(spec, camera=replace(spec.camera, width=96, height=64))
    bare = environment_picture(replace(spec, environment=replace(spec.environment, site=BARE)))[:, 24:72]
    left, right = np.split(site_picture(spec).astype(int), 2, axis=1)
    np.testing.assert_array_equal(left[:, :46], bare[:, :46])
    assert (np.abs(right[:, 2:] - bare[:, 2:]).max(axis=2) > 10).mean() > 0.05
    np.testing.assert_array_equal(right[:FIELD_FROM, 2:], bare[:FIELD_FROM, 2:])


def test_contact_shadows_darken_the_foot_of_the_structure_and_change_nothing_else():
    spec = sites()["contact_shadows"].spec
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
