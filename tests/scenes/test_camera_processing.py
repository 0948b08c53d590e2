"""What a camera makes of light: its lens's lateral colour, its exposure, its colour filter array, its sharpening."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import replace
from itertools import product
from typing import Protocol

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.scenes.conftest import FLAT_LIGHT, white_box
from tests.scenes.test_effects import SMALL, edge_columns, flat, giving, rng, turning
from uavbench.scenes.camera import Camera
from uavbench.scenes.effects.exposure import MotionBlur, RollingShutter
from uavbench.scenes.effects.image_sensor import FixedExposure, Noise
from uavbench.scenes.effects.lens import LateralColour
from uavbench.scenes.effects.processing import ColourFilter, Sharpening
from uavbench.scenes.effects.registry import EFFECTS
from uavbench.scenes.filming.film import with_effects
from uavbench.scenes.rendering.camera_simulator import CameraSimulator, Rendered, ideal_camera, render_camera
from uavbench.scenes.rendering.radiance import Radiance, decode, encode
from uavbench.scenes.rendering.renderer import Renderer
from uavbench.trajectories.pose import Pose

BLUE, GREEN, RED = range(3)
PATTERNS = ("RGGB", "BGGR", "GRBG", "GBRG")
DEMOSAICING = ("bilinear", "gradient-corrected")
INSIDE = slice(2, -2)
"""Rows and columns at which no interpolation reaches beyond the image."""


def image_of(effect: LateralColour | ColourFilter | Sharpening | FixedExposure, light: Radiance) -> Radiance:
    height, width = light.shape[:2]
    camera = Camera(width, height, 150.0, 150.0, (width - 1) / 2, (height - 1) / 2)
    found = effect.start(giving(lambda _: light, camera), rng()).image(0)
    assert found is not None
    return found


class Filmed(Protocol):
    """Makes cameras that are closed after a test."""

    def __call__(
        self, camera: Camera, lens: LateralColour, path: Callable[[int], Pose], *ends_m: float, margin_px: int = 0
    ) -> CameraSimulator: ...


@pytest.fixture
def scene() -> Iterator[Filmed]:
    """A camera before white walls 2 m ahead, in turn from one end (left of the optical axis) to the next, right of it.

    Behind the last end the wall goes on.
    """
    with ExitStack() as renderers:

        def filmed(
            camera: Camera, lens: LateralColour, path: Callable[[int], Pose], *ends_m: float, margin_px: int = 0
        ) -> CameraSimulator:
            pinhole, grid = render_camera(camera, max(lens.margin_px, margin_px))
            ends = [*ends_m, -9.0]
            pairs = zip(ends[::2], ends[1::2], strict=True)
            walls = tuple(white_box((2.0, low, -9.0), (2.0001, high, 9.0)) for high, low in pairs)
            renderer = renderers.enter_context(Renderer(walls, FLAT_LIGHT, pinhole.width, pinhole.height))
            return ideal_camera(renderer, camera, pinhole, grid, path)

        yield filmed


def displaced(image: Radiance, channel: int) -> np.ndarray:
    """Displacement of the only edge of each row of one colour relative to that of green, px."""
    places = [edge_columns(image[..., [c] * 3]) for c in (channel, GREEN)]
    return np.asarray(places[0] - places[1])


DISTORTED = Camera(320, 240, 250.0, 240.0, 140.0, 130.0, "radtan", (-0.28, 0.07, 0.0, 0.0))


@pytest.mark.parametrize("camera", [SMALL, replace(SMALL, cx=60.0), DISTORTED], ids=["pinhole", "off-centre", "lens"])
@pytest.mark.parametrize("edge_m", [0.7, 0.31, -0.24, -0.8])
def test_colours_of_an_edge_are_displaced_in_proportion_to_their_distance(
    scene: Filmed, camera: Camera, edge_m: float
) -> None:
    lens = LateralColour(red_px=0.9, blue_px=-0.6)
    image = lens.start(scene(camera, lens, turning(0.0), edge_m), rng()).image(0)
    assert image is not None
    at = edge_columns(image) - camera.cx
    corner = np.hypot(max(camera.cx, camera.width - 1 - camera.cx), max(camera.cy, camera.height - 1 - camera.cy))
    whole = (at > 3 - camera.cx) & (at < camera.width - 4 - camera.cx)
    assert whole.any()
    steep = np.gradient(at)
    rows = np.arange(camera.height) - camera.cy
    radial = at - steep * rows  # along a slanted edge displacement down the rows moves it sideways
    for channel, px in ((RED, 0.9), (BLUE, -0.6)):
        off = displaced(image, channel) - px * radial / corner
        assert np.abs(off.reshape(-1, 20).mean(axis=1)[whole.reshape(-1, 20).all(axis=1)]).max() < 0.02


@pytest.mark.parametrize("px", [-1.7, -0.4, 0.4, 1.7])
def test_light_from_beyond_the_image_is_that_of_a_longer_lens(scene: Filmed, px: float) -> None:
    """A camera of that focal length sees at each pixel, borders too, what red shows: of a grating, averaged over it."""
    lens = LateralColour(red_px=px, blue_px=0.0)
    fence = [x for k in range(-12, 12) for x in (0.11 * k + 0.05, 0.11 * k)]
    fence = sorted(fence)[:0:-1]
    path = turning(0.0)
    image = lens.start(scene(SMALL, lens, path, *fence), rng()).image(0)
    longer = 1 + px / np.hypot(79.5, 59.5)
    zoomed = replace(SMALL, fx=SMALL.fx * longer, fy=SMALL.fy * longer)
    expected = scene(zoomed, replace(lens, red_px=0.0), path, *fence).image(0)
    plain = scene(SMALL, replace(lens, red_px=0.0), path, *fence).image(0)
    assert image is not None and expected is not None and plain is not None
    assert np.array_equal(image[..., [BLUE, GREEN]], plain[..., [BLUE, GREEN]])
    blur = 0.25 * float(np.abs(np.diff(expected[60, :, RED], 2)).max())  # what linear interpolation takes for a bend
    assert np.abs(image - expected)[..., RED].max() < blur + 0.01
    border = np.r_[0:3, 157:160]
    assert np.abs((image - expected)[:, border, RED].mean(axis=0)).max() < blur


@pytest.mark.parametrize("camera", [SMALL, DISTORTED], ids=["pinhole", "lens"])
@pytest.mark.parametrize("px", [-1.7, -0.4, 0.4])
def test_the_borders_of_an_image_are_inside_of_a_larger_one(scene: Filmed, camera: Camera, px: float) -> None:
    """The same lens before a larger sensor shows the same there."""
    sizes = [
        np.hypot(max(c.cx, c.width - 1 - c.cx), max(c.cy, c.height - 1 - c.cy)) for c in (camera, camera.wider(16))
    ]
    fence = [0.011 * k for k in range(150, -151, -7)]
    images = []
    for seen, scale in ((camera, 1.0), (camera.wider(16), sizes[1] / sizes[0])):
        lens = LateralColour(red_px=px * scale, blue_px=-px * scale)
        image = lens.start(scene(seen, lens, turning(0.0, roll_rad_s=0.3), *fence), rng()).image(1_000_000_000)
        assert image is not None
        images.append(image)
    off = np.abs(images[0] - images[1][16:-16, 16:-16])
    assert off.max() < 0.03
    assert float((off > 0.01).mean()) < 1e-3


@pytest.mark.parametrize("px", [-5.0, 5.0])
def test_every_lens_of_the_smallest_camera_shows_light(scene: Filmed, px: float) -> None:
    tiny = Camera(16, 16, 15.0, 15.0, 7.5, 7.5)
    lens = LateralColour(red_px=px, blue_px=-px)
    image = lens.start(scene(tiny, lens, turning(0.0), 9.0), rng()).image(0)
    assert image is not None
    assert np.ptp(image) < 0.02


def test_lateral_colour_follows_the_shutter(scene: Filmed) -> None:
    """Red of a turning camera, each row at its time, is magnified about the principal point as that of one at rest."""
    path = turning(1.0, roll_rad_s=0.5)
    lens = LateralColour(red_px=1.2, blue_px=-1.2)
    shutter, blur = RollingShutter(readout_ms=30.0), MotionBlur(exposure_ms=4.0)
    source = with_effects(scene(SMALL, lens, path, 0.3, margin_px=24), (lens, blur, shutter), 0)
    plain = with_effects(scene(SMALL, lens, path, 0.3, margin_px=24), (blur, shutter), 0)
    image, green = source.image(0), plain.image(0)
    assert image is not None and green is not None
    assert source.row_delay_ns == plain.row_delay_ns
    later = (edge_columns(image) - edge_columns(green)).reshape(-1, 20).mean(axis=1)
    assert np.abs(later).max() < 0.02
    at, steep = edge_columns(green), np.gradient(edge_columns(green))
    radial = (at - 79.5) - steep * (np.arange(120) - 59.5)
    for channel, px in ((RED, 1.2), (BLUE, -1.2)):
        off = displaced(image, channel) - px * radial / np.hypot(79.5, 59.5)
        assert np.abs(off.reshape(-1, 20).mean(axis=1)).max() < 0.03


def test_a_lens_without_lateral_colour_changes_nothing() -> None:
    light = rng().random((24, 32, 3), dtype=np.float32)
    assert np.array_equal(image_of(LateralColour(red_px=0.0, blue_px=0.0), light), light)


@pytest.mark.parametrize("stops", [-2.0, 0.0, 1.5])
def test_a_stop_is_twice_the_light(stops: float) -> None:
    light = rng().random((4, 5, 3), dtype=np.float32)
    np.testing.assert_allclose(image_of(FixedExposure(stops=stops), light), light * 2**stops, rtol=1e-6)


def test_exposure_is_before_noise_and_blows_out() -> None:
    """Four times the light of a quarter: the noise of all of it, white without any where it is more than full."""
    bright = with_effects(flat(0.125), (Noise(full_well_e=1000.0, read_noise_e=0.0), FixedExposure(stops=2.0)), 1)
    image = bright.image(0)
    assert image is not None
    assert float(image.var()) == pytest.approx(0.5 / 1000, rel=0.03)
    blown = with_effects(flat(0.7), (FixedExposure(stops=1.5), Noise()), 1).frame(0)
    assert blown is not None and (blown == 255).all()


@pytest.mark.parametrize(("pattern", "demosaicing"), list(product(PATTERNS, DEMOSAICING)))
@given(seed=st.integers(0, 2**32 - 1), height=st.integers(16, 23), width=st.integers(16, 23))
@settings(max_examples=10, deadline=None)
def test_measured_colours_stay_at_the_sites_of_the_pattern(
    pattern: str, demosaicing: str, seed: int, height: int, width: int
) -> None:
    """Of random light, which no interpolation gives back."""
    light = np.random.default_rng(seed).random((height, width, 3), dtype=np.float32)
    image = image_of(ColourFilter(pattern, demosaicing), light)  # type: ignore[arg-type]
    for row, column in product(range(height), range(width)):
        kept = "BGR".index(pattern[2 * (row % 2) + column % 2])
        assert [c for c in range(3) if image[row, column, c] == light[row, column, c]] == [kept]


@pytest.mark.parametrize(("pattern", "demosaicing"), list(product(PATTERNS, DEMOSAICING)))
def test_plain_colours_and_grey_ramps_stay(pattern: str, demosaicing: str) -> None:
    mosaic = ColourFilter(pattern, demosaicing)  # type: ignore[arg-type]
    plain = np.broadcast_to(np.array([0.2, 0.5, 0.9], dtype=np.float32), (20, 23, 3))
    if demosaicing == "bilinear":  # gradients of one colour are taken for those of all
        np.testing.assert_allclose(image_of(mosaic, plain), plain, rtol=1e-6)
    grey = np.full((20, 23, 3), 0.37, dtype=np.float32)
    np.testing.assert_allclose(image_of(mosaic, grey), grey, rtol=1e-6)
    rows, columns = np.mgrid[:20, :23]
    ramp = np.repeat((0.1 + 0.02 * rows + 0.01 * columns)[..., None], 3, axis=2).astype(np.float32)
    np.testing.assert_allclose(image_of(mosaic, ramp)[INSIDE, INSIDE], ramp[INSIDE, INSIDE], rtol=1e-5)


def test_gradients_of_the_measured_colour_correct_the_others() -> None:
    """Malvar, He & Cutler 2004, equations 2 to 5: the bilinear mean and 1/2, 5/8 or 3/4 of the measured gradient."""
    light = rng().random((20, 22, 3), dtype=np.float32)
    image = image_of(ColourFilter("RGGB", "gradient-corrected"), light)

    def at(row: int, column: int) -> float:
        """The mosaic: red at even rows and columns, blue at odd ones."""
        return float(light[row, column, (RED, GREEN, BLUE)[row % 2 + column % 2]])

    def mean(row: int, column: int, *steps: tuple[int, int]) -> float:
        return float(np.mean([at(row + dr, column + dc) for dr, dc in steps]))

    cross, diagonal = [(0, 1), (0, -1), (1, 0), (-1, 0)], [(1, 1), (1, -1), (-1, 1), (-1, -1)]
    row, column = 10, 12
    gradient = at(row, column) - mean(row, column, *((2 * dr, 2 * dc) for dr, dc in cross))
    assert image[row, column, GREEN] == pytest.approx(mean(row, column, *cross) + gradient / 2, abs=1e-6)
    assert image[row, column, BLUE] == pytest.approx(mean(row, column, *diagonal) + 0.75 * gradient, abs=1e-6)
    for (row, column), along, other in (((10, 13), (0, 1), (1, 0)), ((11, 12), (1, 0), (0, 1))):
        far = mean(row, column, *diagonal) * 0.8
        far += 0.4 * mean(row, column, *((2 * k * along[0], 2 * k * along[1]) for k in (1, -1)))
        far -= 0.2 * mean(row, column, *((2 * k * other[0], 2 * k * other[1]) for k in (1, -1)))
        near = mean(row, column, along, (-along[0], -along[1]))
        assert image[row, column, RED] == pytest.approx(near + 0.625 * (at(row, column) - far), abs=1e-6)


def test_bilinear_colours_are_means_of_their_neighbours_and_of_no_more_than_white() -> None:
    light = np.full((16, 16, 3), 0.5, dtype=np.float32)
    light[8, 8] = 3.0  # red is measured there
    image = image_of(ColourFilter(), light)
    assert image[8, 8, RED] == 1.0
    assert image[8, 9, RED] == pytest.approx(0.75)
    assert image[9, 9, RED] == pytest.approx(0.625)
    assert (image[..., [BLUE, GREEN]] == 0.5).all()


def test_noise_of_interpolated_colours_is_that_of_their_means() -> None:
    """Covariances of linear interpolation of independent samples of variance 1, relative to a measured one."""
    noisy = with_effects(flat(0.5), (ColourFilter(), Noise(full_well_e=1000.0, read_noise_e=0.0)), 2)
    images = []
    for frame in range(12):
        image = noisy.image(frame)
        assert image is not None
        images.append((image - 0.5) / np.sqrt(0.5 / 1000))
    z = np.array(images)[:, INSIDE, INSIDE]
    red, green = z[:, 0::2, 0::2], z[:, 0::2, 1::2]  # red is measured, and green
    blue = z[:, 1::2, 1::2]
    for found, expected in (
        ((red[..., RED] ** 2).mean(), 1.0),
        ((green[..., RED] ** 2).mean(), 1 / 2),
        ((blue[..., RED] ** 2).mean(), 1 / 4),
        ((red[..., GREEN] ** 2).mean(), 1 / 4),
        ((red[..., RED] * green[..., RED]).mean(), 1 / 2),
        ((red[..., RED] * blue[..., RED]).mean(), 1 / 4),
        ((green[..., RED] * blue[..., RED]).mean(), 1 / 4),
        ((green[..., GREEN] * red[..., GREEN]).mean(), 1 / 4),
        ((red[..., RED] * red[..., GREEN]).mean(), 0.0),
    ):
        assert float(found) == pytest.approx(expected, abs=0.03)


def test_frames_that_are_coded_at_once_pass_the_colour_filter() -> None:
    roots = rng().integers(0, 256, (120, 160, 3), dtype=np.uint8)
    filtered = with_effects(giving(Rendered(lambda _: roots)), (Noise(), ColourFilter()), 4)
    light = with_effects(giving(Rendered(lambda _: roots)), (Noise(),), 4).image(0)
    assert light is not None
    frame = filtered.frame(0)
    assert frame is not None
    assert np.array_equal(frame, encode(image_of(ColourFilter(), light)))


def step(low: int, high: int) -> Radiance:
    codes = np.full((20, 40, 3), low, dtype=np.uint8)
    codes[:, 20:] = high
    return decode(codes)


@pytest.mark.parametrize(("amount", "radius_px"), [(0.8, 1.0), (1.5, 0.6), (0.4, 2.5)])
def test_a_step_overshoots_by_its_share_of_the_blur(amount: float, radius_px: float) -> None:
    """At the first pixel beyond it half of the Gaussian without its middle lies on the other side; 2 levels are far."""
    image = encode(image_of(Sharpening(amount, radius_px), step(80, 140))).astype(int)
    weights = np.exp(-np.square(np.arange(-15, 16) / radius_px) / 2)
    over = amount * 60 * (1 - weights[15] / weights.sum()) / 2
    assert image[10, 20] == pytest.approx(140 + over, abs=0.6)
    assert image[10, 19] == pytest.approx(80 - over, abs=0.6)
    assert (image[:, :8] == 80).all() and (image[:, -8:] == 140).all()


def test_sharpened_codes_are_clipped() -> None:
    image = encode(image_of(Sharpening(3.0), step(5, 250)))
    assert (image[:, 19] == 0).all() and (image[:, 20] == 255).all()


def test_sharpening_by_nothing_changes_nothing() -> None:
    light = rng().random((24, 32, 3), dtype=np.float32)
    assert np.array_equal(image_of(Sharpening(amount=0.0), light), light)


def test_effects_act_where_they_do_in_a_camera() -> None:
    order = list(EFFECTS)
    chain = ["motion-blur", "lateral-colour", "vignetting", "exposure", "noise", "quantization", "colour-filter"]
    chain += ["sharpening", "jpeg", "analog-link"]
    assert sorted(chain, key=order.index) == chain
