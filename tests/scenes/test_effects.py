from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from tests.scenes.conftest import FLAT_LIGHT, looking, white_box
from uavbench.scenes.camera import Camera
from uavbench.scenes.effects.exposure import MotionBlur, RollingShutter
from uavbench.scenes.effects.image_sensor import AutoExposure, Noise, Quantization
from uavbench.scenes.effects.lens import Vignetting
from uavbench.scenes.effects.link import AnalogLink, Drops, Jpeg
from uavbench.scenes.effects.registry import EFFECTS
from uavbench.scenes.filming.film import with_effects
from uavbench.scenes.rendering.camera_simulator import CameraSimulator, ideal_camera, light_of, render_camera
from uavbench.scenes.rendering.radiance import CODES, LIGHT, RENDERED, Radiance, decode, encode
from uavbench.scenes.rendering.renderer import Renderer
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.pose import Pose, rotation_exp

SMALL = Camera(160, 120, 150.0, 150.0, 79.5, 59.5)


def giving(image: Callable[[int], Radiance | None], camera: Camera = SMALL) -> CameraSimulator:
    """A source of given images, where no effect of the shutter is asked for."""

    def never(*_: object) -> None:
        raise AssertionError("not asked for")

    return CameraSimulator(camera, camera, None, never, never, never, image)  # type: ignore[arg-type]


def flat(level: float) -> CameraSimulator:
    return giving(lambda _: np.full((120, 160, 3), level, dtype=np.float32))


def rng() -> np.random.Generator:
    return np.random.default_rng(7)


def edge_columns(image: Radiance) -> np.ndarray:
    """Sub-pixel column in each row where dark turns bright."""
    light = image[..., 1] / image[..., 1].max()
    return np.asarray(image.shape[1] - 0.5 - light.sum(axis=1))


def turning(rate_rad_s: float, speed_m_s: float = 0.0, roll_rad_s: float = 0.0) -> Callable[[int], Pose]:
    start = looking((0.0, 0.0, 0.0), (1.0, 0.0, 0.0))

    def at(stamp_ns: int) -> Pose:
        t = stamp_ns * 1e-9
        turn = rotation_exp(np.array([0.0, rate_rad_s * t, roll_rad_s * t]))
        return Pose(turn @ start.rotation, np.array([speed_m_s * t, 0.0, 0.0]))

    return at


def edge_source(camera: Camera, path: Callable[[int], Pose], margin: int = 0) -> tuple[Renderer, CameraSimulator]:
    pinhole, lens = render_camera(camera, margin)
    near = white_box((2.0, -9.0, -9.0), (2.0001, 0.13, 9.0))
    renderer = Renderer((near,), FLAT_LIGHT, pinhole.width, pinhole.height)
    return renderer, ideal_camera(renderer, camera, pinhole, lens, path)


@pytest.mark.parametrize(("rate", "speed", "roll"), [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.5, -0.7, 0.6)])
def test_a_rolling_shutter_equals_a_render_of_every_row_at_its_own_pose(rate: float, speed: float, roll: float) -> None:
    path = turning(rate, speed, roll)
    renderer, source = edge_source(SMALL, path, RollingShutter.margin_px)
    with renderer:
        rolled = RollingShutter(readout_ms=30.0).start(source, rng())
        image = rolled.image(0)
        rows = []
        for row in range(120):
            at_ns = round((row - 59.5) * rolled.row_delay_ns)
            rows.append(source.expose(at_ns, at_ns)[row])
    assert image is not None
    error = edge_columns(image) - edge_columns(np.array(rows))
    assert np.abs(error - np.median(error)).max() < 0.3  # single rows know steps of 0.25 px
    assert abs(float(error.mean())) < 0.05
    assert np.abs(error.reshape(-1, 20).mean(axis=1)).max() < 0.1


@pytest.mark.parametrize("exposure_ms", [0.0, 4.0])
def test_rows_that_see_beyond_the_render_and_its_margin_are_not_smeared(exposure_ms: float) -> None:
    """The first and the last row of a fast turn are 45 px away from the middle one; the margin has 24."""
    path = turning(3.0, roll_rad_s=2.0)
    pinhole, lens = render_camera(SMALL, RollingShutter.margin_px)
    fence = [white_box((2.0, y, -9.0), (2.0001, y + 0.1, 9.0)) for y in np.arange(-6.0, 6.0, 0.3)]
    with Renderer(tuple(fence), FLAT_LIGHT, pinhole.width, pinhole.height) as renderer:
        source = ideal_camera(renderer, SMALL, pinhole, lens, path)
        rolled = RollingShutter(readout_ms=200.0).start(source, rng())
        half_ns = round(exposure_ms * 5e5)
        image = rolled.expose(-half_ns, half_ns)
        rows = []
        for row in range(120):
            at_ns = round((row - 59.5) * rolled.row_delay_ns)
            rows.append(source.expose(at_ns - half_ns, at_ns + half_ns)[row])
    off = np.abs(image - np.array(rows)).max(axis=2)
    assert off.max() < 0.5


def test_a_near_thing_hides_the_far_one_in_a_rolling_shutter() -> None:
    """Parallax: a near pole before a bright wall, seen while flying sideways."""
    path = turning(0.0, 1.5)
    pinhole, lens = render_camera(SMALL, 24)
    pole = replace(white_box((1.0, -0.05, -9.0), (1.0001, 0.05, 9.0)), tint=np.tile([0.02, 0.02, 0.02, 1.0], (8, 1)))
    wall = white_box((4.0, -9.0, -9.0), (4.1, 9.0, 9.0))
    with Renderer((pole, wall), FLAT_LIGHT, pinhole.width, pinhole.height) as renderer:
        source = ideal_camera(renderer, SMALL, pinhole, lens, path)
        rolled = RollingShutter(readout_ms=30.0).start(source, rng())
        image = rolled.image(0)
        assert image is not None
        rows = []
        for row in range(120):
            at_ns = round((row - 59.5) * rolled.row_delay_ns)
            rows.append(source.expose(at_ns, at_ns)[row, :, 1])
    dark = (1 - image[..., 1]).sum(axis=1) - (1 - np.array(rows)).sum(axis=1)
    centre = [(np.arange(160) * (1 - r)).sum() / (1 - r).sum() for r in (image[..., 1], np.array(rows))]
    assert abs(float(dark.mean())) < 0.1
    assert centre[0] == pytest.approx(centre[1], abs=0.1)


def test_blur_is_as_wide_as_the_motion() -> None:
    """A step edge swept over d px makes a ramp whose second moment is d ** 2 / 12 wider."""
    rate, exposure_s = 3.0, 0.02
    renderer, source = edge_source(SMALL, turning(rate))
    with renderer:
        sharp = source.image(0)
        blurred = MotionBlur(exposure_ms=1000 * exposure_s).start(source, rng()).image(0)
    assert sharp is not None
    assert blurred is not None

    def spread(image: Radiance) -> float:
        slope = np.diff(image[60, :, 1])
        x = np.arange(len(slope))
        mean = (x * slope).sum() / slope.sum()
        return float((np.square(x - mean) * slope).sum() / slope.sum())

    swept_px = 150.0 * rate * exposure_s
    assert spread(blurred) - spread(sharp) == pytest.approx(swept_px**2 / 12, rel=0.12)
    assert edge_columns(blurred).mean() == pytest.approx(edge_columns(sharp).mean(), abs=0.15)


@pytest.mark.parametrize(
    ("model", "coefficients"),
    [("radtan", (-0.283, 0.074, 0.0002, 0.0018)), ("equidistant", (-0.01, 0.02, -0.01, 0.002))],
)
def test_distorted_pixels_look_where_opencv_says(model: str, coefficients: tuple[float, ...]) -> None:
    camera = Camera(320, 240, 190.0, 191.0, 158.0, 121.0, model, coefficients)
    pinhole, lens = render_camera(camera)
    assert lens is not None
    rays = (lens.reshape(-1, 2).astype(np.float64) - [pinhole.cx, pinhole.cy]) / [pinhole.fx, pinhole.fy]
    pixels = camera.project(np.column_stack([rays, np.ones(len(rays))])).reshape(240, 320, 2)
    expected = np.stack(np.meshgrid(np.arange(320), np.arange(240)), axis=-1)
    assert np.abs(pixels - expected).max() < 0.02


@pytest.mark.parametrize(
    ("model", "coefficients", "told"),
    [
        ("equidistant", (0.0, 0.0, 0.0, 0.0), "a fisheye is limited to about 120 degrees"),
        ("radtan", (-0.3, 0.0, 0.0, 0.0), r"folds over before pixel \("),
    ],
)
def test_a_lens_that_no_pinhole_stands_for_is_refused(model: str, coefficients: tuple[float, ...], told: str) -> None:
    with pytest.raises(UserError, match=told):
        render_camera(Camera(640, 480, 240.0, 240.0, 319.5, 239.5, model, coefficients))


def test_a_fisheye_of_120_degrees_is_rendered() -> None:
    pinhole, lens = render_camera(Camera(640, 480, 305.0, 305.0, 319.5, 239.5, "equidistant", (0.0, 0.0, 0.0, 0.0)))
    assert lens is not None
    assert lens.min() > 0
    assert (lens < [pinhole.width - 1, pinhole.height - 1]).all()


def test_a_rendered_edge_bends_as_the_lens_does() -> None:
    camera = Camera(320, 240, 250.0, 250.0, 158.0, 121.0, "radtan", (-0.28, 0.07, 0.0, 0.0))
    renderer, source = edge_source(camera, turning(0.0))
    with renderer:
        image = source.image(0)
    assert image is not None
    edge = np.column_stack([np.full(401, 2.0), np.full(401, 0.13), np.linspace(-1.5, 1.5, 401)])
    pixels = camera.project(source.cam_from_world(0).transform(edge))
    expected = np.interp(np.arange(240), pixels[::-1, 1], pixels[::-1, 0])
    assert np.abs((edge_columns(image) - expected).reshape(-1, 24).mean(axis=1)).max() < 0.13


def test_light_of_every_code_is_its_square() -> None:
    codes = np.arange(256, dtype=np.uint8).reshape(-1, 2, 1).repeat(3, axis=2)
    for image in (codes, codes[::-1]):
        assert np.array_equal(light_of(image), RENDERED[image])


def test_the_photon_transfer_curve_gives_back_full_well_and_read_noise() -> None:
    """EMVA 1288: variance against mean is a line; its slope is one electron, its start the read noise."""
    noise = Noise(full_well_e=5000.0, read_noise_e=30.0)
    levels = np.linspace(0.1, 0.8, 8)
    variances = []
    for level in levels:
        image = noise.start(flat(float(level)), rng()).image(0)
        assert image is not None
        assert float(image.mean()) == pytest.approx(level, abs=3e-4)
        variances.append(float(image.var()))
    slope, offset = np.polyfit(levels, variances, 1)
    assert 1 / slope == pytest.approx(5000.0, rel=0.03)
    assert np.sqrt(max(offset, 0)) * 5000 == pytest.approx(30.0, rel=0.2)


def test_noise_is_independent_between_pixels_and_frames() -> None:
    noisy = Noise().start(flat(0.5), rng())
    first, second = noisy.image(0), noisy.image(1)
    assert first is not None
    assert second is not None
    a, b = (x - 0.5 for x in (first, second))
    scale = float(a.var())
    for shifted in (b, np.roll(a, 1, axis=0), np.roll(a, 1, axis=1), np.roll(a, 1, axis=2)):
        assert abs(float((a * shifted).mean())) < 0.02 * scale


def test_no_value_of_the_noise_comes_again_nearby() -> None:
    """Numbers are drawn four at a time; 16 bits give 65536 of them, so neighbours agree once in 65536."""
    image = Noise().start(flat(0.5), rng()).image(0)
    assert image is not None
    values = image.reshape(-1)
    for lag in (*range(1, 17), 160 * 3):
        assert float((values[lag:] == values[:-lag]).mean()) < 2e-4
        a, b = values[lag:] - 0.5, values[:-lag] - 0.5
        assert abs(float((a * b).mean())) < 0.02 * float(values.var())


def test_vignetting_follows_cosine_to_the_fourth() -> None:
    image = Vignetting().start(flat(0.6), rng()).image(0)
    assert image is not None
    assert image[60, 80, 0] == pytest.approx(0.6, rel=1e-4)
    assert image[0, 0, 0] == pytest.approx(0.6 / (1 + (79.5**2 + 59.5**2) / 150**2) ** 2, rel=1e-5)


def test_exposure_follows_the_light_with_its_time_constant() -> None:
    exposed = AutoExposure(target=0.2, lag_s=0.5, reach=100.0).start(
        giving(lambda t: np.full((120, 160, 3), 0.1 if t <= 0 else 0.4, dtype=np.float32)), rng()
    )
    means = {}
    for stamp in range(0, 3_000_000_000, 50_000_000):
        image = exposed.image(stamp)
        assert image is not None
        means[stamp] = float(image.mean())
    assert means[0] == pytest.approx(0.2, rel=1e-5)
    assert means[50_000_000] == pytest.approx(0.8, rel=1e-5)
    assert np.log(means[550_000_000] / 0.2) == pytest.approx(np.log(4) * np.exp(-1), rel=1e-4)
    assert means[2_950_000_000] == pytest.approx(0.2, rel=0.01)


@pytest.mark.parametrize("lag_s", [1e-4, 0.4])
def test_exposure_follows_the_light_where_a_field_precedes_the_frame_before(lag_s: float) -> None:
    """At 100 Hz the first field of a frame is 7 ms older than the whole frame before."""
    dimming = giving(lambda t: np.full((120, 160, 3), 0.3 - 0.1e-9 * t, dtype=np.float32))
    link = AnalogLink(jitter_px=0.0, bursts_per_frame=0.0, dropouts_per_frame=0.0, snow=0.0, sharpness_px=0.0)
    exposed = link.start(AutoExposure(target=0.2, lag_s=lag_s).start(dimming, rng()), rng())
    for stamp in range(0, 500_000_000, 10_000_000):
        image = exposed.image(stamp)
        assert image is not None
        np.testing.assert_allclose([image[::2].mean(), image[1::2].mean()], 0.2, rtol=0.2)


def test_quantization_leaves_its_levels() -> None:
    ramp = giving(lambda _: np.linspace(0, 1, 57600, dtype=np.float32).reshape(120, 160, 3))
    image = Quantization(bits=4).start(ramp, rng()).image(0)
    assert image is not None
    assert len(np.unique(image)) == 16


def test_jpeg_errs_more_at_lower_quality() -> None:
    texture = decode(rng().integers(0, 255, (120, 160, 3)).astype(np.uint8))
    errors = []
    for quality in (95, 60, 20):
        image = Jpeg(quality=quality).start(giving(lambda _: texture), rng()).image(0)
        assert image is not None
        errors.append(float(np.square(image - texture).mean()))
    assert errors[0] < errors[1] < errors[2]


def quiet_link(**changes: float | bool) -> AnalogLink:
    silent = AnalogLink(0.0, 0.0, 10.0, 0.0, 0.0, 0.0, False)
    return replace(silent, **changes)  # type: ignore[arg-type]


def test_a_perfect_analog_link_changes_nothing() -> None:
    texture = decode(rng().integers(0, 255, (120, 160, 3)).astype(np.uint8))
    image = quiet_link().start(giving(lambda _: texture), rng()).image(0)
    assert image is not None
    assert np.array_equal(encode(image), encode(texture))


def test_scan_lines_jitter_as_much_as_asked() -> None:
    step = np.zeros((120, 160, 3), dtype=np.float32)
    step[:, 80:] = 1.0
    step[:, 78:82] = LIGHT[np.array([51, 102, 153, 204])][None, :, None]  # a ramp in codes, 5 px wide
    image = quiet_link(jitter_px=0.6).start(giving(lambda _: step), rng()).image(0)
    assert image is not None
    columns = 159.5 - (encode(image)[..., 1] / 255).sum(axis=1)
    assert columns.std() == pytest.approx(0.6, rel=0.2)


def test_bursts_snow_and_dropouts_are_bands_of_rows() -> None:
    grey = flat(float(LIGHT[120]))
    snowy = quiet_link(snow=5.0).start(grey, rng()).image(0)
    assert snowy is not None
    assert encode(snowy).astype(float).std() == pytest.approx(5.0, rel=0.05)
    counts = []
    link = quiet_link(bursts_per_frame=2.0, burst_rows=5.0).start(grey, rng())
    for frame in range(60):
        image = link.image(frame)
        assert image is not None
        noisy = encode(image).astype(float).std(axis=(1, 2)) > 10
        counts.append(np.diff(noisy.astype(int), prepend=0).clip(0).sum())
    assert np.mean(counts) == pytest.approx(2.0, abs=0.6)


def test_interlaced_lines_come_from_an_earlier_field() -> None:
    asked: list[int] = []

    def moving(stamp_ns: int) -> Radiance:
        asked.append(stamp_ns)
        return np.full((120, 160, 3), LIGHT[200 if stamp_ns == 0 else 50], dtype=np.float32)

    image = quiet_link(interlaced=True).start(giving(moving), rng()).image(0)
    assert image is not None
    codes = encode(image)
    assert asked == [-16666667, 0]
    assert (codes[0::2] == 200).all()
    assert (codes[1::2] == 50).all()


def test_frames_are_lost_and_repeated_as_often_as_asked() -> None:
    source = giving(lambda t: np.full((2, 2, 3), t, dtype=np.float32))
    dropping = Drops(lost=0.1, repeated=0.2).start(source, rng())
    images = [dropping.image(t) for t in range(2000)]
    assert images[0] is not None
    lost = sum(image is None for image in images)
    again = sum(image is not None and image[0, 0, 0] != t for t, image in enumerate(images))
    assert lost / 2000 == pytest.approx(0.1, abs=0.02)
    assert again / 2000 == pytest.approx(0.2, abs=0.03)


def test_effects_act_in_the_order_of_nature_whatever_the_order_given() -> None:
    effects = (Noise(), Quantization(bits=3), Vignetting())
    images = [with_effects(flat(0.5), chosen, 3).image(0) for chosen in (effects, effects[::-1])]
    assert images[0] is not None
    assert images[1] is not None
    assert np.array_equal(images[0], images[1])
    assert len(np.unique(images[0])) <= 8


def test_adding_an_effect_does_not_shift_the_numbers_of_another() -> None:
    alone = with_effects(flat(0.5), (Noise(),), 3).image(0)
    together = with_effects(flat(0.5), (Noise(), Drops(lost=0.0, repeated=0.0)), 3).image(0)
    assert alone is not None
    assert together is not None
    assert np.array_equal(alone, together)


def test_every_effect_is_registered_once() -> None:
    assert len(set(EFFECTS.values())) == len(EFFECTS)
    assert CODES[0] == 0
    assert CODES[-1] == 255
