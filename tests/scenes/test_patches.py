"""Patches of the ground: as much contrast as asked for, the same mean, no repeated tiles, and off by default."""

from functools import partial

import numpy as np
import pytest

from uavbench.scenes.materials.painted import Material
from uavbench.scenes.materials.patches import TILE_M, TILE_PX, Patches, patches
from uavbench.scenes.renderables import BuiltEnvironment, BuiltStructure, Part
from uavbench.scenes.site.site import Site
from uavbench.scenes.structures.wall import Wall
from uavbench.scenes.world import outdoor
from uavbench.scenes.world.outdoor import Outdoor
from uavbench.trajectories.pose import Array
from uavbench.trajectories.random_streams import stream

BOUNDS = np.array([[-4.0, -0.2, 0.0], [4.0, 0.2, 6.0]])
TURF = Material(np.full((4, 4, 3), 100, dtype=np.uint8), (8.0, 8.0), soaks=True)


@pytest.fixture(autouse=True)
def plain_ground(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(outdoor.materials.PAINTS, "grass", lambda rng: TURF)


def factors(found: Patches) -> Array:
    return np.asarray(found.texture / 255.0 * found.greatest)


def built(environment: Outdoor) -> BuiltEnvironment:
    return environment.build(BOUNDS, stream(3, "environment"))


@pytest.mark.parametrize("grows", [True, False])
def test_patches_have_the_contrast_asked_for_and_keep_the_mean_albedo(grows: bool) -> None:
    found = factors(patches(0.2, grows, np.random.default_rng(0)))
    assert found.mean(axis=(0, 1)) == pytest.approx(1.0, abs=0.005)
    assert np.log(found[..., 1]).std() == pytest.approx(0.2, rel=0.03)


def test_only_ground_that_grows_is_dry_in_places() -> None:
    def redness(grows: bool) -> Array:
        found = factors(patches(0.2, grows, np.random.default_rng(0)))
        return np.log(found[..., 0] / found[..., 2])

    assert redness(True).std() == pytest.approx(0.6 * 0.2, rel=0.1)
    assert redness(False).std() < 0.01, "but for the rounding of codes"


def test_tiles_of_the_ground_lie_on_patches_that_differ() -> None:
    """Half a dozen tiles in a row, of 4 m as of 8 m, and the first ones after the patches repeat."""
    assert TILE_M % 4.0 == 1.0
    field = np.log(factors(patches(0.2, False, np.random.default_rng(0)))[..., 0])
    for metres in (8.0, 12.0, 16.0, 24.0, 32.0, 40.0, 48.0, TILE_M + 11.0):
        beside = np.roll(field, round(metres / TILE_M * TILE_PX), axis=1)
        assert np.corrcoef(field.ravel(), beside.ravel())[0, 1] < 0.4, metres


def test_ground_has_patches_only_where_asked_for() -> None:
    plain, patchy = built(Outdoor()), built(Outdoor(ground_patches=0.25))
    assert Outdoor() == Outdoor(ground_patches=0.0)
    assert [part.soil is not None for part in patchy.parts] == [part.texture is TURF.texture for part in patchy.parts]
    assert all(part.soil is None for part in plain.parts)
    assert plain.sky is not None and patchy.sky is not None
    assert np.array_equal(plain.sky, patchy.sky)
    for one, other in zip(plain.parts, patchy.parts, strict=True):
        assert np.array_equal(one.vertices, other.vertices)
        assert one.texture is not None and other.texture is not None
        assert np.array_equal(one.texture, other.texture)


def test_the_ground_of_a_site_has_the_same_patches_and_nothing_else_has_any() -> None:
    wall: BuiltStructure = Wall(bays=2).build(np.random.default_rng(0))

    def ground(environment: Outdoor) -> tuple[list[Part], list[Part]]:
        made = built(environment).site
        assert made is not None
        parts = made(wall, partial(stream, 3, "site")).parts
        return [p for p in parts if p.texture is TURF.texture], [p for p in parts if p.texture is not TURF.texture]

    field = built(Outdoor(ground_patches=0.25)).parts[0]
    turf, others = ground(Outdoor(ground_patches=0.25, site=Site(neighbours=1, plants=1.0)))
    assert field.soil is not None
    for part in turf:
        assert part.soil is not None
        assert np.array_equal(part.soil, field.soil)
    assert all(part.soil is None for part in others)
