"""A blurred step of light is found between the pixels, and the fit knows how well."""

import math

import numpy as np
import pytest
from scipy.special import erf

from uavbench.scenes.camera import Camera
from uavbench.scenes.rendering.radiance import encode
from uavbench.tracker.robust.edges.steps.optics_kernels import ALIGNED, Optics, learned_light
from uavbench.tracker.robust.edges.steps.step_kernels import fit_step
from uavbench.tracker.robust.edges.steps.sum_kernels import Strip, room_for
from uavbench.tracker.robust.optics.response import light_of_codes, srgb_light

SIZE, FINE, BLUR_PX = 41, 8, 0.5
DARK, BRIGHT = np.array([0.05, 0.08, 0.12]), np.array([0.5, 0.45, 0.4])
SRGB = srgb_light(np.arange(256) / 255)


def edge(distance, angle_deg, noise=0.0, rng=None, bright=BRIGHT):
    """Image of a half plane that begins so many px beyond the middle along a normal: mixed light, sRGB codes."""
    nu, nv = math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))
    at = (np.arange(SIZE * FINE) + 0.5) / FINE - 0.5
    across = (at[None, :] - SIZE // 2) * nu + (at[:, None] - SIZE // 2) * nv - distance
    lens = math.sqrt(BLUR_PX**2 - 1 / 12)  # the rest of the blur is that of the pixels' area
    share = 0.5 * (1 + erf(across / (math.sqrt(2) * lens)))
    share = share.reshape(SIZE, FINE, SIZE, FINE).mean(axis=(1, 3))[..., None]
    codes = encode(np.minimum(1, DARK * (1 - share) + bright * share)).astype(float)
    codes += rng.normal(0, noise, codes.shape) if rng is not None else 0.0
    return np.clip(np.rint(codes), 0, 255).astype(np.uint8), np.array([SIZE // 2, SIZE // 2, nu, nv], dtype=float)


def strip(gap, distance, angle_deg, middle=0.3):
    """The same of a strip, `gap` px wide, of another light between the two half planes; the lines of both borders."""
    nu, nv = math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))
    at = (np.arange(SIZE * FINE) + 0.5) / FINE - 0.5
    across = (at[None, :] - SIZE // 2) * nu + (at[:, None] - SIZE // 2) * nv - distance
    lens = math.sqrt(BLUR_PX**2 - 1 / 12)
    steps = [0.5 * (1 + erf((across - at) / (math.sqrt(2) * lens))) for at in (0.0, gap)]
    share = (middle * steps[0] + (1 - middle) * steps[1]).reshape(SIZE, FINE, SIZE, FINE).mean(axis=(1, 3))[..., None]
    codes = encode(DARK * (1 - share) + BRIGHT * share)
    half = SIZE // 2
    lines = np.array([[half, half, nu, nv], [half + gap * nu, half + gap * nv, nu, nv]], dtype=float)
    return np.clip(np.rint(codes), 0, 255).astype(np.uint8), lines


def fit(image, lines, start, colour, blur_px=BLUR_PX, light=SRGB[None], room=None):
    room = room_for(6, len(light) - 1, 2) if room is None else room
    return fit_step(image, np.atleast_2d(lines), start, Strip(2, 2, Optics(light, blur_px, ALIGNED)), colour, room)


def direction(bright=BRIGHT):
    row = np.zeros(8)
    row[:3], row[3:6], row[6] = encode(DARK[None, None])[0, 0], encode(np.minimum(1, bright)[None, None])[0, 0], 5
    colour = np.empty(3)
    return learned_light(row, 3, Optics(SRGB[None], BLUR_PX, ALIGNED), colour), colour


@pytest.mark.parametrize("start", [-0.2, 0.1, 0.6, 3.0])
@pytest.mark.parametrize("angle", [20, 110])
def test_an_edge_alone_is_fitted_as_among_others_to_the_bit(angle, start):
    image, line = edge(0.3, angle, 2.0, np.random.default_rng(0))
    colour, unmoved = direction()[1], np.stack([SRGB, np.zeros(256)])
    assert fit(image, line, start, colour) == fit(image, line, start, colour, light=unmoved)  # with a derivative of 0


@pytest.mark.parametrize("angle", [0, 20, 45, 70, 90, 135, 200, 310])
@pytest.mark.parametrize("distance", [-0.4, -0.1, 0.0, 0.3])
def test_a_step_is_found_to_a_hundredth_of_a_pixel(angle, distance):
    image, line = edge(distance, angle)
    _, colour = direction()
    found, variance = fit(image, line, 0.0, colour)
    assert found == pytest.approx(distance, abs=0.06)
    again, _ = fit(image, line, found, colour)
    assert again == pytest.approx(distance, abs=0.012)
    assert 0 < variance < 0.03**2


def noisy(image, rng, sigma=3.0):
    return np.clip(np.rint(image + rng.normal(0, sigma, image.shape)), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("gap", [1.5, 2.5])
def test_the_variance_of_one_in_a_crowd_is_that_of_its_error(gap):
    rng = np.random.default_rng(0)
    _, colour = direction()
    fits = []
    for _ in range(200):
        image, lines = strip(gap, 0.1, rng.uniform(0, 360), middle=0.5)
        fits.append(fit(noisy(image, rng), lines, 0.1, colour))
    found, variance = np.transpose(fits)
    assert 0.6 < np.mean((found - 0.1) ** 2 / variance) < 1.6


def test_its_variance_is_that_of_its_error():
    rng = np.random.default_rng(0)
    _, colour = direction()
    fits = []
    for _ in range(200):
        image, line = edge(0.1, rng.uniform(0, 360), 3.0, rng)
        fits.append(fit(image, line, 0.1, colour))
    found, variance = np.transpose(fits)
    assert 0.6 < np.mean((found - 0.1) ** 2 / variance) < 1.6


@pytest.mark.parametrize(("times", "beside_px"), [(2.5, 0.02), (5, 0.08), (15, 0.25)])
def test_a_step_to_light_that_is_blown_out_is_where_it_is(times, beside_px):
    """All pixels together would have it up to 0.76 px into the dark side, with a hundred times the variance."""
    rng, bright = np.random.default_rng(0), times * BRIGHT
    step, colour = direction(bright)
    assert step > 0.5
    errors, variances = [], []
    for _ in range(200):
        distance = rng.uniform(-0.2, 0.2)
        image, line = edge(distance, rng.uniform(0, 360), 1.5, rng, bright)
        found = fit(image, line, fit(image, line, 0.0, colour).distance, colour)
        if np.isfinite(found.distance):
            errors.append(found.distance - distance)
            variances.append(found.variance_px2)
    assert len(errors) >= 100
    assert abs(np.mean(errors)) < beside_px
    assert np.mean(np.square(errors) / variances) < 5


def test_channels_that_are_not_blown_out_are_enough():
    rng, bright = np.random.default_rng(0), BRIGHT * [0.9, 0.9, 8]
    _, colour = direction(bright)
    assert colour[2] == 0.0
    image, line = edge(0.1, 30, 1.5, rng, bright)
    assert fit(image, line, 0.1, colour).distance == pytest.approx(0.1, abs=0.03)
    _, of_most = direction(BRIGHT * [0.1, 0.2, 8])
    assert of_most[2] > 0.9  # the others show hardly a step


def test_nothing_is_located_where_both_sides_are_blown_out():
    _, colour = direction()
    image, line = edge(0.0, 30)
    bright = image > np.median(image)
    assert np.isfinite(fit(np.where(bright, 249, 245).astype(np.uint8), line, 0.0, colour).distance)
    assert fit(np.where(bright, 255, 251).astype(np.uint8), line, 0.0, colour).distance == np.inf


def test_no_step_is_found_where_there_is_none_or_it_goes_the_other_way():
    _, colour = direction()
    image, line = edge(0.0, 30)
    assert fit(np.full_like(image, 90), line, 0.0, colour)[0] == np.inf
    assert fit(image, line * np.array([1, 1, -1, -1]), 0.0, colour)[0] == np.inf
    assert fit(image, np.array([1.0, 1.0, 1.0, 0.0]), 0.0, colour)[0] == np.inf


@pytest.mark.parametrize("angle", [0, 30, 90, 250])
@pytest.mark.parametrize("gap", [1.5, 2.5, 4.0])
@pytest.mark.parametrize("middle", [0.3, 0.7])
def test_steps_that_crowd_are_found_together(gap, angle, middle):
    image, lines = strip(gap, 0.2, angle, middle)
    _, colour = direction()
    for own in (lines, lines[::-1].copy()):
        found, _ = fit(image, own, 0.0, colour)
        assert fit(image, own, found, colour)[0] == pytest.approx(0.2, abs=0.04)


def test_one_alone_would_be_drawn_to_the_other():
    image, lines = strip(1.5, 0.2, 30)
    _, colour = direction()
    assert max(abs(fit(image, line, 0.2, colour)[0] - 0.2) for line in lines) > 0.03


@pytest.mark.parametrize("angle", [30, 110, 200])
@pytest.mark.parametrize(("gap", "middle"), [(1.5, 0.3), (1.5, 0.7), (2.5, 0.1), (2.5, 0.5), (4.0, 0.3)])
def test_steps_that_moved_apart_have_a_share_each_in_the_distance(gap, middle, angle):
    image, lines = strip(gap, 0.0, angle, middle)
    _, colour = direction()
    for order in ([0, 1], [1, 0]):
        there, _ = fit(image, lines[order], 0.0, colour)
        for apart in (-0.04, 0.04):
            moved, room = lines.copy(), room_for(6, 0, 2)
            moved[1, :2] -= apart * lines[1, 2:]
            found, _ = fit(image, moved[order], 0.0, colour, room=room)
            shares = room.shares[:2]
            assert shares.sum() == pytest.approx(1.0, abs=0.03)
            assert found - there == pytest.approx(shares @ np.array([0.0, apart])[order], abs=0.006)


def test_the_share_of_the_step_of_more_light_is_the_larger_one():
    _, colour = direction()
    for middle, larger in ((0.9, 0), (0.1, 1)):
        image, lines = strip(2.5, 0.0, 20, middle)
        for order in ([0, 1], [1, 0]):
            room = room_for(6, 0, 2)
            fit(image, lines[order], 0.0, colour, room=room)
            assert room.shares[order.index(larger)] > 0.8


def test_a_strip_of_less_light_than_either_side_is_found_too():
    image, lines = strip(1.5, -0.2, 20, middle=-0.08)
    _, colour = direction()
    found, _ = fit(image, lines[::-1].copy(), 0.0, colour)
    assert fit(image, lines[::-1].copy(), found, colour)[0] == pytest.approx(-0.2, abs=0.02)


@pytest.mark.parametrize(("response", "exponent"), [("linear", 1.0), (1.8, 1.8)])
def test_a_step_is_found_in_the_codes_of_a_camera_whose_response_is_known(response, exponent):
    image, line = edge(0.2, 20)
    codes = np.rint(255 * SRGB ** (1 / exponent)).astype(np.uint8)
    row, colour = np.zeros(8), np.empty(3)
    row[:3], row[3:6], row[6] = codes[encode(DARK[None, None])[0, 0]], codes[encode(BRIGHT[None, None])[0, 0]], 5
    known = light_of_codes(Camera(SIZE, SIZE, 40, 40, 20, 20, response=response))
    found = []
    for light in (known[None], SRGB[None]):
        learned_light(row, 3, Optics(light, BLUR_PX, ALIGNED), colour)
        found.append(abs(fit(codes[image], line, 0.2, colour, light=light).distance - 0.2))
    assert found[0] < 0.01 and found[1] > 2 * found[0]


@pytest.mark.parametrize("angle", [0, 90, 180])
def test_an_edge_along_the_pixels_is_found_wherever_it_crosses_them(angle):
    """A blur that is thought to be normal, though pixels have an area, would displace it by up to 0.013 px."""
    _, colour = direction()
    errors = []
    for distance in np.arange(-0.5, 0.5, 0.05):
        rng = np.random.default_rng(0)
        fits = [fit(*edge(distance, angle, 2.0, rng), distance, colour).distance for _ in range(60)]
        errors.append(np.mean(fits) - distance)
    assert np.std(errors) < 0.003


@pytest.mark.parametrize("angle", [0, 90, 180])
def test_so_it_is_without_a_lens_that_blurs(angle):
    """A normal blur would displace it by 0.04 px (standard deviation)."""
    line = np.array([SIZE // 2, SIZE // 2, *np.round(unit(angle))])
    _, colour = direction()
    errors = []
    for distance in np.arange(-0.45, 0.5, 0.05):
        along = np.arange(SIZE) - SIZE // 2
        share = np.clip(along * line[2:].sum() - distance + 0.5, 0, 1)
        share = share[None, :] if abs(line[2]) > 0.5 else share[:, None]
        light = DARK * (1 - share[..., None]) + BRIGHT * share[..., None]
        image = np.broadcast_to(encode(light.astype(np.float32)), (SIZE, SIZE, 3))
        errors.append(fit(np.ascontiguousarray(image), line, distance, colour, blur_px=12**-0.5).distance - distance)
    assert np.std(errors) < 0.006


def unit(angle_deg):
    return np.array([math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))])
