"""A varied horizon: nothing repeats, crowns are lit from the sun's side, clouds are heaped and not smeared."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from uavbench.scenes.materials import painted as materials
from uavbench.scenes.materials import procedural_texture as noise
from uavbench.scenes.materials.painted import Material
from uavbench.scenes.renderables import BuiltEnvironment
from uavbench.scenes.world import outdoor, tree_line
from uavbench.scenes.world.cloud_deck import clouds
from uavbench.scenes.world.outdoor import SKY_PX, TILE_PX, Outdoor
from uavbench.trajectories.random_streams import stream

BOUNDS = np.array([[-5.0, -1.0, 0.0], [5.0, 1.0, 4.0]])
SOUTH = Outdoor(sun_azimuth_deg=-90.0, ground_patches=0.2)
VARIED = replace(SOUTH, varied_horizon=True)


@pytest.fixture(scope="module", autouse=True)
def one_paint() -> Iterator[None]:
    """Plain ground: painting it takes long, and no test here looks at it."""
    flat = Material(np.full((1, 1, 3), 100, dtype=np.uint8), (1.0, 1.0), soaks=True)
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(materials.PAINTS, "grass", lambda rng: flat)
        yield


@pytest.fixture(scope="module")
def built(one_paint: None) -> BuiltEnvironment:
    return VARIED.build(BOUNDS, stream(2, "environment"))


def repeats(texture: np.ndarray, shift: int) -> float:
    """Correlation of the image with itself, moved around the horizon by a number of columns."""
    grey = texture[..., 1].astype(np.float64) * (texture[..., 3] > 127)
    return float(np.corrcoef(grey.ravel(), np.roll(grey, shift, axis=1).ravel())[0, 1])


def test_it_is_the_same_every_time_and_off_by_default(built: BuiltEnvironment) -> None:
    again = VARIED.build(BOUNDS, stream(2, "environment"))
    assert built.sky is not None and again.sky is not None
    assert built.sky.tobytes() == again.sky.tobytes()
    for one, other in zip(built.parts, again.parts, strict=True):
        assert one.texture is not None and other.texture is not None
        assert one.texture.tobytes() == other.texture.tobytes()
    assert not Outdoor().varied_horizon


def test_the_ground_and_its_patches_are_the_same_with_it(built: BuiltEnvironment) -> None:
    level, *rim = SOUTH.build(BOUNDS, stream(2, "environment")).parts
    ground, *varied = built.parts
    assert ground.vertices.tobytes() == level.vertices.tobytes()
    assert ground.tint is not None and level.tint is not None
    assert ground.tint.tobytes() == level.tint.tobytes()
    assert ground.soil is not None and level.soil is not None
    assert ground.soil.tobytes() == level.soil.tobytes()
    for one, other in zip(rim, varied, strict=True):
        assert one.vertices.tobytes() == other.vertices.tobytes()


def test_trees_and_hills_go_around_once(built: BuiltEnvironment) -> None:
    for band in built.parts[-2:]:
        assert band.uv is not None and band.texture is not None
        assert (band.uv[:, 0].min(), band.uv[:, 0].max()) == (0.0, 1.0)
        cover = (band.texture[..., 3] > 127).sum(axis=0).astype(int)
        assert abs(cover[0] - cover[-1]) < 25, "without a seam"
        columns = band.texture.shape[1]
        part = np.corrcoef(cover, np.roll(cover, columns // 10))[0, 1]
        assert abs(part) < 0.6, "a tenth of the way around it is another skyline"
    belt = built.parts[-1].texture
    assert belt is not None
    assert repeats(belt, belt.shape[1] // 10) < repeats(belt, 4) - 0.1


def test_plain_hills_have_no_vertical_streaks() -> None:
    """Their tones change faster upwards than across."""
    for seed in range(3):
        texture = outdoor._rim(BOUNDS, stream(seed, "environment"))[0].texture
        assert texture is not None
        tones, hill = np.log1p(texture[..., 1].astype(float)), texture[..., 3] > 0
        upwards = (tones[8:] - tones[:-8])[hill[8:] & hill[:-8]].std()
        across = (np.roll(tones, -8, axis=1) - tones)[hill & np.roll(hill, -8, axis=1)].std()
        assert upwards > 1.5 * across


def test_the_belt_is_brighter_opposite_the_sun(built: BuiltEnvironment) -> None:
    to_sun = np.array(built.light.to_lamp)
    for band in built.parts[-2:]:
        assert band.normals is not None
        lit = np.clip(band.normals @ to_sun, 0, None)
        opposite = band.vertices[:, 1] > 100.0  # the sun is at -y
        towards = band.vertices[:, 1] < -100.0
        assert lit[opposite].mean() > 2 * lit[towards].mean()
        assert band.normals[:, 2].min() > 0


def test_crowns_are_lit_from_the_side_of_the_sun() -> None:
    lights = []
    for from_left in (-1.0, 1.0):
        h, w = tree_line.BELT_PX
        image = np.zeros((h, w, 4), dtype=np.uint8)
        for k in range(8):
            crown = tree_line.Crown(100.0 + 20.0 * k, 4.0, 10.0, from_left)
            (tree_line._conifer if k % 2 else tree_line._broadleaf)(image, crown, 1.0, stream(k, "tree"))
        left, right = [], []
        for k in range(8):
            middle = round((100.0 + 20.0 * k) * tree_line.PER_M[0])
            for side, columns in ((left, slice(middle - 20, middle - 4)), (right, slice(middle + 4, middle + 20))):
                patch = image[:, columns]
                side.append(patch[patch[..., 3] > 0][:, 1].mean())
        lights.append((np.mean(left), np.mean(right)))
    assert lights[0][0] < 0.92 * lights[0][1]
    assert lights[1][1] < 0.92 * lights[1][0]


def smear(opacity: np.ndarray, elevation: np.ndarray) -> float:
    """Correlation of the clouds 1 and 1.8 degrees above the horizon."""
    rows = [int(np.abs(elevation - np.radians(at)).argmin()) for at in (1.0, 1.8)]
    return float(np.corrcoef(opacity[rows[0]], opacity[rows[1]])[0, 1])


def test_clouds_are_not_smeared_above_the_horizon() -> None:
    field = noise.fractal((TILE_PX, TILE_PX), 300, stream(1, "sky"), octaves=8, gain=0.58)
    h, w = SKY_PX
    elevation = (0.5 - (np.arange(h // 2) + 0.5) / h) * np.pi
    azimuth = ((np.arange(w) + 0.5) / w * 2 - 1) * np.pi
    up, level = np.sin(elevation)[:, None], np.cos(elevation)[:, None]
    way = tuple(each.astype(np.float32) for each in (level * np.cos(azimuth), level * np.sin(azimuth), up))
    edge = np.float32(0.0)
    plain = outdoor._plain_clouds(field, edge, way).opacity  # type: ignore[arg-type]
    heaped = clouds(field, float(edge), elevation, azimuth)
    assert smear(plain, elevation) > 0.95
    assert smear(heaped.opacity, elevation) < 0.7
    assert heaped.opacity.min() >= 0 and heaped.opacity.max() <= 1 + 1e-5
    assert heaped.shade.min() >= 0 and heaped.shade.max() <= 1 + 1e-5
    high = elevation > np.radians(35)
    both = np.corrcoef(plain[high].ravel(), heaped.opacity[high].ravel())[0, 1]
    assert both > 0.8, "the same clouds are overhead"


def test_clouds_go_on_where_their_tile_begins_again() -> None:
    """Along rows of pixels of the tile across its end, shades of the clouds change no faster there than elsewhere."""
    field = noise.fractal((TILE_PX, TILE_PX), 300, stream(1, "sky"), octaves=8, gain=0.58)
    ends = 4096 - 4000  # px beside the zenith
    columns, rows = np.arange(ends - 60, ends + 60) / 130, np.arange(-400, 50) / 130
    x, y = (np.ascontiguousarray(each, dtype=np.float32) for each in np.meshgrid(columns, rows))
    seen = outdoor._plain_clouds(field, np.float32(-1.4), (x, y, np.ones_like(x)))
    steps = np.abs(np.diff(seen.shade, axis=1)).max(axis=0)
    assert steps[57:62].max() < 1.5 * np.delete(steps, np.s_[57:62]).max()


def test_a_blurred_tile_has_no_seam() -> None:
    tile = noise.fractal((96, 128), 30, stream(1, "sky"))
    blurred = noise.blurred_tile(tile, 4.0)
    moved = noise.blurred_tile(np.roll(tile, (50, 70), (0, 1)), 4.0)
    assert np.array_equal(np.roll(moved, (-50, -70), (0, 1)), blurred)
    inner = (slice(18, -18), slice(18, -18))
    assert np.array_equal(blurred[inner], noise.blurred(tile, 4.0)[inner])


def test_tops_of_clouds_are_lighter_than_bases() -> None:
    field = noise.fractal((TILE_PX, TILE_PX), 300, stream(1, "sky"), octaves=8, gain=0.58)
    h, w = SKY_PX
    elevation = (0.5 - (np.arange(h // 2) + 0.5) / h) * np.pi
    azimuth = ((np.arange(w) + 0.5) / w * 2 - 1) * np.pi
    seen = clouds(field, 0.0, elevation, azimuth)
    rows = (elevation > np.radians(5)) & (elevation < np.radians(25))
    shade, opaque = seen.shade[rows], seen.opacity[rows] > 0.5
    edges = np.diff(opaque.astype(int), axis=0)  # 1: from sky above into a cloud below
    upper = np.argwhere(edges == 1)
    lower = np.argwhere(edges == -1)
    tops = shade[np.minimum(upper[:, 0] + 3, len(shade) - 1), upper[:, 1]].mean()
    bases = shade[np.maximum(lower[:, 0] - 2, 0), lower[:, 1]].mean()
    assert tops < bases


def test_an_overcast_sky_stays_overcast() -> None:
    for cloudiness, least, most in ((0.0, 0.0, 0.35), (1.0, 0.9, 1.0)):
        field = noise.fractal((TILE_PX, TILE_PX), 300, stream(1, "sky"), octaves=8, gain=0.58)
        elevation = np.radians(np.linspace(80, 20, 61))
        seen = clouds(field, 1.5 - 2.9 * cloudiness, elevation, np.linspace(-np.pi, np.pi, 256))
        assert least <= seen.opacity.mean() <= most


@pytest.mark.parametrize("varied", [False, True])
def test_an_overcast_sky_has_no_gap_of_blue(varied: bool) -> None:
    for cloudiness, blue in ((0.35, True), (0.8, True), (1.0, False)):
        built = replace(SOUTH, cloudiness=cloudiness, varied_horizon=varied).build(BOUNDS, stream(2, "environment"))
        assert built.sky is not None
        red, _, strong = (built.sky[: SKY_PX[0] // 2 - 8, :, k].astype(float) for k in range(3))
        assert (strong - red).max() > 60 if blue else (strong - red).max() < 40


def test_a_low_sun_colours_the_sky_on_its_side() -> None:
    """Red against blue at the horizon beneath the sun, opposite, and as it is at noon."""
    skies = {
        e: replace(SOUTH, sun_elevation_deg=e, cloudiness=0.0).build(BOUNDS, stream(2, "environment")).sky
        for e in (5.0, 15.0, 42.0)
    }
    warmth = {}
    for elevation, sky in skies.items():
        assert sky is not None
        row = sky[SKY_PX[0] // 2 - 20].astype(float)
        beneath = SKY_PX[1] // 4 + 100  # azimuth -90 degrees, beside the disc
        warmth[elevation] = [row[x, 0] - row[x, 2] for x in (beneath, beneath + SKY_PX[1] // 2)]
    assert warmth[5.0][0] > 20 > warmth[5.0][1] > warmth[42.0][1]
    assert warmth[15.0][1] == warmth[42.0][1] < -20
